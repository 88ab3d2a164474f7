"""Corners of a chessboard one by one: where dark and bright squares meet crosswise."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.arrays import FloatArray

OFF_SQUARES = 0.25
"""Of a square, by which a corner may be off a flat board without distortion: a lens bends a board by a tenth."""
_FLAT_DN, _TWICE = 4.0, 1.5
"""Of a ring about a corner: its least standard deviation, and by what its two waves have to lead all others."""


def corners_near(shown: NDArray[np.uint8], expected: FloatArray, square_px: float) -> FloatArray:
    """Look for corners near places.

    Parameters
    ----------
    shown : (H, W) uint8
    expected : (N, 2)
        Where they may be. [px]
    square_px : float
        Side of a square.

    Returns
    -------
    (N, 2)
        NaN where there is none.
    """
    half = int(np.clip(0.3 * square_px, 2, 25))
    height, width = shown.shape
    result = np.full_like(expected, np.nan)
    inside = ((expected > 2 * half) & (expected < np.array([width, height]) - 2 * half - 1)).all(axis=1)
    if not inside.any():
        return result
    start = np.ascontiguousarray(expected[inside].astype(np.float32).reshape(-1, 1, 2))
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-3)
    found = np.asarray(
        cv2.cornerSubPix(shown, start, winSize=(half, half), zeroZone=(-1, -1), criteria=criteria), np.float64
    ).reshape(-1, 2)
    near = np.linalg.norm(found - expected[inside], axis=1) < OFF_SQUARES * square_px
    good = near & np.array([_is_saddle(shown, place, half) for place in found])
    result[np.flatnonzero(inside)[good]] = found[good]
    return result


def _is_saddle(shown: NDArray[np.uint8], place: FloatArray, half: int) -> bool:
    """Whether a ring about a place is dark, bright, dark and bright again."""
    angle = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    x, y = np.rint(place[:, None] + 0.8 * half * np.stack([np.cos(angle), np.sin(angle)])).astype(int)
    height, width = shown.shape
    ring = shown[y.clip(0, height - 1), x.clip(0, width - 1)].astype(np.float64)
    wave = np.abs(np.fft.rfft(ring))
    return bool(ring.std() > _FLAT_DN and wave[2] > _TWICE * np.delete(wave, [0, 2])[:6].max())
