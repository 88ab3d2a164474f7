"""Whether left and right of the projector's picture are left and right of the camera's.

A surface that both devices see from its front keeps them: the map from camera to projector has a positive Jacobian
wherever it is smooth, whatever the surface's shape and wherever the devices stand. Only a mirror exchanges them.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.arrays import BoolArray, Float32Array
from calibration.errors import CalibrationError
from calibration.structured_light.correspondence import Correspondence, PixelReason

_SMOOTH = 4.0
"""Times the median step from pixel to pixel: beyond, the surface ends."""
_AROUND = 2
"""Times the distance of what is compared: half the width of the surroundings that vote on a pixel."""
_MOSTLY, _LEAST_AROUND, _LEAST_PLACES = 0.9, 0.3, 0.5
"""Of the votes, and of the surroundings that vote; and of their area, smaller parts are noise."""
_LEAST_TELLING = 100
"""Pixels that tell; fewer may be wrong codes."""
_MIRRORED = 0.5
"""Of the pixels that tell."""
_LEAST_STEP_PX = 1.0
"""Of the projector, from one compared camera pixel to the next: three times what codes leave of a place at worst, so
that noise turns one sign in twenty where the camera's pixels are small."""


def turn_of(projector_xy_px: Float32Array, apart_px: int = 1) -> NDArray[np.int8]:
    """Tell whether each neighbourhood keeps its left and right.

    Parameters
    ----------
    projector_xy_px : (H, W, 2)
        Projector pixel of each camera pixel, NaN where there is none. [px]
    apart_px : int
        From a camera pixel to those that it is compared with, on its right and below. [px]

    Returns
    -------
    (H, W) int8
        Sign of the map's Jacobian on smooth surfaces: 1 where left and right are kept, -1 where they are exchanged, 0
        where none tells.
    """
    right, down = _steps(projector_xy_px, apart_px)
    steps = np.maximum(np.abs(right).max(axis=-1), np.abs(down).max(axis=-1))
    turn = right[..., 0] * down[..., 1] - right[..., 1] * down[..., 0]
    with np.errstate(invalid="ignore"):
        smooth = steps <= _SMOOTH * max(_usual(steps), 1.0)
    return np.asarray(np.where(smooth, np.sign(turn), 0), dtype=np.int8)


def _steps(xy: Float32Array, apart: int) -> tuple[Float32Array, Float32Array]:
    """(H, W, 2) differences to the pixels on the right, and below."""
    right, down = np.full_like(xy, np.nan), np.full_like(xy, np.nan)
    right[:, :-apart], down[:-apart] = xy[:, apart:] - xy[:, :-apart], xy[apart:] - xy[:-apart]
    return right, down


def _usual(steps: Float32Array) -> float:
    return float(np.nanmedian(steps)) if np.isfinite(steps).any() else 0.0


def _apart_px(xy: Float32Array) -> int:
    """How far camera pixels have to be apart for their places to differ by more than their noise."""
    apart = 1
    while apart < min(xy.shape[:2]) // 8 and _usual(np.abs(_steps(xy, apart)[0]).max(axis=-1)) < _LEAST_STEP_PX:
        apart *= 2
    return apart


def without_mirrored(correspondence: Correspondence) -> Correspondence:
    """Take away what is seen in a mirror: a glass door, a screen that is off; refuse a picture that is a mirror image.

    Parameters
    ----------
    correspondence : Correspondence
        (H, W) of both columns and rows; of one axis alone nothing is told, and it is given back.

    Returns
    -------
    Correspondence
        Places with left and right exchanged have reason MIRRORED.

    Raises
    ------
    CalibrationError
        One of the two pictures is mirrored.
    """
    xy = np.where(correspondence.valid[..., None], correspondence.projector_xy_px, np.float32(np.nan))
    apart_px = _apart_px(xy)
    turn = turn_of(xy, apart_px)
    _refuse_mirror_image(turn)
    places = _exchanged(turn, apart_px) & correspondence.valid
    if not places.any():
        return correspondence
    reason = np.where(places, np.uint8(PixelReason.MIRRORED), correspondence.reason)
    left = np.where(places[..., None], np.float32(np.nan), correspondence.projector_xy_px)
    return replace(correspondence, projector_xy_px=left, reason=reason)


def _exchanged(turn: NDArray[np.int8], apart_px: int) -> BoolArray:
    """(H, W) surroundings in which nearly all that tell say that left and right are exchanged, and their borders."""
    size = 2 * (_AROUND * apart_px) + 1
    kept, exchanged = _votes(turn, size)
    found = (exchanged > _MOSTLY * (kept + exchanged)) & (exchanged > _LEAST_AROUND * size**2)
    parts, label, figures, _ = cv2.connectedComponentsWithStats(found.astype(np.uint8))
    large = [k for k in range(1, parts) if figures[k, cv2.CC_STAT_AREA] >= _LEAST_PLACES * size**2]
    if not large:
        return np.zeros(turn.shape, dtype=bool)
    near_kept, near_exchanged = _votes(turn, 2 * apart_px + 1)
    grown = _dilated(np.isin(label, large), size) & (near_exchanged > near_kept)
    return _dilated(grown, 2 * apart_px + 1)


def _votes(turn: NDArray[np.int8], size: int) -> tuple[Float32Array, Float32Array]:
    """(H, W) how many pixels of the square around each say that left and right are kept, and how many the other."""
    kept, exchanged = (
        np.asarray(cv2.boxFilter((turn == sign).astype(np.float32), -1, (size, size), normalize=False))
        for sign in (1, -1)
    )
    return kept, exchanged


def _dilated(places: BoolArray, size: int) -> BoolArray:
    return np.asarray(cv2.dilate(places.astype(np.uint8), np.ones((size, size), np.uint8)) > 0)


def _refuse_mirror_image(turn: NDArray[np.int8]) -> None:
    telling = int(np.count_nonzero(turn))
    exchanged = int((turn < 0).sum())
    if telling < _LEAST_TELLING or exchanged <= _MIRRORED * telling:
        return
    share = 100 * exchanged / telling
    raise CalibrationError(
        f"left and right are exchanged between the projector's picture and the camera's in {share:.0f} % of the "
        f"{telling} pixels that tell (limit {100 * _MIRRORED:g} %): one of the pictures is mirrored; turn off rear "
        "projection or mirroring in the projector's menu and in the camera's settings, and photograph no mirror image"
    )
