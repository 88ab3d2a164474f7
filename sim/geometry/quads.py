"""Triangles joined in pairs to quads: half the patches, a quarter of the factors."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sim.arrays import FloatArray, IntArray
from sim.geometry.topology import WELD, extent, weld

_FLAT = 5e-7
"""Largest distance of a corner from the other triangle's plane, over the longest diagonal: half of what passes."""
_STRAIGHT = 1e-3
"""Smallest sine of a quad's corner: 0.06 degrees off straight."""


def quads_from_triangles(points_m: ArrayLike, triangles: IntArray, group: ArrayLike) -> tuple[IntArray, IntArray]:
    """Join neighbouring triangles of one plane and group to convex quads, the most rectangular first.

    Parameters
    ----------
    points_m : (V, 3) array
        Finite corners. [m]
    triangles : (T, 3) int array
        Corner numbers.
    group : (T,) array
        Only triangles of equal group are joined (equal reflectance).

    Returns
    -------
    corners : (P, 4) int array
        Corner numbers, the last -1 for triangles that are left.
    first : (P,) int array
        First triangle of each.
    """
    points = np.asarray(points_m, dtype=np.float64)
    _, number = weld(points, WELD * extent(points))
    first, second, quad = _candidates(number, triangles, np.asarray(group))
    score = _skewness(points[quad], max(WELD * extent(points), np.finfo(float).tiny))
    good = np.flatnonzero(score < 1 - _STRAIGHT)
    # Rounding makes the order of equally good pairs that of the file.
    order = good[np.lexsort((good, np.round(score[good], 6)))]
    taken = order[_matching(first[order], second[order], len(triangles))]
    left = np.setdiff1d(np.arange(len(triangles)), np.concatenate([first[taken], second[taken]]))
    place = np.concatenate([np.minimum(first[taken], second[taken]), left])
    single = np.concatenate([triangles[left], np.full((len(left), 1), -1)], axis=1)
    return np.concatenate([quad[taken], single])[np.argsort(place)], np.sort(place)


def _candidates(number: IntArray, triangles: IntArray, group: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Pairs of triangles of one group that share an edge, and the quad that each pair makes."""
    start = number[triangles].ravel()
    end = number[np.roll(triangles, -1, axis=1)].ravel()
    low, high = np.minimum(start, end), np.maximum(start, end)
    _, edge, count = np.unique(low * (high.max() + 1) + high, return_inverse=True, return_counts=True)
    order = np.argsort(edge.reshape(-1), kind="stable")
    at = (np.cumsum(count) - count)[count == 2]
    a, b = order[at], order[at + 1]
    fits = (start[a] == end[b]) & (start[a] != end[a]) & (group[a // 3] == group[b // 3]) & (a // 3 != b // 3)
    a, b = a[fits], b[fits]
    corner = triangles.ravel()

    def turned(edges: IntArray, steps: int) -> IntArray:
        return np.asarray(corner[edges // 3 * 3 + (edges + steps) % 3])

    return a // 3, b // 3, np.stack([turned(a, 0), turned(b, 2), turned(a, 1), turned(a, 2)], axis=1)


def _skewness(quads: FloatArray, tolerance_m: float) -> FloatArray:
    """(N,) largest |cosine| of a corner, 0 for a rectangle; infinite if the quad is bent or not convex."""
    edges = np.roll(quads, -1, axis=1) - quads
    length = np.linalg.norm(edges, axis=2, keepdims=True)
    unit = edges / np.maximum(length, np.finfo(float).tiny)
    before = np.roll(unit, 1, axis=1)
    normal = np.cross(quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(float).tiny)
    height = np.abs(np.einsum("nkc,nc->nk", quads - quads.mean(axis=1, keepdims=True), normal)).max(axis=1, initial=0)
    flat = height <= np.maximum(_FLAT * length.max(axis=(1, 2), initial=0), tolerance_m / 2)
    turn = np.einsum("nkc,nc->nk", np.cross(before, unit), normal)
    cosine = np.abs((before * unit).sum(axis=2)).max(axis=1, initial=0)
    return np.where(flat & (turn > _STRAIGHT).all(axis=1), cosine, np.inf)


def _matching(first: IntArray, second: IntArray, n_triangles: int) -> IntArray:
    """Pairs, best first, of which no triangle is in two: each that is the best left for both of its triangles."""
    taken = []
    left = np.arange(len(first))
    while len(left):
        best = np.full(n_triangles, len(first))
        np.minimum.at(best, first[left], left)
        np.minimum.at(best, second[left], left)
        mutual = left[(best[first[left]] == left) & (best[second[left]] == left)]
        taken.append(mutual)
        used = np.zeros(n_triangles, dtype=bool)
        used[first[mutual]] = used[second[mutual]] = True
        left = left[~used[first[left]] & ~used[second[left]]]
    return np.concatenate(taken) if taken else left
