"""Pixels that are wrong by themselves: bright without light, or dark with it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from calibration.arrays import BoolArray, FloatArray, IntArray
from rig.records import Record, Verdict
from rig.self_check.results import PartResult
from rig.self_check.rig_under_test import RigUnderTest

_FRAMES = 8
"""That are averaged: noise of one frame does not make a pixel hot."""
_SIGMAS, _LEAST_DN = 8.0, 4.0
"""Above the pixels around, in standard deviations and digital numbers: chance gives none in a million."""
_DEAD = 0.5
"""Of the light of the pixels around."""
_LISTED = 50


@dataclass(frozen=True, kw_only=True, eq=False)
class WrongPixels(Record):
    """Pixels that are bright without light, or dark with it."""

    hot: int
    dead: int
    hot_yx: IntArray
    """(N, 2) row and column of the first fifty."""
    dead_yx: IntArray
    """(N, 2) row and column of the first fifty."""
    dark_level_dn: float


def check_pixels(tested: RigUnderTest) -> PartResult[WrongPixels]:
    """Hot pixels on black, dead pixels on white, each against the pixels around it."""
    black = np.mean([tested.photograph(0, "black") for _ in range(_FRAMES)], axis=0)
    over = black - _around(black)
    spread = 1.4826 * float(np.median(np.abs(over)))
    hot = over > max(_SIGMAS * spread, _LEAST_DN)
    light = tested.white - tested.offset_dn
    near = _around(light)
    dead = (light < _DEAD * near) & _inside(tested.lit)
    limits = tested.limits
    verdicts = (
        Verdict(
            what="hot pixels",
            value=100 * float(hot.mean()),
            limit=limits.hot_percent,
            unit="% of all",
            advice="lower gain, shorter exposures, a cooler camera; hot-pixel correction of the camera on",
        ),
        Verdict(
            what="dead pixels",
            value=100 * float(dead.mean()),
            limit=limits.hot_percent,
            unit="% of all",
            advice="dust on the sensor or on a window; if they stay after cleaning, another camera",
        ),
    )
    numbers = WrongPixels(
        hot=int(hot.sum()),
        dead=int(dead.sum()),
        hot_yx=np.argwhere(hot)[:_LISTED],
        dead_yx=np.argwhere(dead)[:_LISTED],
        dark_level_dn=tested.offset_dn,
    )
    return PartResult(verdicts=verdicts, numbers=numbers)


def _around(image: FloatArray) -> FloatArray:
    """Median of 5 x 5 pixels: one or two wrong ones do not change it."""
    return np.asarray(cv2.medianBlur(image.astype(np.float32), 5), dtype=np.float64)


def _inside(lit: BoolArray) -> BoolArray:
    """Where everything around is lit, small holes closed, so that borders are not taken for dead pixels."""
    closed = cv2.morphologyEx(lit.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((7, 7), np.uint8))
    return np.asarray(cv2.erode(closed, np.ones((9, 9), np.uint8), borderValue=0) > 0)
