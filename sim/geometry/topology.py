"""How patches hang together: corners in one place, edges that meet, flat regions, what lies behind a plane."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, KDTree

from sim.arrays import BoolArray, FloatArray, IntArray

WELD = 1e-7
"""Corners nearer than this share of the scene's size are one: above the rounding of float32 files."""
PARALLEL = 1e-4
"""Sine of the angle below which neighbours lie in one plane: float32 turns patches of 4 cm by 1e-5."""

MOST_PIECES = 2_000_000
"""Of loose edges about which other corners are looked for."""
PIECES_AT_A_TIME = 50_000

MANY = 30_000_000
"""Products of directions and corners up to which trying all is faster than walking over the hull."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Topology:
    """Edges of patches after their corners are welded and edges are cut where another's corner lies on them.

    An edge belongs to one patch and has a direction; where two patches of one sheet meet, their edges run
    against each other.
    """

    vertices: FloatArray
    """(P, 4, 3) corners [m]."""
    size_m: float
    """Largest extent [m]."""
    corner: IntArray
    """(P, 4) number of the welded point of each corner."""
    patch: IntArray
    """(E,) patch of each edge."""
    start: IntArray
    """(E,) point where it starts."""
    end: IntArray
    """(E,) point where it ends."""
    cut: IntArray
    """(C,) patches with an edge on which another's corner lies (T-junctions)."""

    @classmethod
    def of(cls, vertices: FloatArray) -> Topology:
        """Return the topology of (P, 4, 3) finite corners [m]."""
        size = extent(vertices)
        points, corner = weld(vertices.reshape(-1, 3), WELD * size)
        corner = corner.reshape(-1, 4)
        patch = np.repeat(np.arange(len(corner)), 4)
        start, end = corner.ravel(), np.roll(corner, -1, axis=1).ravel()
        real = start != end
        patch, start, end = patch[real], start[real], end[real]
        loose = np.flatnonzero(_balance(start, end) != 0)
        kept = np.setdiff1d(np.arange(len(patch)), loose)
        parent, first, last = _cut_at_corners(points, start[loose], end[loose], WELD * size)
        pieces = patch[loose][parent]
        count = np.bincount(parent, minlength=len(loose))
        return cls(
            vertices=vertices,
            size_m=size,
            corner=corner,
            patch=np.concatenate([patch[kept], pieces]),
            start=np.concatenate([start[kept], first]),
            end=np.concatenate([end[kept], last]),
            cut=np.unique(patch[loose][count > 1]),
        )

    @property
    def n_patches(self) -> int:
        """Number of patches, P."""
        return len(self.vertices)

    @cached_property
    def _edge(self) -> tuple[IntArray, IntArray]:
        return _edge_numbers(self.start, self.end)

    @cached_property
    def open_edges(self) -> BoolArray:
        """(E,) edges that are not matched by one of another patch that runs against them."""
        return np.asarray(_balance(self.start, self.end) != 0)

    @cached_property
    def neighbours(self) -> tuple[IntArray, IntArray]:
        """Pairs of patches whose edges run against each other, each pair once."""
        edge, direction = self._edge
        shape = (self.n_patches, int(edge.max(initial=-1)) + 1)
        one, other = (
            csr_array(coo_array((np.ones(some.sum(), dtype=np.int8), (self.patch[some], edge[some])), shape=shape))
            for some in (direction > 0, direction < 0)
        )
        pairs = (one @ other.T).tocoo()
        first, second = np.minimum(*pairs.coords), np.maximum(*pairs.coords)
        pair = np.unique((first.astype(np.intp) * self.n_patches + second)[first < second])
        return pair // max(self.n_patches, 1), pair % max(self.n_patches, 1)

    @cached_property
    def conflicts(self) -> IntArray:
        """(C, 2) edges that two patches alone share and run along the same way: one patch is inverted."""
        edge, direction = self._edge
        order = np.argsort(edge, kind="stable")
        count = np.bincount(edge)
        first = (np.cumsum(count) - count)[count == 2]
        pairs = np.stack([order[first], order[first + 1]], axis=1)
        return np.asarray(pairs[direction[pairs[:, 0]] == direction[pairs[:, 1]]])

    @cached_property
    def sheet(self) -> IntArray:
        """(P,) number of the sheet of each patch: neighbours whose edges run against each other are in one."""
        return _connected(self.n_patches, *self.neighbours)

    @cached_property
    def area_vectors(self) -> FloatArray:
        """(P, 3) normal times area [m²]: half the cross product of the diagonals."""
        a, b, c, d = np.moveaxis(self.vertices, 1, 0)
        return np.asarray(np.cross(c - a, d - b) / 2)

    @cached_property
    def volume_m3(self) -> float:
        """Volume behind a closed mesh: below 0 if its lit sides look inwards."""
        return float((self.area_vectors * (self.vertices[:, 0] - self.vertices[0, 0])).sum() / 3)

    @property
    def closed(self) -> bool:
        """Tell if every edge meets another that runs against it, and the lit sides look inwards."""
        return not self.open_edges.any() and self.volume_m3 < -(WELD**2) * self.size_m**3

    @cached_property
    def normals(self) -> FloatArray:
        """(P, 3) unit normals."""
        return np.asarray(self.area_vectors / np.linalg.norm(self.area_vectors, axis=1, keepdims=True))

    @cached_property
    def region(self) -> IntArray:
        """(P,) number of the flat region of each patch: neighbours in one plane are in one."""
        first, second = self.neighbours
        sine = np.linalg.norm(np.cross(self.normals[first], self.normals[second]), axis=1)
        flat = (sine < PARALLEL) & ((self.normals[first] * self.normals[second]).sum(axis=1) > 0)
        return _connected(self.n_patches, first[flat], second[flat])

    @property
    def _one_of_each(self) -> FloatArray:
        """(V, 3) corners, each place once, or more often where corners were welded that differ a little [m]."""
        corners = self.vertices.reshape(-1, 3)
        _, first, number = np.unique(self.corner, return_index=True, return_inverse=True)
        once = corners[first]
        return once if (once[number.reshape(-1)] == corners).all() else np.unique(corners, axis=0)

    @cached_property
    def covers(self) -> BoolArray:
        """(P,) patches that something lies behind, so that they may stand between two others."""
        n = int(self.region.max(initial=-1)) + 1
        weights = np.linalg.norm(self.area_vectors, axis=1)
        total = np.stack([np.bincount(self.region, column, n) for column in self.area_vectors.T], axis=1)
        normals = total / np.linalg.norm(total, axis=1, keepdims=True)
        height = np.einsum("pkc,pc->p", self.vertices, normals[self.region]) / 4
        offset = np.bincount(self.region, weights * height, n) / np.bincount(self.region, weights, n)
        behind = _lowest(normals, self._one_of_each) < offset - 2 * WELD * self.size_m
        return np.asarray(behind[self.region])


