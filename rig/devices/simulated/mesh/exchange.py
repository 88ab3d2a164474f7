"""What the scene's surfaces send to each other, by rays from the nodes of its grid.

Irradiance is collected at nodes and linear between them; light is emitted by cells, evenly. The model (`sim`) has
factors between whole patches: nothing of it is used here.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, vstack
from scipy.sparse.linalg import LinearOperator, gmres

from rig.devices.simulated.mesh.gloss import frames_of
from rig.devices.simulated.mesh.light_grid import LightGrid, Partitions
from rig.devices.simulated.mesh.scene import FloatArray, IntArray, TriangleScene
from rig.devices.simulated.mesh.tracer import RayHits, Tracer
from rig.devices.simulated.mesh.walks import walks
from rig.errors import DeviceError

Float32Array = NDArray[np.float32]

_BATCH_RAYS = 1 << 19
"""Followed together: what they need is some hundred megabytes."""
_GOLDEN = (np.sqrt(5) - 1) / 2
"""Steps of a golden section spread any number of angles evenly; with even radii the rays are as on a sunflower."""
_TOLERANCE = 1e-5
"""Of the solution's residual."""


class Exchange:
    """The nodes' views of the cells, traced as far as somebody asks for.

    Parameters
    ----------
    tracer : Tracer
        Of the scene.
    grid : LightGrid
        Its cells and nodes.
    partitions : Partitions
        What hides nodes from others of their cell.
    rays : int
        From each node.
    seed : int
        Of the rays' directions.
    """

    def __init__(self, tracer: Tracer, grid: LightGrid, partitions: Partitions, *, rays: int, seed: int):
        self.scene: TriangleScene = tracer.scene
        self.tracer, self.grid, self.partitions = tracer, grid, partitions
        self._rays, self._seed = rays, seed
        number = np.arange(rays)
        self._square = np.stack([(number + 0.5) / rays, number * _GOLDEN % 1.0], axis=1)
        self._shifts = np.random.default_rng((seed, 6)).uniform(size=(2 * grid.n_nodes, 2))
        self._traced = np.zeros(2 * grid.n_nodes, dtype=bool)
        self._batches: list[tuple[IntArray, csr_array]] = []
        self._views: csr_array | None = None
        self._cell_nodes = np.concatenate([grid.cell_nodes, grid.cell_nodes + grid.n_nodes])
        self._cell_weights = np.full((2 * grid.n_cells, 3), 1 / 3)
        self._open = self.partitions.is_cut.copy()
        """Cut cells of which no visible point is known yet."""

    @property
    def node_area_m2(self) -> FloatArray:
        """(V,) area that each node stands for; both sides' are the same."""
        share = np.repeat(self.grid.cell_area_m2 / 3, 3)
        return np.bincount(self.grid.cell_nodes.ravel(), share, minlength=self.grid.n_nodes).astype(np.float64)

    def require(self, nodes: IntArray) -> None:
        """Trace from these nodes, and from all that they need in turn."""
        wanted = np.unique(nodes)
        while len(wanted := wanted[~self._traced[wanted]]):
            self._traced[wanted] = True
            seen = np.zeros(2 * self.grid.n_cells, dtype=bool)
            step = max(1, _BATCH_RAYS // self._rays)
            for first in range(0, len(wanted), step):
                some = wanted[first : first + step]
                views = self._traced_from(some)
                seen[views.indices] = True
                self._batches.append((some, views))
            self._views = None
            cells = np.flatnonzero(seen)
            linked = self._cell_weights[cells] > 0
            wanted = np.unique(self._cell_nodes[cells][linked])

    @property
    def views(self) -> csr_array:
        """(2 V, 2 C) share of what reaches each node, were all cells alike, that comes from each cell; lobes count."""
        if self._views is None:
            batches = self._batches  # those of one moment: rigs in two threads may share a world
            order = np.concatenate([nodes for nodes, _ in batches])
            place = np.argsort(order)
            rows = csr_array(vstack([rows for _, rows in batches], format="csr")[place])
            self._batches = [(order[place], rows)]
            self._views = _padded(rows, order[place], 2 * self.grid.n_nodes)
        return self._views

    def irradiance(self, emission: Float32Array, arriving: Float32Array, reflectance: Float32Array) -> Float32Array:
        """(2 V,) irradiance at the nodes, not counting what comes straight from the projector.

        Parameters
        ----------
        emission
            (2 C,) radiosity of the cells by light that comes straight from elsewhere.
        arriving
            (2 V,) irradiance that comes by way of glossy facets.
        reflectance
            (2 C,) matte reflectance.

        Raises
        ------
        DeviceError
            The solution did not converge.
        """
        views = self.views
        first = views @ emission + arriving
        if not first.any():
            return np.zeros(len(first), dtype=np.float32)

        def reflected(irradiance: Float32Array) -> Float32Array:
            there = np.einsum("ck,ck->c", irradiance.astype(np.float32)[self._cell_nodes], self._weights32)
            return np.asarray(views @ (reflectance * there), dtype=np.float32)

        n = len(first)
        system = LinearOperator((n, n), matvec=lambda h: h - reflected(h.ravel()), dtype=np.float32)
        found, info = gmres(system, first, x0=first, rtol=_TOLERANCE, restart=40, maxiter=10)
        if info != 0:
            raise DeviceError(
                "the simulated scene's light did not converge; lower the reflectance in [[simulation.material]]"
            )
        return np.asarray(found, dtype=np.float32)

    @property
    def _weights32(self) -> Float32Array:
        return self._cell_weights.astype(np.float32)

    def _traced_from(self, nodes: IntArray) -> csr_array:
        """(n, 2 C) views of some nodes."""
        n_front = self.grid.n_nodes
        sign = np.where(nodes < n_front, 1.0, -1.0)
        normals = sign[:, None] * self.tracer.normals[self.grid.node_facet[nodes % n_front]]
        origins = self.grid.node_m[nodes % n_front] + self.tracer.lift_m * normals
        chances = (self._square[None] + self._shifts[nodes][:, None]) % 1.0
        directions = _cosine_directions(chances) @ frames_of(normals)
        owner = np.repeat(np.arange(len(nodes)), self._rays)
        random = np.random.default_rng((self._seed, 7, int(nodes[0])))
        rows, cells, shares = [], [], []
        even, begin = np.ones(len(owner)), np.repeat(origins, self._rays, axis=0)
        for leg in walks(self.tracer, begin, directions.reshape(-1, 3), share=even, random=random):
            found = self.grid.cells_of(leg.hits)
            self._look_into_cut(found, leg.hits)
            rows.append(owner[leg.walk])
            cells.append(found)
            shares.append(leg.share / self._rays)
        data = (np.concatenate(shares).astype(np.float32), (np.concatenate(rows), np.concatenate(cells)))
        return csr_array(data, shape=(len(nodes), 2 * self.grid.n_cells))

    def _look_into_cut(self, cells: IntArray, hits: RayHits) -> None:
        """Learn from the first ray that lands in a cut cell which of its nodes are on the side that can be seen."""
        landed = np.flatnonzero(self._open[cells])
        if not len(landed):
            return
        found, first = np.unique(cells[landed], return_index=True)
        some = hits[landed[first]]
        blend = self.grid.blend_of(some)
        even = blend._replace(weights=np.full_like(blend.weights, 1 / 3))
        seen = self.partitions.seen(even, self.tracer.points_m(some), some)
        # `blend` has the nodes in another order than the cell's own list.
        order = np.argsort(np.argsort(self._cell_nodes[found], axis=1), axis=1)
        sorted_weights = np.take_along_axis(seen.weights, np.argsort(seen.nodes, axis=1), axis=1)
        self._cell_weights[found] = np.take_along_axis(sorted_weights, order, axis=1)
        self._open[found] = False


def _padded(rows: csr_array, numbers: IntArray, n_rows: int) -> csr_array:
    """Rows of these ascending numbers; the others are empty."""
    lengths = np.zeros(n_rows, dtype=rows.indptr.dtype)
    lengths[numbers] = np.diff(rows.indptr)
    pointer = np.concatenate([[0], np.cumsum(lengths)])
    return csr_array((rows.data, rows.indices, pointer), shape=(n_rows, rows.shape[1]))


def _cosine_directions(chances: FloatArray) -> FloatArray:
    """(..., 3) directions about the third axis, as many as their cosine, of even chances (..., 2)."""
    r, phi = np.sqrt(chances[..., 0]), 2 * np.pi * chances[..., 1]
    z = np.sqrt(np.maximum(1 - chances[..., 0], 0))
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=-1)
