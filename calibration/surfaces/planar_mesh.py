"""Triangles of a piece of the plane within outlines: a Delaunay mesh that keeps to them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial import Delaunay, QhullError, cKDTree

from calibration.arrays import BoolArray, FloatArray, IntArray

_ROUNDS = 6
"""Of halving the sides of outlines that the mesh does not have: each halves their length."""
_CUTS = 8
"""Rounds of cutting the sides of outlines: one where the wanted side is the same everywhere."""
_CLEAR = 0.6
"""Of the wanted side: points within are no nearer to an outline, so that no triangle beside it is thin."""
_LEAST_HEIGHT = 1e-3
"""Of a triangle's longest side: flatter ones have no area to speak of."""
SideAt = Callable[[FloatArray], FloatArray]
"""(N,) longest wanted side at points (N, 2)."""


@dataclass(frozen=True, eq=False)
class PlanarMesh:
    """Triangles that share corners in the plane."""

    corners: FloatArray
    """(V, 2)"""
    triangles: IntArray
    """(T, 3) corners, counter-clockwise."""


def mesh_within(outlines: Sequence[FloatArray], inner: FloatArray, side_at: SideAt, least_side: float) -> PlanarMesh:
    """Fill outlines with triangles.

    Sides of the outlines that the Delaunay triangulation of all points leaves out are halved until it has them, so
    that no triangle crosses an outline.

    Parameters
    ----------
    outlines : sequence of (n, 2)
        Closed polygons, the last point joined to the first; a point is inside where an odd number of them is around it.
    inner : (M, 2)
        Points wanted within; those that are too near to an outline are left out.
    side_at : function of (N, 2) points
        Longest wanted side along outlines there.
    least_side : float
        Sides that are shorter are not halved.

    Returns
    -------
    PlanarMesh
        Without triangles where the outlines span no area.
    """
    rings = [_subdivided(np.asarray(outline, dtype=np.float64), side_at) for outline in outlines if len(outline) >= 3]
    if not rings:
        return PlanarMesh(np.zeros((0, 2)), np.zeros((0, 3), dtype=np.int64))
    inner = inner[_far_from(inner, rings, side_at(inner))] if len(inner) else inner.reshape(0, 2)
    for _ in range(_ROUNDS):
        corners, sides = _together(rings, inner)
        try:
            triangles = Delaunay(corners).simplices.astype(np.int64)
        except QhullError:  # all on one line
            return PlanarMesh(corners, np.zeros((0, 3), dtype=np.int64))
        missing = _missing(sides, triangles) & (_lengths(corners, sides) > 2 * least_side)
        if not missing.any():
            break
        rings = _halved(rings, missing)
    return _turned_left(corners, triangles[_inside(corners[triangles].mean(axis=1), rings)])


def _subdivided(ring: FloatArray, side_at: SideAt) -> FloatArray:
    """The ring with its sides cut into equal parts, and these into halves, until none is longer than wanted."""
    for _ in range(_CUTS):
        following = np.roll(ring, -1, axis=0)
        length = np.linalg.norm(following - ring, axis=1)
        parts = np.maximum(1, np.ceil(length / side_at((ring + following) / 2))).astype(np.intp)
        if (parts == 1).all():
            break
        pieces = [a + (b - a) * (np.arange(n) / n)[:, None] for a, b, n in zip(ring, following, parts, strict=True)]
        ring = np.concatenate(pieces)
    return ring


def _far_from(points: FloatArray, rings: Sequence[FloatArray], side: FloatArray) -> BoolArray:
    distance, _ = cKDTree(np.concatenate(rings)).query(points)
    return np.asarray((distance > _CLEAR * side) & _inside(points, rings))


def _together(rings: Sequence[FloatArray], inner: FloatArray) -> tuple[FloatArray, IntArray]:
    """All points, and (S, 2) the sides of the rings by their numbers."""
    starts = np.cumsum([0, *(len(ring) for ring in rings)])
    sides = [
        np.stack([np.arange(first, last), np.roll(np.arange(first, last), -1)], axis=1)
        for first, last in pairwise(starts.tolist())
    ]
    return np.concatenate([*rings, inner]), np.concatenate(sides).astype(np.int64)


def _lengths(corners: FloatArray, sides: IntArray) -> FloatArray:
    return np.asarray(np.linalg.norm(corners[sides[:, 1]] - corners[sides[:, 0]], axis=1))


def _missing(sides: IntArray, triangles: IntArray) -> BoolArray:
    """(S,) sides that no triangle has."""
    edges = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    factor = int(edges.max()) + 1
    wanted = np.sort(sides, axis=1)
    return ~np.isin(wanted[:, 0] * factor + wanted[:, 1], edges[:, 0] * factor + edges[:, 1])


def _halved(rings: Sequence[FloatArray], chosen: BoolArray) -> list[FloatArray]:
    """Rings with a point in the middle of each chosen side."""
    result, first = [], 0
    for ring in rings:
        on = np.flatnonzero(chosen[first : first + len(ring)])
        middle = (ring[on] + np.roll(ring, -1, axis=0)[on]) / 2
        result.append(np.insert(ring, on + 1, middle, axis=0))
        first += len(ring)
    return result


def _inside(points: FloatArray, rings: Sequence[FloatArray]) -> BoolArray:
    """(N,) points that an odd number of rings is around, by the sides that a ray along x crosses."""
    odd = np.zeros(len(points), dtype=bool)
    for ring in rings:
        for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
            between = (a[1] > points[:, 1]) != (b[1] > points[:, 1])
            if between.any():
                at = a[0] + (points[:, 1] - a[1]) * (b[0] - a[0]) / (b[1] - a[1] if b[1] != a[1] else 1.0)
                odd ^= between & (points[:, 0] < at)
    return odd


def _turned_left(corners: FloatArray, triangles: IntArray) -> PlanarMesh:
    """The mesh with all triangles counter-clockwise, those without area left out, and only corners that are used."""
    a, b, c = (corners[triangles[:, k]] for k in range(3))
    twice = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    longest2 = np.max([((p - q) ** 2).sum(axis=1) for p, q in ((a, b), (b, c), (c, a))], axis=0, initial=0.0)
    kept = np.abs(twice) > _LEAST_HEIGHT * longest2
    triangles = np.where((twice < 0)[:, None], triangles[:, ::-1], triangles)[kept]
    used, renamed = np.unique(triangles, return_inverse=True)
    return PlanarMesh(corners[used], renamed.reshape(-1, 3).astype(np.int64))
