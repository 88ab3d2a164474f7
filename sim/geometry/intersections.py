"""Patches that pierce or cover each other."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from sim.arrays import BoolArray, FloatArray, IntArray
from sim.geometry.topology import PARALLEL, WELD, Topology

CHUNK = 200_000
"""Pairs looked at together: about 100 MB."""
MOST_PAIRS = 3_000_000
"""Pairs of patches that may be near each other, counted both ways; more take minutes and gigabytes."""


def count_near_pairs(vertices: FloatArray) -> int:
    """Return at least how many pairs of patches, (P, 4, 3) corners, must be looked at to find all that cut or cover."""
    centre, radius, classes = _classes(vertices)
    trees = [KDTree(centre[members]) for members in classes]
    return sum(
        int(trees[i].count_neighbors(trees[j], float(radius[classes[i]].max() + radius[classes[j]].max())))
        for i in range(len(classes))
        for j in range(i, len(classes))
    )


def piercing_and_overlapping(topology: Topology) -> tuple[IntArray, IntArray]:
    """(N, 2) pairs that cut through each other, and (M, 2) pairs that share area in one plane.

    Patches that only touch (share an edge, or stand on one another) are in neither.
    """
    pairs = _near_pairs(topology.vertices)
    pierce, overlap = np.zeros(len(pairs), dtype=bool), np.zeros(len(pairs), dtype=bool)
    tolerance = 10 * WELD * topology.size_m
    for begin in range(0, len(pairs), CHUNK):
        here = slice(begin, begin + CHUNK)
        first, second = pairs[here].T
        normal_a, normal_b = topology.normals[first], topology.normals[second]
        a, b = topology.vertices[first], topology.vertices[second]
        flat = np.linalg.norm(np.cross(normal_a, normal_b), axis=1) < PARALLEL
        pierce[here] = _pierce(a, b, normals=(normal_a, normal_b), tolerance_m=tolerance)
        overlap[here] = flat & _overlap(a, b, normal_a, tolerance)
    return pairs[pierce], pairs[overlap]


def near_pairs_between(vertices: FloatArray, others: FloatArray) -> IntArray:
    """Return (N, 2) pairs of a patch and another polygon, (P, 4, 3) and (M, 4, 3) corners, whose boxes meet."""
    found = [np.zeros((0, 2), dtype=np.intp)]
    if len(vertices) and len(others):
        (centre, radius, classes), (middle, reach, kinds) = _classes(vertices), _classes(others)
        trees = [KDTree(middle[members]) for members in kinds]
        for members in classes:
            here = KDTree(centre[members])
            for kind, tree in zip(kinds, trees, strict=True):
                far = float(radius[members].max() + reach[kind].max())
                near = here.sparse_distance_matrix(tree, far, output_type="ndarray")
                first, second = members[near["i"]], kind[near["j"]]
                meet = _boxes_meet(vertices[first], others[second])
                found.append(np.stack([first[meet], second[meet]], axis=1))
    return np.concatenate(found)


def shared_segments(a: FloatArray, b: FloatArray, size_m: float) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the segments where polygons pass through patches or stand on their lit side.

    Parameters
    ----------
    a, b : (N, 4, 3) array
        Corners of patches, and of one polygon for each [m].
    size_m : float
        Of the scene: rounding is WELD of it.

    Returns
    -------
    which : (K,) int array
        Pairs that share one. Where a patch's border lies on a polygon nothing is shared.
    begin, end : (K, 3) array
        Its ends [m].
    """
    tolerance_m = 10 * WELD * size_m
    normal_a, normal_b = _unit_normals(a), _unit_normals(b)
    direction = np.cross(normal_a, normal_b)
    sine = np.linalg.norm(direction, axis=1)
    direction /= np.maximum(sine, np.finfo(float).tiny)[:, None]
    height_a, height_b = _heights(a, b, normal_b, tolerance_m), _heights(b, a, normal_a, tolerance_m)
    which = np.flatnonzero(
        (sine >= PARALLEL) & _on_both_sides(height_a) & (height_b.max(axis=1) > 0) & (height_b.min(axis=1) <= 0)
    )
    a, direction, height_a, height_b = a[which], direction[which], height_a[which], height_b[which]
    low_a, high_a = _interval(a, height_a, direction)
    low_b, high_b = _interval(b[which], height_b, direction)
    low, high = np.maximum(low_a, low_b), np.minimum(high_a, high_b)
    long = high - low > tolerance_m
    place = _point_on_both(a, height_a)
    start = np.einsum("nc,nc->n", place, direction)
    begin, end = (place + (at - start)[:, None] * direction for at in (low, high))
    return which[long], begin[long], end[long]


def _unit_normals(corners: FloatArray) -> FloatArray:
    vectors = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), np.finfo(float).tiny))


