"""Pieces of surface: camera pixels that hang together, cut where the distance jumps."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from calibration.arrays import BoolArray, FloatArray, IntArray
from calibration.surfaces.point_map import PointMap

_STEEPEST = 5.7
"""Tangent of 80 degrees: a surface that turns further away from the camera is taken for a step in depth."""
_SIGMAS = 5.0
"""Of the difference of two neighbours' distances, beyond which it is no noise."""


def pieces_of(points: PointMap, chosen: BoolArray, least_pixels: int) -> IntArray:
    """Number the pieces of surface that chosen pixels see.

    Two neighbours see one piece if their distances differ by no more than a surface at 80 degrees to the ray, or five
    standard deviations, let them. Nothing bridges a step in depth.

    Parameters
    ----------
    points : PointMap
        Of at least the chosen pixels.
    chosen : (H, W) bool
        Pixels to number.
    least_pixels : int
        Smaller pieces are left out.

    Returns
    -------
    (H, W)
        0, 1, … of each pixel's piece, the largest first; -1 for none.
    """
    chosen = chosen & points.known
    height, width = chosen.shape
    index = np.arange(height * width).reshape(height, width)
    edges = [
        np.stack([a[joined], b[joined]])
        for a, b, joined in (
            (index[:, :-1], index[:, 1:], _joined(points, chosen, axis=1)),
            (index[:-1], index[1:], _joined(points, chosen, axis=0)),
        )
    ]
    start, end = np.concatenate(edges, axis=1)
    graph = coo_array((np.ones(len(start)), (start, end)), shape=(index.size, index.size))
    number = connected_components(graph, directed=False)[1].reshape(height, width)
    return largest_first(np.where(chosen, number, -1), least_pixels)


def largest_first(label: IntArray, least_pixels: int) -> IntArray:
    """Number labels (H, W) anew by their size, without those of fewer pixels; -1 stays -1."""
    names, inverse, count = np.unique(label, return_inverse=True, return_counts=True)
    count[(names < 0) | (count < least_pixels)] = 0
    order = np.argsort(-count, kind="stable")
    rank = np.full(len(names), -1, dtype=np.int64)
    kept = order[: np.count_nonzero(count)]
    rank[kept] = np.arange(len(kept))
    return np.asarray(rank[inverse.reshape(label.shape)])


def _joined(points: PointMap, chosen: BoolArray, *, axis: int) -> BoolArray:
    """Neighbours along an axis that see one piece; one fewer along that axis."""
    (near, far), (noise, other) = _halves(points.distance_m, axis), _halves(points.sigma_m, axis)
    both = np.all(_halves(chosen, axis), axis=0)
    limit = most_between(np.fmin(near, far), points.metres_per_px, np.hypot(noise, other))
    with np.errstate(invalid="ignore"):
        return np.asarray(both & (np.abs(near - far) <= limit))


def most_between(distance_m: FloatArray, metres_per_px: float, sigma_m: FloatArray) -> FloatArray:
    """Return by how much the distances of neighbouring pixels of one surface may differ [m], as arrays broadcast."""
    return np.maximum(_STEEPEST * metres_per_px * distance_m, _SIGMAS * sigma_m)


def _halves(values: NDArray[Any], axis: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """All but the last, and all but the first, along an axis."""
    last = values.shape[axis]
    return np.take(values, range(last - 1), axis), np.take(values, range(1, last), axis)
