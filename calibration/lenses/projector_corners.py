"""Which projector pixel lights a board's corner: read off around it, from structured light on the board.

D. Moreno and G. Taubin, Simple, accurate, and robust projector-camera calibration, 3DIMPVT 2012, with a quadratic in
the place of their local homography, which also gives how the reading moves with the corner.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.arrays import BoolArray, FloatArray
from calibration.structured_light.correspondence import Correspondence

_SHARE_OF_SQUARE = 0.7
"""Half of the window's side: whole squares of both colours around a corner lie in it."""
_SMALLEST_PX, _LARGEST_PX = 6, 40
_LEAST_PIXELS = 40
"""Valid, in the window: ten for each of the fit's unknowns would be 60; 40 still leave a tenth of a code's rounding."""
_MOST_PX = 1.5
"""From the fit: a code further off is wrong; rounding moves it by 0.5 at most, half a pixel more on a border."""
_LARGEST_MISFIT_PX = 0.8
"""RMS: what rounding leaves is 0.29; the board has an edge in the window, or the codes are noise."""


@dataclass(frozen=True, eq=False)
class ProjectorCorners:
    """Projector pixels of corners; NaN where there are none."""

    xy_px: FloatArray
    """(N, 2)"""
    by_camera: FloatArray
    """(N, 2, 2) how they move with the camera's pixel."""
    there: BoolArray
    """(N,)"""


def projector_corners(found: Correspondence, camera_xy_px: FloatArray, square_px: float) -> ProjectorCorners:
    """Read the projector's pixel at each corner.

    Parameters
    ----------
    found : Correspondence
        Whole or refined codes.
    camera_xy_px : (N, 2)
        Corners. [camera px]
    square_px : float
        Distance of neighbouring corners. [camera px]

    Returns
    -------
    ProjectorCorners
    """
    half = int(np.clip(_SHARE_OF_SQUARE * square_px, _SMALLEST_PX, _LARGEST_PX))
    xy = np.full((len(camera_xy_px), 2), np.nan)
    slopes = np.zeros((len(camera_xy_px), 2, 2))
    valid = found.valid
    for k, corner in enumerate(camera_xy_px):
        fit = _read_at(corner, half, found, valid)
        if fit is not None:
            xy[k], slopes[k] = fit
    return ProjectorCorners(xy, slopes, np.isfinite(xy).all(axis=1))


def _read_at(
    corner: FloatArray, half: int, found: Correspondence, valid: BoolArray
) -> tuple[FloatArray, FloatArray] | None:
    column, row = np.rint(corner).astype(int)
    top, left = max(row - half, 0), max(column - half, 0)
    window = valid[top : row + half + 1, left : column + half + 1]
    rows, columns = np.nonzero(window)
    if len(rows) < _LEAST_PIXELS:
        return None
    x, y = (columns + left - corner[0]) / half, (rows + top - corner[1]) / half
    if not _surrounds(x, y):
        return None
    codes = found.projector_xy_px[rows + top, columns + left].astype(np.float64)
    terms = np.column_stack([np.ones(len(x)), x, y, x * x, x * y, y * y])
    fit = _robust_fit(terms, codes)
    return None if fit is None else (fit[0], fit[1:3].T / half)


def _surrounds(x: FloatArray, y: FloatArray) -> bool:
    """Whether pixels lie on all sides of the corner: a reading is no guess beyond what was seen."""
    return bool(min((x > 0.2).sum(), (x < -0.2).sum(), (y > 0.2).sum(), (y < -0.2).sum()) >= _LEAST_PIXELS // 8)


def _robust_fit(terms: FloatArray, codes: FloatArray) -> FloatArray | None:
    """(6, 2) least squares without codes that are wrong; None when most are."""
    kept, fit = np.ones(len(codes), dtype=bool), _least_squares(terms, codes)
    for limit in (6 * _MOST_PX, 2 * _MOST_PX, _MOST_PX):
        off = np.abs(terms @ fit - codes).max(axis=1)
        kept = off < max(limit, float(np.median(off)))
        if kept.sum() < _LEAST_PIXELS:
            return None
        fit = _least_squares(terms[kept], codes[kept])
    misfit = float(np.sqrt(((terms[kept] @ fit - codes[kept]) ** 2).mean()))
    return fit if misfit < _LARGEST_MISFIT_PX and kept.mean() > 0.5 else None


def _least_squares(terms: FloatArray, codes: FloatArray) -> FloatArray:
    """(6, 2) by the normal equations: the terms are of order 1, and there are hundreds of such fits."""
    return np.asarray(np.linalg.solve(terms.T @ terms + 1e-9 * np.eye(terms.shape[1]), terms.T @ codes))