def extent(vertices: FloatArray) -> float:
    """Return the largest extent along an axis of corners (..., 3) [m]."""
    if not vertices.size:
        return 0.0
    with np.errstate(over="ignore"):  # infinite then, as is refused
        return float(np.ptp(vertices.reshape(-1, 3), axis=0).max())


def weld(points: FloatArray, tolerance_m: float) -> tuple[FloatArray, IntArray]:
    """Return (V, 3) distinct points, and (N,) numbers: points (N, 3) nearer than the tolerance have one."""
    distinct, number = np.unique(points, axis=0, return_inverse=True)
    number = number.reshape(-1)
    near = KDTree(distinct).query_pairs(tolerance_m, output_type="ndarray")
    if not len(near):
        return distinct, number
    label = _connected(len(distinct), near[:, 0], near[:, 1])
    _, example = np.unique(label, return_index=True)
    return distinct[example], label[number]


def _connected(n: int, first: IntArray, second: IntArray) -> IntArray:
    graph = coo_array((np.ones(len(first), dtype=np.int8), (first, second)), shape=(n, n))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.intp)


def _edge_numbers(start: IntArray, end: IntArray) -> tuple[IntArray, IntArray]:
    """(E,) number of each edge whatever its direction, and (E,) direction, 1 or -1."""
    low, high = np.minimum(start, end), np.maximum(start, end)
    _, number = np.unique(low * (high.max(initial=0) + 1) + high, return_inverse=True)
    return number.reshape(-1), np.where(start < end, 1, -1)


def _balance(start: IntArray, end: IntArray) -> FloatArray:
    """(E,) how many edges more run one way than the other between the same two points."""
    number, direction = _edge_numbers(start, end)
    return np.asarray(np.bincount(number, direction)[number]) if len(number) else np.zeros(0)


def _cut_at_corners(
    points: FloatArray, start: IntArray, end: IntArray, tolerance_m: float
) -> tuple[IntArray, IntArray, IntArray]:
    """Cut edges at the ends of others that lie on them: index of the edge, start and end of each piece."""
    none = np.zeros(0, dtype=np.intp)
    if not len(start):
        return none, none, none
    candidates = np.unique(np.concatenate([start, end]))
    a, b = points[start], points[end]
    edge, near = _near_edges(points[candidates], a, b, tolerance_m)
    point = candidates[near]
    along, across = _on_line(points[point], a[edge], b[edge])
    inside = (across < tolerance_m) & (point != start[edge]) & (point != end[edge]) & (along > 0) & (along < 1)
    edges = np.arange(len(start))
    edge = np.concatenate([edges, edge[inside], edges])
    place = np.concatenate([np.zeros(len(edges)), along[inside], np.ones(len(edges))])
    point = np.concatenate([start, point[inside], end])
    order = np.lexsort((place, edge))
    edge, point = edge[order], point[order]
    piece = edge[1:] == edge[:-1]
    return edge[1:][piece], point[:-1][piece], point[1:][piece]


