"""Pixels that are wrong by themselves: bright without light, or dark with it."""

from __future__ import annotations

import cv2
import numpy as np

from rig.self_check.rig_under_test import FloatArray, RigUnderTest
from rig.self_check.rows import Measured, Row

_FRAMES = 8
_SIGMAS = 8.0
_LEAST_DN = 4.0
_DEAD = 0.5
"""Of the light of the pixels around."""
_LISTED = 50


def check_pixels(subject: RigUnderTest) -> Measured:
    """Hot pixels on black, dead pixels on white, each against the pixels around it."""
    black = np.mean([subject.photograph(0, "black") for _ in range(_FRAMES)], axis=0)
    over = black - _around(black)
    spread = 1.4826 * float(np.median(np.abs(over)))
    hot = over > max(_SIGMAS * spread, _LEAST_DN)
    light = subject.white - subject.offset_dn
    near = _around(light)
    dead = (light < _DEAD * near) & _inside(subject.lit)
    limits = subject.limits
    rows = (
        Row("hot pixels", 100 * float(hot.mean()), "% of all", limits.hot_percent,
            advice="lower gain, shorter exposures, a cooler camera; hot-pixel correction of the camera on"),
        Row("dead pixels", 100 * float(dead.mean()), "% of all", limits.hot_percent,
            advice="dust on the sensor or on a window; if they stay after cleaning, another camera"),
    )  # fmt: skip
    numbers = {
        "hot": int(hot.sum()),
        "dead": int(dead.sum()),
        "hot_yx": np.argwhere(hot)[:_LISTED].tolist(),
        "dead_yx": np.argwhere(dead)[:_LISTED].tolist(),
        "dark_level_dn": subject.offset_dn,
    }
    return Measured(rows, {}, numbers)


def _around(image: FloatArray) -> FloatArray:
    """Median of 5 x 5 pixels: one or two wrong ones do not change it."""
    return np.asarray(cv2.medianBlur(image.astype(np.float32), 5), dtype=np.float64)


def _inside(lit: np.ndarray) -> np.ndarray:
    """Where everything around is lit, small holes closed, so that borders are not taken for dead pixels."""
    closed = cv2.morphologyEx(lit.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((7, 7), np.uint8))
    return np.asarray(cv2.erode(closed, np.ones((9, 9), np.uint8), borderValue=0) > 0)
