"""Integer codes to sub-pixel projector coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import cv2
import numpy as np

from calibration.arrays import BoolArray, Float32Array
from calibration.structured_light.correspondence import ROUNDING_PX, Correspondence
from calibration.structured_light.neighbours import widen_at_border

_FILLED_SHARE = 0.7
"""Of a window: beside a border of what is valid, a plane would be carried too far."""
_SOME_SHARE, _CENTRED = 0.4, 0.1
"""The same where what is missing is all around, as between the stripes of an XOR code: then nothing is carried far. The
mean of what is valid lies within 0.3 of its standard deviation from the centre; beside a border it is 1.7 and more."""
_MOST_VARIANCE_PX2 = 0.16
"""Of the codes about their plane: rounding alone has 1/12; a wrong side of an edge in the window adds much more."""
_MOST_CHANGE_PX = 0.9
"""Rounding moves a coordinate by up to 0.5; decoding puts a pixel on a border half a pixel off, at most."""
_LEAST_SIGMA_PX = 0.01
"""What is left of a bent surface and a lens in a window of 9 pixels; in the simulated rooms less."""
_TABLE_SIZE, _WAVES = 256, 8
"""Slopes that are told apart, and waves of the rounding error: further ones add under 2 % of its variance."""
_SLOPE_SIGMA = 0.02
"""By which rounding changes the slope that is found in a window."""
_MOST_WHOLE = 0.5
"""Share of whole or half coordinates above which a map is one of whole codes; of finer ones hardly any are."""


WINDOW_PX = 9
"""Side of the window over which codes are refined. [camera px]"""
WINDOW_VARIANCE_PX2 = (WINDOW_PX**2 - 1) / 12
"""Variance of that window along each axis. [px² of the camera]"""


def refine_subpixel(correspondence: Correspondence, window_px: int = WINDOW_PX) -> Correspondence:
    """Turn whole codes into sub-pixel coordinates by local plane fits over a window.

    A code is the true coordinate rounded, so a plane through some eighty of them is good to a few hundredths
    of a pixel on a smooth surface. Where the window holds more than one surface the fit does not describe
    the codes (its residual is above that of rounding): there smaller windows are tried, and in the end the
    code is kept.

    Parameters
    ----------
    correspondence : Correspondence
        With whole codes; one whose coordinates are finer already is returned as it is.
    window_px : int
        Side of the window, odd. [camera px]

    Returns
    -------
    Correspondence
        The same pixels are valid.
    """
    valid = correspondence.valid
    if not _is_whole(correspondence.projector_xy_px[valid]):
        return correspondence
    xy = np.where(valid[..., None], correspondence.projector_xy_px, 0).astype(np.float64)
    coded = [axis for axis in (0, 1) if np.isfinite(xy[..., axis]).all()]
    refined = np.where(valid[..., None], correspondence.projector_xy_px, np.nan).astype(np.float32)
    known = correspondence.sigma_px
    sigma = np.full(refined.shape, ROUNDING_PX, dtype=np.float32) if known is None else known.copy()
    open_ = valid.copy()
    for size in (window_px, max(3, window_px // 2 | 1)):
        fit, sigma_of_fit, good = _plane_fit(xy, valid, size, coded)
        take = open_ & good
        refined[take], sigma[take] = fit[take], sigma_of_fit[take]
        open_ &= ~take
    widen_at_border(sigma, refined, correspondence.projector_shape)
    return Correspondence(refined, correspondence.reason, correspondence.projector_shape, sigma)


def _is_whole(xy_px: Float32Array) -> bool:
    """Tell whether most coordinates are whole or halves; those of an axis that was not coded say nothing."""
    twice = 2 * xy_px[np.isfinite(xy_px)]
    return not len(twice) or float(np.mean(twice == np.rint(twice))) > _MOST_WHOLE


def _plane_fit(
    xy: np.ndarray, valid: BoolArray, size: int, coded: Sequence[int]
) -> tuple[Float32Array, Float32Array, BoolArray]:
    """(H, W, 2) value at the centre of the plane fitted in each window, its standard deviation, and whether it fits.

    NaN for an axis that was not coded. Sums over the window by box filters; the moments are central, from sums of
    absolute coordinates.
    """
    height, width = valid.shape
    x = np.broadcast_to(np.arange(width, dtype=np.float64), valid.shape)
    y = np.broadcast_to(np.arange(height, dtype=np.float64)[:, None], valid.shape)
    v = valid.astype(np.float64)

    def total(image: np.ndarray) -> np.ndarray:
        return np.asarray(
            cv2.boxFilter(image, cv2.CV_64F, (size, size), normalize=False, borderType=cv2.BORDER_CONSTANT)
        )

    n = np.maximum(total(v), 1e-9)
    mx, my = total(v * x) / n, total(v * y) / n
    sxx, syy, sxy = (
        total(v * a * b) / n - ma * mb for a, b, ma, mb in ((x, x, mx, mx), (y, y, my, my), (x, y, mx, my))
    )
    determinant = np.maximum(sxx * syy - sxy**2, 1e-9)
    off_centre = (syy * (x - mx) ** 2 - 2 * sxy * (x - mx) * (y - my) + sxx * (y - my) ** 2) / determinant
    off_centre = np.maximum(off_centre, 0)  # rounding makes it less where few pixels lie in one line
    fit, sigma = (np.full((*valid.shape, 2), np.nan, dtype=np.float32) for _ in range(2))
    good = (n >= _FILLED_SHARE * size**2) | ((n >= _SOME_SHARE * size**2) & (off_centre < _CENTRED))
    for k in coded:
        c = xy[..., k]
        mc = total(v * c) / n
        sxc, syc = total(v * x * c) / n - mx * mc, total(v * y * c) / n - my * mc
        a, b = (syy * sxc - sxy * syc) / determinant, (sxx * syc - sxy * sxc) / determinant
        fit[..., k] = mc + a * (x - mx) + b * (y - my)
        variance = total(v * c * c) / n - mc**2 - a * sxc - b * syc
        noise = np.maximum(variance - ROUNDING_PX**2, 0) / n
        sigma[..., k] = np.sqrt((_rounding_variance(a, b, size) + noise) * (1 + off_centre) + _LEAST_SIGMA_PX**2)
        good &= (variance < _MOST_VARIANCE_PX2) & (np.abs(fit[..., k] - c) < _MOST_CHANGE_PX)
    return fit, sigma, good


def _rounding_variance(right: np.ndarray, down: np.ndarray, size: int) -> np.ndarray:
    """Variance that rounding leaves of the mean over a window, for codes that rise so much from pixel to pixel."""
    table, scale = _rounding_table(size), _TABLE_SIZE
    x, y = ((slope - np.floor(slope)).astype(np.float32) * np.float32(scale) for slope in (right, down))
    return np.asarray(cv2.remap(table, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), dtype=np.float64)


@cache
def _rounding_table(size: int) -> Float32Array:
    """Variance by the slopes down and right, whose whole parts make no difference.

    The error of rounding is a sum of waves with 1, 2, 3 … periods a code; a window leaves of each wave what it leaves
    of its frequency. Codes that rise along one axis of the camera only, by whole shares of a pixel, are rounded alike
    all over the window: there averaging helps little.
    """
    slope = np.arange(_TABLE_SIZE + 1) / _TABLE_SIZE
    table = np.zeros((len(slope), len(slope)))
    for wave in range(1, _WAVES + 1):
        angle = np.pi * wave * slope
        safe = np.where(np.abs(np.sin(angle)) > 1e-9, np.sin(angle), 1.0)
        left = np.where(np.abs(np.sin(angle)) > 1e-9, np.sin(size * angle) / (size * safe), 1.0) ** 2
        table += left[:, None] * left[None, :] / (2 * np.pi**2 * wave**2)
    blurred = cv2.GaussianBlur(np.tile(table[:-1, :-1], (3, 3)), (0, 0), _SLOPE_SIGMA * _TABLE_SIZE)
    one_period = slice(_TABLE_SIZE, 2 * _TABLE_SIZE + 1)
    return np.asarray(blurred[one_period, one_period], dtype=np.float32)