def _near_edges(points: FloatArray, a: FloatArray, b: FloatArray, tolerance_m: float) -> tuple[IntArray, IntArray]:
    """(N,) edges from a to b, (E, 3) each, and (N,) points that may lie on them, each pair once.

    Points are looked for about pieces of edges, so that a long edge does not meet all that lie around its middle.
    """
    length = np.linalg.norm(b - a, axis=1)
    piece_m = max(extent(points) / np.sqrt(len(points)), float(length.sum()) / MOST_PIECES, np.finfo(float).tiny)
    count = np.ceil(length / piece_m).astype(np.intp).clip(1)
    edge = np.repeat(np.arange(len(a)), count)
    step = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    middle = a[edge] + ((step + 0.5) / count[edge])[:, None] * (b - a)[edge]
    tree, found = KDTree(points), [np.zeros((0, 2), dtype=np.intp)]
    for k in range(0, len(edge), PIECES_AT_A_TIME):
        part = slice(k, k + PIECES_AT_A_TIME)
        near = tree.query_ball_point(middle[part], (length / count / 2)[edge[part]] + tolerance_m)
        sizes = np.fromiter((len(some) for some in near), dtype=np.intp, count=len(near))
        both = np.stack([np.repeat(edge[part], sizes), np.concatenate([*near, []]).astype(np.intp)], axis=1)
        along, across = _on_line(points[both[:, 1]], a[both[:, 0]], b[both[:, 0]])
        found.append(both[(across < tolerance_m) & (along >= 0) & (along <= 1)])
    pairs = np.unique(np.concatenate(found), axis=0)
    return pairs[:, 0], pairs[:, 1]


def _on_line(points: FloatArray, a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(N,) place between a (0) and b (1), and distance from the line [m]."""
    line = b - a
    along = ((points - a) * line).sum(axis=1) / (line * line).sum(axis=1)
    return along, np.linalg.norm(points - a - along[:, None] * line, axis=1)


def _lowest(directions: FloatArray, points: FloatArray) -> FloatArray:
    """(N,) smallest coordinate of any of the (V, 3) points along each direction [m]."""
    sizes = np.linalg.svd(points - points.mean(axis=0), compute_uv=False, full_matrices=False)
    if len(points) < 5 or sizes[-1] < 1e-6 * sizes[0]:
        return _lowest_of_all(directions, points)
    hull = ConvexHull(points)
    if len(directions) * len(hull.vertices) < MANY:
        return _lowest_of_all(directions, points[hull.vertices])
    return _lowest_downhill(directions, points, hull.simplices)


def _lowest_of_all(directions: FloatArray, points: FloatArray) -> FloatArray:
    step = max(1, 2_000_000 // len(points))
    pieces = [(directions[k : k + step] @ points.T).min(axis=1) for k in range(0, len(directions), step)]
    return np.concatenate(pieces)


def _lowest_downhill(directions: FloatArray, points: FloatArray, triangles: IntArray) -> FloatArray:
    """From corner to lower corner of the hull: on a convex body the first without a lower neighbour is the lowest."""
    edges = np.concatenate([triangles[:, [i, j]] for i in range(3) for j in range(3) if i != j])
    edges = np.unique(edges, axis=0)
    degree = np.bincount(edges[:, 0], minlength=len(points))
    first, neighbour = np.cumsum(degree) - degree, edges[:, 1]
    start = np.unique(edges[:, 0])[:: max(1, len(points) // 64)]
    at = start[(directions @ points[start].T).argmin(axis=1)]
    value = (directions * points[at]).sum(axis=1)
    moving = np.arange(len(directions))
    while len(moving):
        here, lowest, lowest_value = at[moving], at[moving], value[moving]
        for k in range(int(degree[here].max())):
            some = np.flatnonzero(degree[here] > k)
            other = neighbour[first[here[some]] + k]
            other_value = (directions[moving[some]] * points[other]).sum(axis=1)
            lower = other_value < lowest_value[some]
            lowest[some[lower]], lowest_value[some[lower]] = other[lower], other_value[lower]
        at[moving], value[moving] = lowest, lowest_value
        moving = moving[lowest != here]
    return np.asarray(value)
