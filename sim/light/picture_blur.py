"""Blur of a projector's picture as a linear operator on its pixels, its width a function of place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sim.arrays import BoolArray, FloatArray

_REACH = 3.5
"""Standard deviations at which the blur is cut off: 0.05 % of the light lies beyond."""
_LEAST_VARIANCE_PX2 = 1e-3
_ORDERS_BEYOND = 5
"""Orders of the recurrence above 1.4 times the last weight's: the weights are then the Bessel functions' to 1e-10 for
standard deviations up to 20 px."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PictureBlur:
    """The blurred picture at each chosen pixel; what is not chosen, and what is beyond the border, is dark.

    Along each axis the weights are the discrete Gaussian exp(-v) I_k(v), whose variance is v however small it is.

    References
    ----------
    T. Lindeberg, Scale-space for discrete signals, IEEE Trans. PAMI 12(3), 1990.
    """

    variance_px2: FloatArray
    """(H, W, 2) of the blur along columns and rows."""
    chosen: BoolArray
    """(H W,) pixels of the operator's pictures, n of them."""

    def apply(self, p: FloatArray) -> FloatArray:
        """Return the blurred picture of (n,), or pictures of (n, K)."""
        return self._each(p, lambda picture: self._along(self._along(picture, 1), 0))

    def adjoint(self, c: FloatArray) -> FloatArray:
        """Return what the transposed operator makes of (n,) or (n, K)."""
        return self._each(c, lambda picture: self._back(self._back(picture, 0), 1))

    def _each(self, pictures: FloatArray, change: Callable[[FloatArray], FloatArray]) -> FloatArray:
        changed = [change(self._whole(each)).ravel()[self.chosen] for each in np.atleast_2d(pictures.T)]
        return np.asarray(np.stack(changed).reshape(pictures.T.shape).T)

    def _whole(self, p: FloatArray) -> FloatArray:
        whole = np.zeros(self.chosen.shape)
        whole[self.chosen] = p
        return whole.reshape(self.variance_px2.shape[:2])

    def _along(self, picture: FloatArray, axis: int) -> FloatArray:
        weights = self._weights[axis]
        result = weights[0] * picture
        for k in range(1, len(weights)):
            neighbours = np.zeros_like(picture)
            ahead, behind = _slices(axis, k)
            neighbours[behind] += picture[ahead]
            neighbours[ahead] += picture[behind]
            result += weights[k] * neighbours
        return np.asarray(result)

    def _back(self, picture: FloatArray, axis: int) -> FloatArray:
        weights = self._weights[axis]
        result = weights[0] * picture
        for k in range(1, len(weights)):
            weighted = weights[k] * picture
            ahead, behind = _slices(axis, k)
            result[ahead] += weighted[behind]
            result[behind] += weighted[ahead]
        return np.asarray(result)

    @cached_property
    def _weights(self) -> tuple[FloatArray, FloatArray]:
        """For rows (axis 0) and columns (axis 1): (r + 1, H, W) weights of neighbours at distance 0 ... r."""
        rows, columns = (_discrete_gaussian(np.maximum(self.variance_px2[..., k], _LEAST_VARIANCE_PX2)) for k in (1, 0))
        return rows, columns


def _discrete_gaussian(variance: FloatArray) -> FloatArray:
    """Weights of neighbours at distance 0 ... r, their sum over both sides 1.

    By the ratios I_k / I_(k-1) = 1 / (2 k / v + I_(k+1) / I_k), from orders beyond the last one downwards (stable).
    """
    reach = int(np.ceil(_REACH * np.sqrt(variance.max()))) + 1
    ratio = np.zeros_like(variance)
    weights = np.ones((reach + 1, *variance.shape))
    for k in range(reach * 7 // 5 + _ORDERS_BEYOND, 0, -1):
        ratio = variance / (2 * k + variance * ratio)
        if k <= reach:
            weights[k] = ratio
    weights = np.cumprod(weights, axis=0)
    return np.asarray(weights / (weights[0] + 2 * weights[1:].sum(axis=0)))


def _slices(axis: int, k: int) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    ahead, behind = slice(k, None), slice(None, -k)
    every = slice(None)
    return ((ahead, every), (behind, every)) if axis == 0 else ((every, ahead), (every, behind))
