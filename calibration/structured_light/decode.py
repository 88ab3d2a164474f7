"""Gray code frames to a correspondence map, with a reason for every pixel that has none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.arrays import BoolArray, Float32Array, Frame
from calibration.errors import CalibrationError
from calibration.structured_light.correspondence import Correspondence, PixelReason
from calibration.structured_light.gray import CodeName, bits_for, pattern_name, positions

_WINDOW_PX, _ENOUGH_NEIGHBOURS, _LEAST_NEIGHBOURS = 5, 13, 4
"""The median of 5 × 5 codes speaks for the place if more than half of them are valid; fewer than 4 valid ones, itself
included, are what chance leaves in the dark."""


def decode_gray(
    frames: Mapping[str, Frame],
    projector_shape: tuple[int, int],
    *,
    white: Frame | None = None,
    black: Frame | None = None,
    contrast_limit: float | NDArray[np.floating],
    bit_limit: float | NDArray[np.floating],
    saturation: float | None = None,
    code: CodeName = "gray",
    first_code: tuple[int, int] = (0, 0),
    isolation_px: float = 8.0,
) -> Correspondence:
    """Find which projector pixel each camera pixel sees, from frames of a Gray code.

    Parameters
    ----------
    frames : mapping of pattern name to (H, W)
        Gray code frames as :func:`~calibration.structured_light.gray.gray_code_patterns` names them. [dn]
        Without inverses a bit is compared with the mean of white and black.
    projector_shape : (height, width)
    white, black : (H, W), optional
        Full frames; without them the largest and smallest value of each pixel over all frames.
    contrast_limit, bit_limit : float or (H, W)
        Least white minus black, and least difference of a pattern and its inverse, in the frames' unit.
    saturation : float, optional
        Values from here on are clipped.
    code : {"gray", "long-run"}
    first_code : (column, row)
        Code that is shown at the projector's first pixel.
    isolation_px : float
        A code further than this from the median of its neighbours is ISOLATED.

    Returns
    -------
    Correspondence
        Whole projector pixels, halves on the border between two.

    Raises
    ------
    CalibrationError
        If frames are missing, or their shapes differ.
    """
    _refuse_unequal({**frames, "white": white, "black": black})
    bright = white if white is not None else _extreme(frames, np.maximum)
    dark = black if black is not None else _extreme(frames, np.minimum)
    threshold: Frame | None = None
    if not any(name.endswith("-inverse") for name in frames):
        threshold = (bright.astype(np.float32) + dark.astype(np.float32)) * np.float32(0.5)
    height, width = projector_shape
    column_bits = _Bits(code, "column", _bits_shown(frames, code, "column", bits_for(width + first_code[0])))
    row_bits = _Bits(code, "row", _bits_shown(frames, code, "row", bits_for(height + first_code[1])))
    column, weak_column = _decode_axis(frames, column_bits, bit_limit, threshold)
    row, weak_row = _decode_axis(frames, row_bits, bit_limit, threshold)
    xy = np.stack([column, row], axis=-1).astype(np.float32) - np.array(first_code, dtype=np.float32)
    reason = np.zeros(column.shape, dtype=np.uint8)
    outside = ((xy < 0) | (xy >= (width, height))).any(axis=-1)
    reason[outside] = PixelReason.OUT_OF_RANGE
    reason[weak_column | weak_row] = PixelReason.UNCERTAIN_BIT
    reason[bright.astype(np.float32) - dark < contrast_limit] = PixelReason.DARK
    if saturation is not None:
        clipped = _extreme(frames, np.maximum) >= saturation
        reason[clipped & (reason != PixelReason.DARK)] = PixelReason.SATURATED
    reason[(reason == 0) & isolated(xy, reason == 0, isolation_px)] = PixelReason.ISOLATED
    xy[reason != PixelReason.VALID] = np.nan
    return Correspondence(xy, reason, projector_shape)


def _refuse_unequal(frames: Mapping[str, Frame | None]) -> None:
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


def _extreme(frames: Mapping[str, Frame], choose: np.ufunc) -> Frame:
    values = iter(frames.values())
    result = next(values).copy()
    for frame in values:
        choose(result, frame, out=result)
    return result


@dataclass(frozen=True, slots=True)
class _Bits:
    """The pictures of one axis."""

    code: CodeName
    axis: str
    count: int

    @property
    def names(self) -> list[str]:
        """Names of the pictures, the most significant bit first."""
        return [pattern_name(self.code, self.axis, bit) for bit in reversed(range(self.count))]


def _decode_axis(
    frames: Mapping[str, Frame], bits: _Bits, bit_limit: float | NDArray[np.floating], threshold: Frame | None
) -> tuple[Float32Array, BoolArray]:
    """(H, W) position, and pixels that some bit leaves open.

    One open bit is no harm if both its values give neighbouring positions: the pixel lies on the border
    between them, and that border is its position.
    """
    names = bits.names
    missing = [name for name in names if name not in frames]
    if missing:
        raise CalibrationError(
            f"{bits.code} code of the {bits.axis}s: {len(missing)} of {bits.count} bits have no frame "
            f"({', '.join(missing)}); photograph them, or give the size of the area "
            "that the patterns were shown in"
        )
    word = np.zeros(frames[names[0]].shape, dtype=np.uint16)
    open_bits = np.zeros(word.shape, dtype=np.uint16)
    for name in names:
        lit, other = frames[name], frames.get(f"{name}-inverse", threshold)
        if other is None:
            raise CalibrationError(f"{name}-inverse has no frame, but other bits have theirs: photograph it")
        word <<= 1
        word |= lit > other
        open_bits <<= 1
        open_bits |= _difference(lit, other) < bit_limit
    table = positions(bits.code, bits.count)
    position, other_position = table[word].astype(np.float32), table[word ^ open_bits].astype(np.float32)
    several = (open_bits & (open_bits - 1)) != 0
    return (position + other_position) / 2, several | (np.abs(position - other_position) > 1)


def _bits_shown(frames: Mapping[str, Frame], code: CodeName, axis: str, needed: int) -> int:
    """Return the number of bits; the common Gray code may have been shown with more than the projector needs."""
    bits = needed
    while code == "gray" and pattern_name(code, axis, bits) in frames:
        bits += 1
    return bits


def _difference(lit: Frame, other: Frame) -> Frame:
    if lit.dtype in (np.uint8, np.uint16) and other.dtype == lit.dtype:
        return np.asarray(cv2.absdiff(lit, other))
    return np.asarray(np.abs(lit.astype(np.float32) - other))


def isolated(xy: Float32Array, valid: BoolArray, limit_px: float) -> BoolArray:
    """Find pixels whose code is further than the limit from the median of the 5 × 5 around, or that stand alone.

    The median is taken over all codes there, so a pixel among invalid ones is judged by what little there is.
    """
    filled = np.where(valid[..., None], xy, -1e4).astype(np.float32)
    far = np.zeros(valid.shape, dtype=bool)
    neighbours = cv2.boxFilter(
        valid.astype(np.float32), -1, (_WINDOW_PX, _WINDOW_PX), normalize=False, borderType=cv2.BORDER_CONSTANT
    )
    for k in (0, 1):
        # Two filters, one filled low and one filled high: inside a lit area both agree with the true median.
        low = cv2.medianBlur(np.ascontiguousarray(filled[..., k]), _WINDOW_PX)
        high = cv2.medianBlur(np.ascontiguousarray(np.where(valid, xy[..., k], 1e5).astype(np.float32)), _WINDOW_PX)
        distance = np.minimum(np.abs(filled[..., k] - low), np.abs(filled[..., k] - high))
        enough = neighbours >= _ENOUGH_NEIGHBOURS
        far |= enough & (distance > limit_px)
    return np.asarray(far | (neighbours < _LEAST_NEIGHBOURS))
