"""Smooth light at single points in plain numpy: what the kernel's shading of pictures computes."""

from __future__ import annotations

import numpy as np

from sim.arrays import FloatArray, IntArray
from sim.picture.reconstruction import cross


def quadratic_values(coefficients: FloatArray, patch: IntArray, place: FloatArray) -> FloatArray:
    """Return (N,) values of biquadratics (P, 3, 3) at cell coordinates (N, 2) of patches (N,)."""
    weights = np.stack([(1 - place) ** 2, 2 * place * (1 - place), place**2], axis=-1)
    return np.asarray(np.einsum("nrc,nc,nr->n", coefficients[patch], weights[:, 0], weights[:, 1]))


def fan_values(corners: FloatArray, values: FloatArray, patch: IntArray, place: FloatArray) -> FloatArray:
    """Return (N,) values of fans of triangles at places (N, 2) about the centroids of patches (N,) [m]."""
    a, b = corners[patch], np.roll(corners, -1, axis=1)[patch]
    at_a, at_b = cross(place[:, None], b), cross(a, place[:, None])
    twice = cross(a, b)
    real = twice > 0
    at_a, at_b = (np.divide(part, twice, out=np.full_like(part, -np.inf), where=real) for part in (at_a, at_b))
    sector = np.minimum(at_a, at_b).argmax(axis=1)
    here = (np.arange(len(patch)), sector)
    first, second = values[patch, sector], values[patch, (sector + 1) % 4]
    return np.asarray(at_a[here] * first + at_b[here] * second + (1 - at_a[here] - at_b[here]) * values[patch, 4])
