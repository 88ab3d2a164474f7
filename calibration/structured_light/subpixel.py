"""Integer codes to sub-pixel projector coordinates."""

from __future__ import annotations

import cv2
import numpy as np

from calibration.arrays import BoolArray, Float32Array
from calibration.structured_light.correspondence import Correspondence

_FILLED_SHARE = 0.7
"""Of a window: beside a border of what is valid, a plane would be carried too far."""
_MOST_VARIANCE_PX2 = 0.16
"""Of the codes about their plane: rounding alone has 1/12; a wrong side of an edge in the window adds much more."""
_MOST_CHANGE_PX = 0.9
"""Rounding moves a coordinate by up to 0.5; decoding puts a pixel on a border half a pixel off, at most."""


def refine_subpixel(correspondence: Correspondence, window_px: int = 9) -> Correspondence:
    """Turn whole codes into sub-pixel coordinates by local plane fits over a window.

    A code is the true coordinate rounded, so a plane through some eighty of them is good to a few hundredths
    of a pixel on a smooth surface. Where the window holds more than one surface the fit does not describe
    the codes (its residual is above that of rounding): there smaller windows are tried, and in the end the
    code is kept.

    Parameters
    ----------
    correspondence : Correspondence
        With whole codes.
    window_px : int
        Side of the window, odd. [camera px]

    Returns
    -------
    Correspondence
        The same pixels are valid.
    """
    valid = correspondence.valid
    xy = np.where(valid[..., None], correspondence.projector_xy_px, 0).astype(np.float64)
    refined = np.where(valid[..., None], correspondence.projector_xy_px, np.nan).astype(np.float32)
    open_ = valid.copy()
    for size in (window_px, max(3, window_px // 2 | 1)):
        fit, good = _plane_fit(xy, valid, size)
        take = open_ & good
        refined[take] = fit[take]
        open_ &= ~take
    return Correspondence(refined, correspondence.reason, correspondence.projector_shape)


def _plane_fit(xy: np.ndarray, valid: BoolArray, size: int) -> tuple[Float32Array, BoolArray]:
    """(H, W, 2) value at the centre of the plane fitted in each window, and whether it describes the window.

    Sums over the window by box filters; the moments are central, from sums of absolute coordinates.
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
    fit = np.empty((*valid.shape, 2), dtype=np.float32)
    good = n >= _FILLED_SHARE * size**2
    for k in (0, 1):
        c = xy[..., k]
        mc = total(v * c) / n
        sxc, syc = total(v * x * c) / n - mx * mc, total(v * y * c) / n - my * mc
        a, b = (syy * sxc - sxy * syc) / determinant, (sxx * syc - sxy * sxc) / determinant
        fit[..., k] = mc + a * (x - mx) + b * (y - my)
        variance = total(v * c * c) / n - mc**2 - a * sxc - b * syc
        good &= (variance < _MOST_VARIANCE_PX2) & (np.abs(fit[..., k] - c) < _MOST_CHANGE_PX)
    return fit, good
