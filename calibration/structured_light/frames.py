"""What all codes ask of frames before they read them: all there, all alike, lit, not clipped."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.arrays import BoolArray, Frame
from calibration.errors import CalibrationError
from calibration.structured_light.correspondence import PixelReason

WHOLE = "BH"
"""Letters of the kinds of frames that OpenCV takes as they are: 8 and 16 bits."""
Limit = float | NDArray[np.floating]

_FOLLOWS, _FOLLOWS_ALL = 0.15, 0.6
"""Of white minus black: what single stripes change at least, where frames of narrow ones tell, and where a pixel has
the same bit in all of these, so that the wide ones have to, which change light off other surfaces by up to a half."""
_LIKE_BLACK, _LIKE_WHITE = 0.2, 0.9
"""Between, of white minus black, lies the mean of all stripes: a half, or three quarters by a tone curve. A pixel whose
bits are all the same has one of these levels in all frames."""
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


def follows_stripes(fine: Sequence[Frame], wide: Sequence[Frame], *, bright: Frame, dark: Frame) -> BoolArray:
    """Return (H, W) whether pixels get light and dark from single stripes, not the mean of all from other surfaces.

    Parameters
    ----------
    fine, wide : sequence of (H, W)
        Frames of narrow stripes, which on other surfaces are all as bright, and of wide ones, which need not be.
    bright, dark : (H, W)
        White and black.
    """
    contrast = np.maximum(np.subtract(bright, dark, dtype=np.float32), 1)
    low, high = np.minimum.reduce(fine), np.maximum.reduce(fine)
    by_fine = np.subtract(high, low, dtype=np.float32)
    by_all = np.subtract(
        np.maximum(high, np.maximum.reduce(wide)), np.minimum(low, np.minimum.reduce(wide)), dtype=np.float32
    )
    is_dark = np.subtract(high, dark, dtype=np.float32) < _LIKE_BLACK * contrast
    is_lit = np.subtract(low, dark, dtype=np.float32) > _LIKE_WHITE * contrast
    return np.asarray((by_fine > _FOLLOWS * contrast) | (by_all > _FOLLOWS_ALL * contrast) | is_dark | is_lit)


@dataclass(frozen=True, eq=False, slots=True)
class Clipping:
    """Which pixels are clipped in some frame."""

    saturation: float
    """Values from here on are. [dn]"""
    found: BoolArray
    """(H, W)"""

    @classmethod
    def of(cls, saturation: float | None, shape: tuple[int, ...]) -> Clipping | None:
        """Return a record without any clipped pixel; None where no value is known to be clipped."""
        return None if saturation is None else cls(saturation, np.zeros(shape, dtype=bool))

    def note(self, values: Frame, rows: slice) -> None:
        """Note the clipped pixels of some rows of a frame; that there are none, the largest value says at once."""
        largest = cv2.minMaxLoc(values)[1] if values.dtype.char in WHOLE else values.max()
        if largest >= self.saturation:
            self.found[rows] |= values >= self.saturation


def limit_of_kind(limit: Limit, kind: np.dtype[Any]) -> NDArray[Any]:
    """Return a limit that whole differences can be held against without being converted."""
    if kind.char not in WHOLE:
        return np.asarray(limit, dtype=np.float32)
    most = 255 if kind == np.uint8 else 65535
    return np.asarray(np.clip(np.ceil(limit), 0, most), dtype=kind)


def common_kind(frames: Sequence[Frame]) -> np.dtype[Any]:
    """Return the kind in which frames are compared: 8 or 16 bits where all are so, single precision else."""
    kinds = {frame.dtype for frame in frames}
    kind = kinds.pop()
    return kind if not kinds and kind.char in WHOLE and kind.isnative else np.dtype(np.float32)


def of_kind(frame: Frame, kind: np.dtype[Any]) -> Frame:
    """(H, W) a frame as contiguous numbers of a kind: itself where it is that already."""
    return np.ascontiguousarray(frame, dtype=kind)


def saturation_of_kind(saturation: float | None, kind: np.dtype[Any]) -> NDArray[Any] | None:
    """(1,) least clipped value, as a number of a kind; None where no value is known to be clipped."""
    if saturation is None or kind.char not in WHOLE:
        return None if saturation is None else np.array([saturation], dtype=kind)
    least = np.ceil(saturation)
    return np.array([max(least, 0)], dtype=kind) if least <= np.iinfo(kind).max else None


def is_dark(white: Frame, black: Frame, limit: NDArray[Any]) -> BoolArray:
    """(H, W) pixels whose white is above black by less than the limit."""
    if limit.ndim == 0 and white.dtype.char in WHOLE and black.dtype.char == white.dtype.char:
        return np.asarray(cv2.subtract(white, black) < limit_of_kind(limit, white.dtype))
    return np.asarray(np.subtract(white, black, dtype=np.float32) < limit)


def mark(reasons: NDArray[np.uint8], reason: PixelReason, where: BoolArray) -> None:
    """Set the reason of some pixels, whatever it was."""
    np.copyto(reasons, np.uint8(reason), where=where)
