"""The native kernel, calibration/kernel: arrays are contiguous, outputs filled in place, threads the caller's."""

from collections.abc import Sequence
from typing import Any

from numpy import float32, float64, int64, uint8, uint16
from numpy.typing import NDArray

def instruction_set() -> str: ...
def best_instruction_set() -> str: ...
def instruction_sets() -> list[str]: ...
def set_instruction_set(name: str) -> None: ...
def read_words(
    lit: Sequence[NDArray[Any]],
    other: Sequence[NDArray[Any]],
    limit: NDArray[Any],
    wide: int,
    black: NDArray[Any] | None,
    sure_share: float,
    saturation: NDArray[Any] | None,
    table: NDArray[uint16],
    first: int,
    end: int,
    twice: NDArray[uint16],
    reason: NDArray[uint8],
) -> None:
    """Read one axis of a binary code: calibration/kernel/words.hpp. All pictures are uint8, uint16 or float32."""

def read_beats(
    frames: Sequence[NDArray[Any]],
    noise: NDArray[float32],
    numbers: NDArray[float32],
    position: NDArray[float32],
    sigma: NDArray[float32],
    misfit: NDArray[float32],
    ambiguous: NDArray[uint8],
) -> None:
    """Read one axis of three sinusoids: calibration/kernel/beats.hpp. Frames are uint8, uint16 or float32."""

def undistort(
    real: NDArray[float64], terms: NDArray[float64], limit: float, rounds: int, ideal: NDArray[float64]
) -> None:
    """Invert Brown's distortion of points (N, 2), focal length 1: calibration/kernel/lens.hpp."""

def take_images(points: NDArray[float64], optics: NDArray[float64], fold: float, pixels: NDArray[float64]) -> None:
    """Pixels of points in a device's frame: calibration/kernel/landing.hpp."""

def slope_bearings(
    seen: NDArray[float64],
    bearings: NDArray[float64],
    optics: NDArray[float64],
    units: NDArray[float64],
    slopes: NDArray[float64],
) -> None:
    """Derivative of pixels' bearings by the unknowns of their lens: calibration/kernel/landing.hpp."""

def land(
    bearings: NDArray[float64],
    seen: NDArray[float64],
    weight: NDArray[float64],
    label: NDArray[int64],
    planes: NDArray[float64],
    optics: NDArray[float64],
    pose: NDArray[float64],
    fold: float,
    far: float,
    error: NDArray[float64],
) -> None:
    """Where points on planes land in a projector, less where they were seen: calibration/kernel/landing.hpp."""

def slope_landings(
    bearings: NDArray[float64],
    seen: NDArray[float64],
    weight: NDArray[float64],
    label: NDArray[int64],
    planes: NDArray[float64],
    optics: NDArray[float64],
    pose: NDArray[float64],
    by_lens: NDArray[float64],
    units: NDArray[float64],
    turns: NDArray[float64],
    across: NDArray[float64],
    plane_turns: NDArray[float64],
    own: NDArray[int64],
    own_slopes: NDArray[float64],
    jacobian: NDArray[float64],
) -> None:
    """Derivative of that by all unknowns of the fit: calibration/kernel/landing.hpp."""
