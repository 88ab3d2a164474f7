"""The native kernel, calibration/kernel: arrays are contiguous, outputs filled in place, threads the caller's."""

from collections.abc import Sequence
from typing import Any

from numpy import float32, float64, uint8, uint16
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
