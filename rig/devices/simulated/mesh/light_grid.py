"""Facets cut into cells that hold emitted light, with nodes at their corners that hold irradiance.

A triangle is cut into n² similar ones; n depends on the triangle's size. Both sides have cells and nodes of their own:
those of the back are numbered after all those of the front.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.devices.simulated.mesh.scene import FloatArray, IntArray, TriangleScene
from rig.devices.simulated.mesh.tracer import RayHits, Tracer
from rig.errors import ProfileError

MOST_NODES = 60_000
"""Of one side; chosen: their exchange fits 1 GB at 1024 rays each."""
_INWARDS = 0.02
"""Share of the way to the middle of its cells by which a node is moved: off the walls that begin at a region's edge."""
_SAME_PLACE = 1e-6
"""Of the scene's size: corners so near each other are one."""
_SAME_PLANE = 64.0
"""Steps of a normal's component: facets that share one node are parallel within about a degree."""


class Blend(NamedTuple):
    """Three nodes for each of n points, and their weights, which add up to 1."""

    nodes: IntArray
    """(n, 3)."""
    weights: FloatArray
    """(n, 3)."""


@dataclass(frozen=True, kw_only=True)
class LightGrid:
    """Cells and nodes of a scene."""

    parts: IntArray
    """(T,) cells along a triangle's edge."""
    first_cell: IntArray
    """(T,)."""
    first_corner: IntArray
    """(T,) into `node_of_corner`, in the order of rows along the first edge."""
    node_of_corner: IntArray
    cell_nodes: IntArray
    """(C, 3) of the front's cells."""
    cell_corners_m: FloatArray
    """(C, 3, 3)."""
    facet_of_cell: IntArray
    """(C,)."""
    node_m: FloatArray
    """(V, 3) of the front's nodes, moved inwards from edges."""
    node_facet: IntArray
    """(V,) a facet that each node lies on."""

    @property
    def n_cells(self) -> int:
        """Cells of one side."""
        return len(self.facet_of_cell)

    @property
    def n_nodes(self) -> int:
        """Nodes of one side."""
        return len(self.node_m)

    @property
    def cell_area_m2(self) -> FloatArray:
        """(C,) areas of the front's cells."""
        a, b, c = np.moveaxis(self.cell_corners_m, 1, 0)
        return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2)

    def cells_of(self, hits: RayHits) -> IntArray:
        """(n,) cell of each hit, on its side; of rays that escaped, any."""
        i, j, upper, _, _ = self._place(hits)
        n = self.parts[hits.facet]
        cell = self.first_cell[hits.facet] + 2 * n * i - i * i + 2 * j + upper
        return np.asarray(cell + self.n_cells * hits.is_back)

    def blend_of(self, hits: RayHits) -> Blend:
        """Three nodes around each hit, on its side, and their weights: linear in each cell."""
        i, j, upper, fa, fb = self._place(hits)
        up = upper.astype(bool)
        rows = (np.where(up, i + 1, i), i + 1, i)
        columns = (np.where(up, j + 1, j), j, j + 1)
        n, first = self.parts[hits.facet], self.first_corner[hits.facet]
        corners = [first + a * (n + 1) - a * (a - 1) // 2 + b for a, b in zip(rows, columns, strict=True)]
        nodes = self.node_of_corner[np.stack(corners, axis=1)] + (self.n_nodes * hits.is_back)[:, None]
        lower = np.stack([1 - fa - fb, fa, fb], axis=1)
        return Blend(nodes, np.where(up[:, None], np.stack([fa + fb - 1, 1 - fb, 1 - fa], axis=1), lower))

    def _place(self, hits: RayHits) -> tuple[IntArray, IntArray, IntArray, FloatArray, FloatArray]:
        """Row and column of the cell, whether it is the one that stands on its tip, and where in it."""
        n = self.parts[hits.facet]
        u, v = np.clip(hits.u, 0, 1), np.clip(hits.v, 0, 1)
        scale = n / np.maximum(u + v, 1)
        a, b = u * scale, v * scale
        i = np.minimum(a.astype(np.int64), n - 1)
        j = np.minimum(b.astype(np.int64), n - 1 - i)
        fa, fb = np.clip(a - i, 0, 1), np.clip(b - j, 0, 1)
        upper = ((fa + fb > 1) & (i + j < n - 1)).astype(np.int64)
        beyond = np.where(upper == 0, np.maximum(fa + fb, 1), 1)
        return i, j, upper, fa / beyond, fb / beyond


def make_light_grid(scene: TriangleScene, cell_size_m: float) -> LightGrid:
    """Cut a scene into cells with legs of about `cell_size_m`. Raises ProfileError when that makes too many."""
    edges = np.roll(scene.triangles_m, -1, axis=1) - scene.triangles_m
    longest = np.linalg.norm(edges, axis=2).max(axis=1)
    parts = np.maximum(1, np.ceil(longest / (np.sqrt(2) * cell_size_m) - 1e-6)).astype(np.int64)
    corner_count = (parts + 1) * (parts + 2) // 2
    if corner_count.sum() > 8 * MOST_NODES:
        raise _too_many(scene, int(corner_count.sum() // 2), cell_size_m)
    lattices = {int(n): _Lattice.of(int(n)) for n in np.unique(parts)}
    facets = [np.flatnonzero(parts == n) for n in lattices]
    first_cell = np.concatenate([[0], np.cumsum(parts**2)[:-1]])
    first_corner = np.concatenate([[0], np.cumsum(corner_count)[:-1]])
    corners_m = np.zeros((int(corner_count.sum()), 3))
    cell_corners = np.zeros((int((parts**2).sum()), 3), dtype=np.int64)
    for lattice, chosen in zip(lattices.values(), facets, strict=True):
        a, b, c = np.moveaxis(scene.triangles_m[chosen][:, :, None], 1, 0)
        u, v = lattice.uv[None, :, :1], lattice.uv[None, :, 1:]
        index = first_corner[chosen][:, None] + np.arange(len(lattice.uv))
        corners_m[index] = a + u * (b - a) + v * (c - a)
        cells = first_cell[chosen][:, None] + np.arange(len(lattice.cells))
        cell_corners[cells] = first_corner[chosen][:, None, None] + lattice.cells
    facet_of_corner = np.repeat(np.arange(len(parts)), corner_count)
    node_of_corner, sample = _joined(scene, corners_m, facet_of_corner)
    if len(sample) > MOST_NODES:
        raise _too_many(scene, len(sample), cell_size_m)
    nodes_m = _inwards(corners_m[sample], corners_m[cell_corners], node_of_corner[cell_corners])
    return LightGrid(
        parts=parts,
        first_cell=first_cell,
        first_corner=first_corner,
        node_of_corner=node_of_corner,
        cell_nodes=node_of_corner[cell_corners],
        cell_corners_m=corners_m[cell_corners],
        facet_of_cell=np.repeat(np.arange(len(parts)), parts**2),
        node_m=nodes_m,
        node_facet=facet_of_corner[sample],
    )


def _too_many(scene: TriangleScene, nodes: int, cell_size_m: float) -> ProfileError:
    return ProfileError(
        f"simulation.scene {scene.name}: {len(scene.triangles_m)} triangles at cell_size_m = {cell_size_m:g} m need "
        f"about {nodes} light samples, {MOST_NODES} fit; raise simulation.cell_size_m, or simplify the mesh"
    )


@dataclass(frozen=True)
class _Lattice:
    """A triangle cut n times along each edge."""

    uv: FloatArray
    """(corners, 2)."""
    cells: IntArray
    """(n², 3) corners of each cell, in the order of :meth:`LightGrid.cells_of`."""

    @classmethod
    def of(cls, n: int) -> _Lattice:
        rows = [np.array([(i, j) for j in range(n + 1 - i)]) for i in range(n + 1)]
        uv = np.concatenate(rows) / n

        def corner(i: int, j: int) -> int:
            return i * (n + 1) - i * (i - 1) // 2 + j

        cells = []
        for i in range(n):
            for j in range(n - i):
                cells.append((corner(i, j), corner(i + 1, j), corner(i, j + 1)))
                if i + j < n - 1:
                    cells.append((corner(i + 1, j + 1), corner(i + 1, j), corner(i, j + 1)))
        return cls(uv, np.array(cells))


def _joined(scene: TriangleScene, corners_m: FloatArray, facet: IntArray) -> tuple[IntArray, IntArray]:
    """Node of each corner, and a corner of each node: corners in one place on parallel facets are one node."""
    place = np.rint((corners_m - corners_m.min(axis=0)) / (_SAME_PLACE * scene.size_m)).astype(np.int64)
    plane = np.rint(scene.normals[facet] * _SAME_PLANE).astype(np.int64)
    key = np.ascontiguousarray(np.hstack([place, plane]))
    rows = key.view([("", key.dtype)] * 6).ravel()
    _, sample, node = np.unique(rows, return_index=True, return_inverse=True)
    return node.ravel(), sample


def _inwards(nodes_m: FloatArray, cell_corners_m: FloatArray, cell_nodes: IntArray) -> FloatArray:
    centre = cell_corners_m.mean(axis=1)
    total, count = np.zeros_like(nodes_m), np.zeros(len(nodes_m))
    for k in range(3):
        np.add.at(total, cell_nodes[:, k], centre)
        np.add.at(count, cell_nodes[:, k], 1)
    return nodes_m + _INWARDS * (total / count[:, None] - nodes_m)


class Partitions:
    """Tells which nodes of a cell are hidden from a point in it: something stands in the cell.

    An object on a floor covers some nodes of the cells that it stands in. They take no part in what is seen beside it.
    """

    def __init__(self, grid: LightGrid, tracer: Tracer):
        self._grid, self._tracer = grid, tracer
        self.is_cut: NDArray[np.bool_] = np.concatenate([self._cut(side) for side in (1.0, -1.0)])
        """(2 C,) cells of both sides in which some node is hidden from another."""

    def seen(self, blend: Blend, points_m: FloatArray, hits: RayHits) -> Blend:
        """Return the blend of n points without the nodes that are hidden from them."""
        cut = np.flatnonzero(self.is_cut[self._grid.cells_of(hits)])
        if not len(cut):
            return blend
        normals = self._tracer.normals_towards(hits[cut])
        weights = blend.weights.copy()
        lift = self._lift(hits.facet[cut])[:, None] * normals
        points = points_m[cut] + lift
        corners = self._grid.node_m[blend.nodes[cut] % self._grid.n_nodes] + lift[:, None]
        visible = np.stack([self._tracer.clear(points, corners[:, k]) for k in range(3)], axis=1)
        kept = np.where(visible, np.maximum(weights[cut], 1e-3), 0)
        total = kept.sum(axis=1, keepdims=True)
        weights[cut] = np.where(total > 0, kept / np.maximum(total, 1e-30), weights[cut])
        return Blend(blend.nodes, weights)

    def _cut(self, side: float) -> NDArray[np.bool_]:
        grid = self._grid
        centre = grid.cell_corners_m.mean(axis=1, keepdims=True)
        lift = side * self._lift(grid.facet_of_cell)[:, None] * self._tracer.normals[grid.facet_of_cell]
        corners = grid.cell_corners_m + _INWARDS * (centre - grid.cell_corners_m) + lift[:, None]
        clear = [self._tracer.clear(corners[:, k], corners[:, (k + 1) % 3]) for k in range(3)]
        return np.asarray(~np.logical_and.reduce(clear))

    def _lift(self, facet: IntArray) -> FloatArray:
        """(n,) a hundredth of the cells' size: above what is uneven in single precision, below what stands there."""
        edge = self._tracer.scene.triangles_m[facet]
        size = np.linalg.norm(edge[:, 1] - edge[:, 0], axis=1) / self._grid.parts[facet]
        return np.asarray(np.maximum(0.01 * size, self._tracer.lift_m))
