"""Pixels whose coordinates do not fit those of the pixels around."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.arrays import BoolArray, Float32Array
from calibration.structured_light.strips import for_each_strip

_REACH_PX = 2
_WINDOW_PX = 2 * _REACH_PX + 1
_ENOUGH_NEIGHBOURS, _LEAST_NEIGHBOURS = 13, 4
"""The median of 5 × 5 codes speaks for the place if more than half of them are valid; fewer than 4 valid ones, itself
included, are what chance leaves in the dark."""
_FEW = 0.1
"""Up to this share of pixels, the medians of single pixels cost less than that of a whole picture."""

_BEYOND_PX = 1e6
"""Further than any coordinate."""
_JUMPS = 3.0
"""Times the usual spread of 3 × 3 pixels, which is two steps."""
_BORDER_PX, _BORDER_SIGMA_PX = 2.0, 1.0
"""What a camera pixel beyond the projector's picture gets of it by blur has the coordinate of the picture's last
pixels: in the simulated rooms up to 2.5 px off."""

Coordinate = NDArray[Any]
"""(H, W) uint16 or float32; anything where not valid."""


def isolated(coordinates: Sequence[Coordinate], valid: BoolArray, limit: float) -> BoolArray:
    """Find pixels that are further than a limit from the median of the 5 × 5 around, or that stand alone.

    The median is taken over all that are valid there, so a pixel among invalid ones is judged by what little there is.

    Parameters
    ----------
    coordinates : sequence of (H, W) uint16 or float32
        Of each axis that is coded.
    valid : (H, W) bool
    limit : float
        In the unit of the coordinates; infinite: only pixels without neighbours count.

    Returns
    -------
    (H, W) bool
        Of meaning where valid.
    """
    found = np.empty(valid.shape, dtype=bool)

    def strip(rows: slice) -> None:
        around = slice(max(rows.start - _REACH_PX, 0), rows.stop + _REACH_PX)
        inner = slice(rows.start - around.start, rows.stop - around.start)
        found[rows] = _isolated([each[around] for each in coordinates], valid[around], limit)[inner]

    for_each_strip(strip, valid.shape)
    return found


def _isolated(coordinates: Sequence[Coordinate], valid: BoolArray, limit: float) -> BoolArray:
    window = (_WINDOW_PX, _WINDOW_PX)
    count = cv2.boxFilter(valid.view(np.uint8), -1, window, normalize=False, borderType=cv2.BORDER_CONSTANT)
    judged = valid & (count >= _ENOUGH_NEIGHBOURS)
    far = np.asarray(count < _LEAST_NEIGHBOURS)
    square = np.ones(window, np.uint8)
    if not np.isfinite(limit):
        return far
    for each in coordinates:
        low, high = _filled(each, valid)
        spread = cv2.subtract(cv2.dilate(low, square), cv2.erode(high, square))
        open_ = judged & (spread > each.dtype.type(limit))  # of whole numbers, the whole part decides
        if open_.any():
            far |= open_ & (_distance(low, high, open_) > limit)
    return far


def beside_jumps(coordinate_px: Float32Array, least_px: float) -> BoolArray:
    """Find pixels beside which a surface ends: by blur they see light of both sides, and a code of neither.

    Parameters
    ----------
    coordinate_px : (H, W)
        Of one axis; NaN where not valid.
    least_px : float
        Smallest jump that counts, where six times the usual step from pixel to pixel is less.

    Returns
    -------
    (H, W) bool
    """
    valid = np.isfinite(coordinate_px)
    low, high = _filled(coordinate_px, valid)
    square = np.ones((3, 3), np.uint8)
    spread = np.where(valid, cv2.dilate(low, square) - cv2.erode(high, square), 0)
    usual = float(np.median(spread[valid])) if valid.any() else 0.0
    return np.asarray(spread > max(least_px, _JUMPS * usual))


def _filled(coordinate: Coordinate, valid: BoolArray) -> tuple[Coordinate, Coordinate]:
    """Coordinates with the lowest, and with the highest number where not valid."""
    if valid.all():
        return coordinate, coordinate
    if coordinate.dtype == np.uint16:
        ones = np.negative(valid.view(np.uint8).astype(np.uint16))
        return coordinate & ones, coordinate | ~ones
    low, high = coordinate.copy(), coordinate.copy()
    for filled, number in ((low, -_BEYOND_PX), (high, _BEYOND_PX)):
        np.copyto(filled, np.float32(number), where=~valid)
    return low, high


def _distance(low: Coordinate, high: Coordinate, open_: BoolArray) -> NDArray[np.float32]:
    """(H, W) distance from the nearer of two medians, one of what is filled low, one high; 0 where not open.

    Inside of what is valid both are the true one.
    """
    distance = np.zeros(open_.shape, dtype=np.float32)
    rows, columns = np.nonzero(open_)
    own = low[rows, columns].astype(np.float32)
    medians = (_medians(each, rows, columns) for each in (low, high))
    distance[rows, columns] = np.minimum(*(np.abs(own - median) for median in medians))
    return distance


def _medians(picture: Coordinate, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> NDArray[np.float32]:
    """(N,) medians of 5 × 5 around some pixels; the border goes on as its last pixel."""
    if len(rows) > _FEW * picture.size:
        return np.asarray(cv2.medianBlur(picture, _WINDOW_PX)[rows, columns], dtype=np.float32)
    wide = np.pad(picture, _REACH_PX, mode="edge")
    shifts = [(down, right) for down in range(_WINDOW_PX) for right in range(_WINDOW_PX)]
    around = np.stack([wide[rows + down, columns + right] for down, right in shifts], axis=1)
    middle = _WINDOW_PX**2 // 2
    return np.asarray(np.partition(around, middle, axis=1)[:, middle], dtype=np.float32)


def widen_at_border(sigma_px: Float32Array, xy_px: Float32Array, projector_shape: tuple[int, int]) -> None:
    """Let standard deviations say that pixels which see the border of the projector's picture may lie beyond it.

    Parameters
    ----------
    sigma_px, xy_px : (H, W, 2)
        Of column and row; the first is changed. [px]
    projector_shape : (height, width)
    """
    for k, size_px in enumerate(reversed(projector_shape)):
        widen_axis_at_border(sigma_px[..., k], xy_px[..., k], size_px)


def widen_axis_at_border(sigma_px: Float32Array, coordinate_px: Float32Array, size_px: int) -> None:
    """Do the same for one axis, of which the projector has so many pixels."""
    with np.errstate(invalid="ignore"):
        near = np.abs(coordinate_px - np.float32((size_px - 1) / 2)) > (size_px - 1) / 2 - _BORDER_PX
    sigma_px[near] = np.hypot(sigma_px[near], np.float32(_BORDER_SIGMA_PX))
