"""Patches cut along the lines where others pass through them or stand on them: light steps there.

A patch and a polygon that is not parallel to it share a segment of the line between their planes. A patch is cut in two
along that line, its pieces along the segments that are left in them, and so on: a convex body that pierces a patch
leaves one piece inside of it and one for each of its sides around it.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np

from sim.arrays import FloatArray, IntArray
from sim.geometry.adaptive_patches import AdaptivePatches
from sim.geometry.intersections import near_pairs_between, shared_segments
from sim.geometry.rays import plane_axes

MARGIN = 1e-3
"""Of a patch's size. A line that leaves narrower strips, or crosses a patch on a shorter way, cuts nothing: it would
save no more than that share of the squared step."""

NOTHING = 1e-9
"""Of a patch's size, and squared of its area: what is cut off where a line goes through a corner but for rounding is no
edge and no piece."""

MOST_CROSSINGS = 64
"""Of a patch that is cut along them: a thing of many facets that stands on it has some dozen. Of a soup of 2,000
triangles each is crossed a thousand times, and would be cut into as many pieces."""
FIRST, PAIRS_AT_A_TIME = 128, 1 << 20
"""Patches whose neighbours are looked at first, and pairs that are looked at together from then on, about (0.5 GB): a
soup of 20,000 triangles has a hundred million."""

Point = tuple[float, float]
Segment = tuple[float, float, float, float]
"""x and y of its ends."""


def cut_where_crossed(cells: AdaptivePatches) -> tuple[AdaptivePatches, IntArray]:
    """Return patches cut along the lines where the scene's polygons pass through them or stand on their lit side.

    Patches that more than ``MOST_CROSSINGS`` polygons cross stay whole.

    Parameters
    ----------
    cells : AdaptivePatches
        P of them; the polygons are their ``occluders``.

    Returns
    -------
    pieces : AdaptivePatches
        Patches that nothing crosses among them, uncut.
    parents : (pieces,) int array
        The patch that each was cut from, in ascending order.
    """
    patch, ends = _crossed(cells)
    seldom = np.bincount(patch, minlength=cells.n_patches)[patch] <= MOST_CROSSINGS
    patch, ends = patch[seldom], ends[seldom]
    axes = plane_axes(cells)
    ends_uv = np.einsum("nek,nak->nea", ends - cells.centres[patch, None], axes[patch])
    corners_uv = np.einsum("pck,pak->pca", cells.vertices - cells.centres[:, None], axes)
    pieces, parents = [], []
    for one, rows in zip(*_runs(patch), strict=True):
        count = 3 if cells.triangular[one] else 4
        corners = [(float(x), float(y)) for x, y in corners_uv[one, :count]]
        segments = [(float(p[0]), float(p[1]), float(q[0]), float(q[1])) for p, q in ends_uv[rows]]
        found = _cut(corners, segments, MARGIN * math.sqrt(float(cells.areas[one])))
        if len(found) > 1:
            area_m2 = float(cells.areas[one])
            whole = [_distinct(piece, NOTHING * math.sqrt(area_m2)) for piece in found]
            quads = [
                quad
                for piece in whole
                if len(piece) > 2
                for quad in _quads(piece)
                if _area(quad) > NOTHING**2 * area_m2
            ]
            pieces.append(cells.centres[one] + np.array(quads) @ axes[one])
            parents.append(np.full(len(quads), one, dtype=np.intp))
    return _with_pieces(cells, pieces, parents)


def crossings_each(cells: AdaptivePatches, looked_at: int) -> float:
    """Return how many polygons cross a patch, on average over so many patches, evenly chosen."""
    count = min(looked_at, cells.n_patches)
    some = cells.chosen(np.linspace(0, cells.n_patches - 1, count).round().astype(np.intp))
    return len(_crossed(some)[0]) / count


def _crossed(cells: AdaptivePatches) -> tuple[IntArray, FloatArray]:
    """Patches that polygons cross, in ascending order, once for each, and (crossings, 2, 3) where from and to [m]."""
    size_m = float(np.ptp(cells.occluders.reshape(-1, 3), axis=0).max()) if len(cells.occluders) else 0.0
    patches, ends = [np.zeros(0, dtype=np.intp)], [np.zeros((0, 2, 3))]
    first, count = 0, FIRST
    while first < cells.n_patches:
        vertices = cells.vertices[first : first + count]
        near, polygon = near_pairs_between(vertices, cells.occluders).T
        crossed, begin, end = shared_segments(vertices[near], cells.occluders[polygon], size_m)
        order = np.argsort(near[crossed], kind="stable")
        patches.append(first + near[crossed][order])
        ends.append(np.stack([begin, end], axis=1)[order])
        first, count = first + count, max(PAIRS_AT_A_TIME * count // (len(near) + 1), 1)
    return np.concatenate(patches), np.concatenate(ends)


def _runs(patch: IntArray) -> tuple[IntArray, list[IntArray]]:
    """Each number once, and where it stands in an ascending array."""
    if not len(patch):
        return patch, []
    begins = np.flatnonzero(np.diff(patch, prepend=-1))
    return patch[begins], np.split(np.arange(len(patch)), begins[1:])


def _with_pieces(
    cells: AdaptivePatches, pieces: list[FloatArray], parents: list[IntArray]
) -> tuple[AdaptivePatches, IntArray]:
    if not pieces:
        return cells, np.arange(cells.n_patches)
    cut = np.concatenate(parents)
    kept = np.setdiff1d(np.arange(cells.n_patches), cut)
    parent = np.concatenate([kept, cut])
    order = np.argsort(parent, kind="stable")
    vertices = np.concatenate([cells.vertices[kept], *pieces])[order]
    return replace(cells.chosen(parent[order]), vertices=vertices), parent[order]


def _cut(polygon: list[Point], segments: list[Segment], margin_m: float) -> list[list[Point]]:
    """Convex pieces of a convex polygon that no segment crosses; polygons are counter-clockwise."""
    best, reach, among = None, margin_m, []
    for segment in segments:
        length = _length_within(polygon, segment, margin_m)
        if length > margin_m:
            among.append(segment)
        if length > reach:
            best, reach = segment, length
    if best is None:
        return [polygon]
    return [piece for half in _halves(polygon, best) for piece in _cut(half, among, margin_m)]


def _heights(polygon: list[Point], segment: Segment) -> list[float]:
    """Distances of corners from a segment's line, above 0 on its left [m]."""
    x, y, end_x, end_y = segment
    along_x, along_y = end_x - x, end_y - y
    scale = 1.0 / math.hypot(along_x, along_y)
    return [scale * (along_x * (corner_y - y) - along_y * (corner_x - x)) for corner_x, corner_y in polygon]


