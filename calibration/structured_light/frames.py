"""What all codes ask of frames before they read them: all there, all alike, lit, not clipped."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.arrays import BoolArray, Frame
from calibration.errors import CalibrationError
from calibration.structured_light.correspondence import PixelReason

NOISE_SIGMAS = 2.0
"""`noise_limit` of a code is so many standard deviations of the difference of two frames."""


def noise_dn(noise_limit: float | NDArray[np.floating]) -> NDArray[np.float32]:
    """Return the standard deviation of one frame's noise, of which a code was told the limit for a difference."""
    return np.asarray(noise_limit, dtype=np.float32) / np.float32(NOISE_SIGMAS * 2**0.5)


def part(values: NDArray[Any], rows: slice) -> NDArray[Any]:
    """Return the rows of a picture, or the value that counts for all."""
    return values[rows] if values.ndim else values


def refuse_unequal(frames: Mapping[str, Frame | None]) -> None:
    """Raise CalibrationError if there are no frames, or if their shapes differ."""
    shapes = {name: frame.shape for name, frame in frames.items() if frame is not None}
    if not shapes:
        raise CalibrationError("no frames: photograph the patterns")
    first, shape = next(iter(shapes.items()))
    other = next((name for name in shapes if shapes[name] != shape or len(shape) != 2), None)
    if other is not None:
        raise CalibrationError(
            f"frame {other} has the shape {shapes[other]}, frame {first} has {shape}: all frames have to be (height, "
            "width) of one camera, colours summed"
        )


def frames_of(
    code: str, frames: Mapping[str, Frame], names: Sequence[str], *, white: Frame, black: Frame
) -> dict[str, Frame]:
    """Return the frames of a code in the order of its names.

    Raises
    ------
    CalibrationError
        If frames are missing, or the shapes of all, white and black among them, differ; the message names them.
    """
    _refuse_missing(frames, names, code)
    refuse_unequal({**frames, "white": white, "black": black})
    return {name: frames[name] for name in names}


def _refuse_missing(frames: Mapping[str, Frame], names: Sequence[str], code: str) -> None:
    if not frames:
        raise CalibrationError("no frames: photograph the patterns")
    missing = [name for name in names if name not in frames]
    if missing:
        raise CalibrationError(
            f"{code} code: {len(missing)} of {len(names)} patterns have no frame ({', '.join(missing)}); "
            "photograph them"
        )


def extreme(frames: Mapping[str, Frame], choose: np.ufunc) -> Frame:
    """(H, W) largest or smallest value of each pixel over all frames."""
    values = iter(frames.values())
    result = next(values).copy()
    for frame in values:
        choose(result, frame, out=result)
    return result


def is_dark(white: Frame, black: Frame, limit: NDArray[Any]) -> BoolArray:
    """(H, W) pixels whose white is above black by less than the limit."""
    return np.asarray(np.subtract(white, black, dtype=np.float32) < limit)


def mark(reasons: NDArray[np.uint8], reason: PixelReason, where: BoolArray) -> None:
    """Set the reason of some pixels, whatever it was."""
    np.copyto(reasons, np.uint8(reason), where=where)