def _point_on_both(corners: FloatArray, height: FloatArray) -> FloatArray:
    """(N, 3) points between the corners of greatest and least height, where it is 0."""
    rows = np.arange(len(corners))
    highest, lowest = height.argmax(axis=1), height.argmin(axis=1)
    above, below = height[rows, highest], height[rows, lowest]
    share = (above / (above - below))[:, None]
    return np.asarray((1 - share) * corners[rows, highest] + share * corners[rows, lowest])


def _near_pairs(vertices: FloatArray) -> IntArray:
    """(N, 2) pairs of patches whose boxes along the axes meet.

    Patches are sorted into classes by size, so that a large one does not widen the search of all small ones.
    """
    found = [np.zeros((0, 2), dtype=np.intp)]
    centre, radius, classes = _classes(vertices)
    trees = [KDTree(centre[members]) for members in classes]
    for i, members in enumerate(classes):
        for j in range(i, len(classes)):
            reach = float(radius[members].max() + radius[classes[j]].max())
            near = trees[i].sparse_distance_matrix(trees[j], reach, output_type="ndarray")
            first, second = members[near["i"]], classes[j][near["j"]]
            meet = _boxes_meet(vertices[first], vertices[second])
            meet &= (first < second) | (i != j)
            found.append(np.stack([first[meet], second[meet]], axis=1))
    return np.concatenate(found)


def _boxes_meet(a: FloatArray, b: FloatArray) -> BoolArray:
    return np.asarray(((a.min(axis=1) <= b.max(axis=1)) & (b.min(axis=1) <= a.max(axis=1))).all(axis=1))


def _classes(vertices: FloatArray) -> tuple[FloatArray, FloatArray, list[IntArray]]:
    """(P, 3) middles and (P,) radii of boxes, and the patches of each class of size."""
    low, high = vertices.min(axis=1), vertices.max(axis=1)
    centre, radius = (low + high) / 2, np.linalg.norm(high - low, axis=1) / 2
    grade = np.floor(np.log2(radius)).astype(int)
    return centre, radius, [np.flatnonzero(grade == value) for value in np.unique(grade)]


def _pierce(a: FloatArray, b: FloatArray, *, normals: tuple[FloatArray, FloatArray], tolerance_m: float) -> BoolArray:
    """(N,) patches of which each has corners on both sides of the other's plane, and that meet there."""
    normal_a, normal_b = normals
    height_a = _heights(a, b, normal_b, tolerance_m)
    height_b = _heights(b, a, normal_a, tolerance_m)
    crosses = _on_both_sides(height_a) & _on_both_sides(height_b)
    direction = np.cross(normal_a, normal_b)
    direction /= np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), np.finfo(float).tiny)
    low_a, high_a = _interval(a, height_a, direction)
    low_b, high_b = _interval(b, height_b, direction)
    shared = np.minimum(high_a, high_b) - np.maximum(low_a, low_b)
    return np.asarray(crosses & (shared > tolerance_m))


def _heights(corners: FloatArray, other: FloatArray, normal: FloatArray, tolerance_m: float) -> FloatArray:
    """(N, 4) signed distances of corners from the other's plane; 0 within the tolerance [m]."""
    height = np.einsum("nkc,nc->nk", corners - other[:, :1], normal)
    return np.where(np.abs(height) <= tolerance_m, 0.0, height)


def _on_both_sides(height: FloatArray) -> BoolArray:
    return np.asarray((height.min(axis=1) < 0) & (height.max(axis=1) > 0))


def _interval(corners: FloatArray, height: FloatArray, direction: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest place along the planes' common line at which a patch meets it."""
    place = np.einsum("nkc,nc->nk", corners, direction)
    next_height, next_place = np.roll(height, -1, axis=1), np.roll(place, -1, axis=1)
    crosses = height * next_height < 0
    share = np.where(crosses, height / np.where(crosses, height - next_height, 1.0), 0.0)
    met = place + share * (next_place - place)
    meets = crosses | (height == 0)
    return np.where(meets, met, np.inf).min(axis=1), np.where(meets, met, -np.inf).max(axis=1)


def _overlap(a: FloatArray, b: FloatArray, normal: FloatArray, tolerance_m: float) -> BoolArray:
    """(N,) convex patches of one plane that no edge of either parts."""
    result = np.abs(np.einsum("nkc,nc->nk", b - a[:, :1], normal)).max(axis=1) <= tolerance_m
    for edges in (a, b):
        for k in range(4):
            along = edges[:, (k + 1) % 4] - edges[:, k]
            length = np.linalg.norm(along, axis=1)
            axis = np.cross(normal, along) / np.maximum(length, np.finfo(float).tiny)[:, None]
            place_a, place_b = np.einsum("nkc,nc->nk", a, axis), np.einsum("nkc,nc->nk", b, axis)
            shared = np.minimum(place_a.max(axis=1), place_b.max(axis=1))
            shared -= np.maximum(place_a.min(axis=1), place_b.min(axis=1))
            result &= (length == 0) | (shared > tolerance_m)
    return np.asarray(result)
