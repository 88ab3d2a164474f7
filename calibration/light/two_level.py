"""What a camera pixel sees of a picture of black and white squares, through a Gaussian blur: a closed form.

A checker is a product of a row and a column of ±1, so is its blurred picture, and a blurred step is the error function:
no picture need be blurred to know what a pixel is lit with.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import erf

from calibration.arrays import Codes, FloatArray
from calibration.errors import CalibrationError

_EDGES = 2
"""Nearest edges on each side that reach a pixel: with checks of 4 blurs or more the third does not."""
_REACH = 7.0
"""Standard deviations from an edge at which its blur is gone: 1e-12. Wide stripes have most pixels beyond."""
_SQRT_HALF, _SQRT_2_PI = np.sqrt(0.5), np.sqrt(2 * np.pi)


@dataclass(frozen=True, eq=False, kw_only=True)
class Footprint:
    """What each of N camera pixels sees of the projector picture: a Gaussian, its axes those of the picture."""

    xy_px: FloatArray
    """(N, 2) its centre."""
    variance_px2: FloatArray
    """(N, 2) along columns and rows."""


@dataclass(frozen=True, eq=False)
class TwoLevelPicture:
    """A picture of black and white that is the product of a row and a column of ±1: checkers, stripes."""

    column: FloatArray
    """(width,) ±1."""
    row: FloatArray
    """(height,) ±1; white where the product is 1."""


def two_level(codes: Codes) -> TwoLevelPicture:
    """Return a picture of codes 0 and 255 as a row and a column of ±1.

    Raises
    ------
    CalibrationError
        If it has other codes, or is no product.
    """
    signs = np.where(codes > codes.max() / 2, 1.0, -1.0)
    picture = TwoLevelPicture(signs[0] * signs[0, 0], signs[:, 0].copy())
    if not np.isin(codes, (0, 255)).all() or not np.array_equal(np.outer(picture.row, picture.column), signs):
        raise CalibrationError("this picture is no checker and no stripes: its blur has no closed form; give checkers")
    return picture


def white_share(seen: Footprint, projector_shape: tuple[int, int]) -> FloatArray:
    """Return (…,) how much of a white picture pixels see: 1 but for those at its border; 0 where they see nothing."""
    xy = np.nan_to_num(seen.xy_px.reshape(-1, 2), nan=-1e6)
    variance = np.nan_to_num(seen.variance_px2.reshape(-1, 2), nan=1.0)
    height, width = projector_shape
    along = [blurred_steps(np.ones(n), xy[:, k], variance[:, k])[0] for k, n in enumerate((width, height))]
    return np.asarray((along[0] * along[1]).reshape(seen.xy_px.shape[:-1]))


def blurred_steps(signs: FloatArray, x: FloatArray, variance: FloatArray, order: int = 0) -> FloatArray:
    """Return (1 + order, N) a row of ±1, dark (0) outside, after a Gaussian blur, and its derivatives along the row.

    Parameters
    ----------
    signs : (n,)
        Value of each pixel; the first reaches from -0.5 to 0.5.
    x : (N,)
        Where it is wanted. [px]
    variance : (N,)
        Of the blur. [px²]
    order : int
        Of the highest derivative, at most 2.
    """
    padded = np.concatenate([[0.0], signs, [0.0]])
    at = np.flatnonzero(np.diff(padded))
    edges, jumps = at - 0.5, np.diff(padded)[at]
    first = np.searchsorted(edges, x, side="right")
    result = np.zeros((order + 1, len(x)))
    result[0] = padded[np.clip(np.floor(x + 0.5).astype(np.intp), -1, len(signs)) + 1]
    sigma = np.sqrt(variance)
    for k in range(-_EDGES, _EDGES):
        which = np.clip(first + k, 0, len(edges) - 1)
        distance = x - edges[which]
        near = np.flatnonzero((which == first + k) & (np.abs(distance) < _REACH * sigma))
        t, jump = distance[near] / sigma[near], jumps[which[near]]
        result[0, near] += jump * 0.5 * (erf(t * _SQRT_HALF) - np.where(t >= 0, 1.0, -1.0))
        if order:
            bell = jump * np.exp(-0.5 * t * t) / (_SQRT_2_PI * sigma[near])
            result[1, near] += bell
        if order > 1:
            result[2, near] -= t / sigma[near] * bell
    return result


def lit_share(picture: TwoLevelPicture, seen: Footprint) -> FloatArray:
    """Return (N,) share of white's direct light that pixels get of a picture."""
    (x, y), (vx, vy) = seen.xy_px.T, seen.variance_px2.T
    inside = blurred_steps(np.ones_like(picture.column), x, vx)[0] * blurred_steps(np.ones_like(picture.row), y, vy)[0]
    pattern = blurred_steps(picture.column, x, vx)[0] * blurred_steps(picture.row, y, vy)[0]
    return np.asarray(0.5 * (inside + pattern))


def shares_and_slopes(pictures: Sequence[TwoLevelPicture], seen: Footprint, order: int = 1) -> FloatArray:
    """Return (1 + 2 order, K, N) the share of white that pixels get of K pictures, well inside of them, and its slopes.

    After the share come its derivatives along columns and along rows; with order 2 also those by the two variances.
    """
    (x, y), (vx, vy) = seen.xy_px.T, seen.variance_px2.T
    c = _derivatives([picture.column for picture in pictures], x, vx, order)
    r = _derivatives([picture.row for picture in pictures], y, vy, order)
    found = np.empty((1 + 2 * order, len(pictures), len(x)))
    np.multiply(c[0], r[0], out=found[0])
    for k in range(1, order + 1):
        # The variance of a Gaussian is its time in the heat equation: ∂s/∂v = ½ ∂²s/∂x².
        np.multiply(c[k], r[0], out=found[2 * k - 1])
        np.multiply(c[0], r[k], out=found[2 * k])
    found[:3] *= 0.5
    found[3:] *= 0.25
    found[0] += 0.5
    return found


def _derivatives(signs: Sequence[FloatArray], x: FloatArray, variance: FloatArray, order: int) -> list[FloatArray]:
    """(K, N) blurred rows of ±1 and their derivatives up to an order; equal rows are computed once."""
    different, which = np.unique(signs, axis=0, return_inverse=True)
    found = [blurred_steps(each, x, variance, order) for each in different]
    return [np.stack([each[k] for each in found])[which] for k in range(order + 1)]