def _length_within(polygon: list[Point], segment: Segment, margin_m: float) -> float:
    """Length of a segment that lies in a polygon; 0 where its line leaves a strip up to the margin [m]."""
    heights = _heights(polygon, segment)
    if min(heights) > -margin_m or max(heights) < margin_m:
        return 0.0
    x, y, end_x, end_y = segment
    length = math.hypot(end_x - x, end_y - y)
    along_x, along_y = (end_x - x) / length, (end_y - y) / length
    places = [along_x * (at_x - x) + along_y * (at_y - y) for at_x, at_y in _crossings(polygon, heights)]
    return min(max(places), length) - max(min(places), 0.0)


def _crossings(polygon: list[Point], heights: list[float]) -> list[Point]:
    """Where the height of a polygon's border is 0."""
    found = []
    for k, (height, corner) in enumerate(zip(heights, polygon, strict=True)):
        if height * heights[k - 1] < 0:
            found.append(_between(polygon[k - 1], corner, heights[k - 1] / (heights[k - 1] - height)))
        elif height == 0:
            found.append(corner)
    return found


def _between(first: Point, second: Point, share: float) -> Point:
    return first[0] + share * (second[0] - first[0]), first[1] + share * (second[1] - first[1])


def _halves(polygon: list[Point], segment: Segment) -> tuple[list[Point], list[Point]]:
    """What lies left and right of a segment's line."""
    left: list[Point] = []
    right: list[Point] = []
    heights = _heights(polygon, segment)
    for k, (height, corner) in enumerate(zip(heights, polygon, strict=True)):
        if height * heights[k - 1] < 0:
            met = _between(polygon[k - 1], corner, heights[k - 1] / (heights[k - 1] - height))
            left.append(met)
            right.append(met)
        if height >= 0:
            left.append(corner)
        if height <= 0:
            right.append(corner)
    return left, right


def _area(polygon: list[Point]) -> float:
    """Area of a counter-clockwise polygon [m²]."""
    x, y = polygon[0]
    return 0.5 * sum((a[0] - x) * (b[1] - y) - (a[1] - y) * (b[0] - x) for a, b in pairwise(polygon[1:]))


def _distinct(polygon: list[Point], least_m: float) -> list[Point]:
    """Corners that are further than that from the one before."""
    return [corner for k, corner in enumerate(polygon) if math.dist(corner, polygon[k - 1]) > least_m]


def _quads(polygon: list[Point]) -> list[list[Point]]:
    """Quads and triangles of a convex polygon, each with four corners: cut along the shortest of its long diagonals."""
    count = len(polygon)
    if count <= 4:
        return [[*polygon, polygon[-1]][:4]]
    half = count // 2
    first = min(range(half + count % 2), key=lambda k: math.dist(polygon[k], polygon[(k + half) % count]))
    turned = polygon[first:] + polygon[:first]
    return [*_quads(turned[: half + 1]), *_quads([*turned[half:], turned[0]])]
