"""Gloss of surfaces from photographs of known pictures: how much, how rough, and where they do not tell.

What a place that shines mirrors of lit patches, and what a lit patch that shines sends to places, is g per gloss over
matte reflectance. White was measured, so of a picture u the model, scaled to it, is off by

    y = Σ_r a_r x_r + e,    x_r = g_r·u - (g_r·1 / T₀·1) T₀·u ,

a_r = ρ_s / ρ of surface r. All are fitted together by least squares, the roughness of each among some. Standard
deviations are of photographs, and of parts of the picture, left out in turn: what else the model gets wrong is alike in
neighbouring places.

References
----------
B. Efron, The jackknife, the bootstrap and other resampling plans, SIAM 1982, chapter 3.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from calibration.arrays import FloatArray

_ROUNDS = 3
"""Over all surfaces, each taking the roughness that explains most beside the others'."""
_LEAST_PHOTOGRAPHS = 4
"""For a standard deviation."""
_PARTS = 12
"""Of the places: some for each wall of a room."""


@dataclass(frozen=True, eq=False, kw_only=True)
class GlossSeen:
    """What gloss would make of photographs; K of them, N places."""

    by_surface: NDArray[np.float32]
    """(R, A, K, N) x of each surface, of each roughness."""
    difference: FloatArray
    """(K, N) measured minus expected."""
    sigma: FloatArray
    """(K, N) by which differences count: of noise and of what else the model has wrong; infinite: not measured."""


@dataclass(frozen=True, eq=False, kw_only=True)
class FoundGloss:
    """Gloss of R surfaces, over their matte reflectance."""

    ratio: FloatArray
    """(R,) a."""
    sigma: FloatArray
    """(R,) of it; infinite where photographs tell nothing."""
    roughness: NDArray[np.intp]
    """(R,) number of the roughness that explains most."""
    least_roughness: NDArray[np.intp]
    """(R,) the least of those found with photographs left out in turn ..."""
    most_roughness: NDArray[np.intp]
    """(R,) ... and the most."""


@dataclass(frozen=True, eq=False)
class _Sums:
    """Normal equations of one group each: of all features with each other, and with what was measured."""

    products: FloatArray
    """(G, R A, R A)"""
    measured: FloatArray
    """(G, R A)"""

    def without(self, k: int | None) -> tuple[FloatArray, FloatArray]:
        products, measured = self.products.sum(axis=0), self.measured.sum(axis=0)
        return (products, measured) if k is None else (products - self.products[k], measured - self.measured[k])


def found_gloss(seen: GlossSeen) -> FoundGloss:
    """Return the gloss of surfaces that explains photographs best.

    Parameters
    ----------
    seen : GlossSeen

    Returns
    -------
    FoundGloss
    """
    shape, count = seen.by_surface.shape[:2], len(seen.difference)
    each = [_sums(seen, slice(k, k + 1), slice(None)) for k in range(count)]
    by_photograph = _together(each)
    ratio, chosen = _fitted(by_photograph, None, shape)
    told = np.diag(by_photograph.without(None)[0]).reshape(shape).max(axis=1) > 0
    ends = np.linspace(0, seen.difference.shape[1], _PARTS + 1).astype(int)
    parts = [_sums(seen, slice(None), slice(a, b)) for a, b in pairwise(ends)]
    if count < _LEAST_PHOTOGRAPHS:
        told = np.zeros_like(told)
    left = [_left_out(groups, shape) for groups in (by_photograph, _together(parts))] if count else []
    roughness = np.concatenate([chosen[None], *(numbers for _, numbers in left)])
    variance = np.sum([each for each, _ in left], axis=0)
    return FoundGloss(
        ratio=ratio,
        sigma=np.where(told, np.sqrt(variance), np.inf),
        roughness=chosen,
        least_roughness=roughness.min(axis=0),
        most_roughness=roughness.max(axis=0),
    )


def _left_out(sums: _Sums, shape: tuple[int, int]) -> tuple[FloatArray, NDArray[np.intp]]:
    """(R,) variance of a by groups left out in turn, and (G, R) the roughness each time."""
    count = len(sums.products)
    others = [_fitted(sums, k, shape) for k in range(count)]
    ratios, roughness = (np.stack(each) for each in zip(*others, strict=True))
    return (count - 1) / count * ((ratios - ratios.mean(axis=0)) ** 2).sum(axis=0), roughness


def _together(groups: list[tuple[FloatArray, FloatArray]]) -> _Sums:
    return _Sums(*(np.stack(each) for each in zip(*groups, strict=True)))


def _sums(seen: GlossSeen, photographs: slice, places: slice) -> tuple[FloatArray, FloatArray]:
    """Normal equations of some photographs at some places."""
    sigma = seen.sigma[photographs, places].ravel()
    flat = seen.by_surface[:, :, photographs, places].reshape(-1, len(sigma))
    known = np.isfinite(sigma)
    weight = np.where(known, 1 / np.where(known, sigma, 1.0), 0.0)
    difference = np.where(known, seen.difference[photographs, places].ravel(), 0.0)
    rows = np.asarray(flat * weight, dtype=np.float64)
    return rows @ rows.T, rows @ (difference * weight)


def _fitted(sums: _Sums, without: int | None, shape: tuple[int, int]) -> tuple[FloatArray, NDArray[np.intp]]:
    """(R,) a, and (R,) number of its roughness."""
    products, measured = sums.without(without)
    first = np.arange(shape[0]) * shape[1]
    chosen = np.zeros(shape[0], dtype=np.intp)
    for _ in range(_ROUNDS):
        for r in range(shape[0]):
            explained = []
            for a in range(shape[1]):
                chosen[r] = a
                index = first + chosen
                found = _solved(products[np.ix_(index, index)], measured[index])
                explained.append(float(found @ measured[index]))
            chosen[r] = int(np.argmax(explained))
    index = first + chosen
    return _solved(products[np.ix_(index, index)], measured[index]), chosen.copy()


def _solved(products: FloatArray, measured: FloatArray) -> FloatArray:
    """Least squares with no gloss below none: what would be negative is left out."""
    kept = np.diag(products) > 0
    found = np.zeros(len(measured))
    while kept.any():
        part = np.ix_(kept, kept)
        found[:] = 0.0
        found[kept] = np.linalg.lstsq(products[part], measured[kept], rcond=1e-10)[0]
        if (found >= 0).all():
            break
        kept &= found >= 0
    return np.maximum(found, 0.0)
