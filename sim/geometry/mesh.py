"""Meshes: flat triangles and quads of any size and place."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from sim.arguments import array_of
from sim.arrays import FloatArray, IntArray
from sim.errors import SimulationError
from sim.geometry.checks import checked_topology
from sim.geometry.topology import WELD, Topology


@dataclass(frozen=True, eq=False, kw_only=True)
class Mesh:
    """Flat triangles and quads with a diffuse reflectance a patch; a ``sim.geometry.surface.Surface``.

    Raises
    ------
    SimulationError
        For bad geometry, each kind with its patches (``sim.geometry.checks.mesh_faults``; patches that pierce or
        cover each other are only looked for there), and for a reflectance outside 0 ... 1.
    """

    name: str
    vertices: FloatArray
    """(P, 4, 3) corners, counter-clockwise seen from the lit side; a triangle repeats its last [m]."""
    reflectance: FloatArray
    """(P,) share of the light that a patch sends back, in [0, 1]."""
    convex: bool = False
    """True if every two points on the patches' lit sides see each other."""
    closed: bool = False
    """True if no light can leave."""
    region: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    """(P,) number of the flat region of each patch; empty: found from neighbours in one plane."""

    def __post_init__(self) -> None:
        vertices = np.ascontiguousarray(self.vertices, dtype=np.float64)
        if vertices.ndim != 3 or vertices.shape[1:] != (4, 3) or not len(vertices):
            raise SimulationError(f"mesh {self.name}: vertices of shape {vertices.shape}; expected (P, 4, 3), P > 0")
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "reflectance", self._checked_reflectance(self.reflectance))
        object.__setattr__(self, "region", self._checked_region(self.region, self.topology))

    @classmethod
    def from_arrays(
        cls,
        name: str,
        vertices_m: ArrayLike,
        polygons: Sequence[Sequence[int]] | IntArray,
        reflectance: ArrayLike,
        *,
        convex: bool | None = None,
        closed: bool | None = None,
        region: ArrayLike | None = None,
    ) -> Mesh:
        """Return a mesh of patches that share corners.

        Parameters
        ----------
        name : str
            What messages call it.
        vertices_m : (V, 3) array
            Corners. [m]
        polygons : sequence of 3 or 4 indices each, or (P, 3) or (P, 4) int array
            Corners of each patch, counter-clockwise seen from the lit side; -1 fills the row of a triangle.
        reflectance : float or (P,) array
            In [0, 1].
        convex, closed : bool, optional
            None: found out. Convex: no corner lies behind a patch. Closed: every edge meets another patch's,
            and the lit sides look inwards.
        region : (P,) int array, optional
            None: neighbours in one plane are one region.

        Returns
        -------
        Mesh

        Raises
        ------
        SimulationError
            For bad geometry, a corner that does not exist, a polygon of less than 3 or more than 4 corners.
        """
        corners = _corners(name, array_of(f"mesh {name}: corners", vertices_m), _padded(name, polygons))
        numbers = np.zeros(0, dtype=np.intp) if region is None else np.asarray(region, dtype=np.intp)
        mesh = cls(
            name=name,
            vertices=corners,
            reflectance=array_of(f"mesh {name}: reflectance", reflectance),
            convex=bool(convex),
            closed=bool(closed),
            region=numbers,
        )
        return mesh._with(
            convex=not mesh.topology.covers.any() if convex is None else convex,
            closed=mesh.topology.closed if closed is None else closed,
        )

    @cached_property
    def topology(self) -> Topology:
        """How the patches hang together."""
        return checked_topology(self.name, self.vertices, closed=self.closed, convex=self.convex)

    @property
    def n_patches(self) -> int:
        """Number of patches, P."""
        return len(self.vertices)

    @cached_property
    def areas(self) -> FloatArray:
        """(P,) areas [m²]."""
        return np.asarray(np.linalg.norm(self.topology.area_vectors, axis=1))

    @property
    def normals(self) -> FloatArray:
        """(P, 3) unit normals."""
        return self.topology.normals

    @cached_property
    def centres(self) -> FloatArray:
        """(P, 3) centroids [m]."""
        a, b, c, d = np.moveaxis(self.vertices, 1, 0)
        first = np.linalg.norm(np.cross(b - a, c - a), axis=1, keepdims=True)
        second = np.linalg.norm(np.cross(c - a, d - a), axis=1, keepdims=True)
        return np.asarray((first * (a + b + c) + second * (a + c + d)) / (3 * (first + second)))

    @cached_property
    def occluders(self) -> FloatArray:
        """(M, 4, 3) what something of the mesh lies behind: flat regions that are rectangles, else patches [m]."""
        covers, tolerance_m = self.topology.covers, 4 * WELD * self.topology.size_m
        vertices, region = self.vertices[covers], self.topology.region[covers]
        # A triangle that is a region of its own is no rectangle: of curved surfaces hardly any patch is looked at.
        alone = (np.bincount(region)[region] == 1) & (vertices[:, 2] == vertices[:, 3]).all(axis=1)
        return np.concatenate([_merged(vertices[~alone], region[~alone], tolerance_m), vertices[alone]])

    def with_reflectance(self, reflectance: ArrayLike) -> Mesh:
        """Return the same mesh with another reflectance.

        Parameters
        ----------
        reflectance : float or (P,) array
            In [0, 1].

        Returns
        -------
        Mesh

        Raises
        ------
        SimulationError
            For a reflectance outside 0 ... 1, or one of another shape.
        """
        return self._with(reflectance=self._checked_reflectance(reflectance))

    def _with(self, **values: object) -> Mesh:
        """Copy with other values, the geometry unchecked and shared."""
        other = copy.copy(self)
        for name, value in values.items():
            object.__setattr__(other, name, value)
        return other

    def _checked_reflectance(self, reflectance: ArrayLike) -> FloatArray:
        values = array_of(f"mesh {self.name}: reflectance", reflectance)
        if values.shape not in ((), (self.n_patches,)):
            raise SimulationError(
                f"mesh {self.name}: reflectance of shape {values.shape} for {self.n_patches} patches; "
                "one number or one a patch"
            )
        if not ((values >= 0) & (values <= 1)).all():
            raise SimulationError(
                f"mesh {self.name}: reflectance {values.min():.4g} ... {values.max():.4g}; it must lie in 0 ... 1"
            )
        return np.broadcast_to(values, (self.n_patches,)).copy()

    def _checked_region(self, region: IntArray, topology: Topology) -> IntArray:
        numbers = np.asarray(region, dtype=np.intp)
        if numbers.shape not in ((0,), (self.n_patches,)):
            raise SimulationError(
                f"mesh {self.name}: region of shape {numbers.shape} for {self.n_patches} patches; one number a patch"
            )
        return numbers if len(numbers) else topology.region


def _padded(name: str, polygons: Sequence[Sequence[int]] | IntArray) -> IntArray:
    """(P, 4) corner numbers; a triangle repeats its last."""
    if isinstance(polygons, Sequence):
        try:
            rows = [[int(corner) for corner in polygon] for polygon in polygons]
        except (TypeError, ValueError) as error:
            raise SimulationError(
                f"mesh {name}: a polygon is no row of corner numbers ({error}); give 3 or 4 whole numbers each"
            ) from error
        odd = [i for i, row in enumerate(rows) if len(row) not in (3, 4)]
        if odd:
            raise SimulationError(
                f"mesh {name}: patch {odd[0]} has {len(rows[odd[0]])} corners ({len(odd)} such patches); "
                "cut polygons into triangles and quads"
            )
        polygons = np.array([row + [-1] * (4 - len(row)) for row in rows], dtype=np.intp).reshape(-1, 4)
    polygons = np.asarray(polygons)
    if polygons.ndim != 2 or polygons.shape[1] not in (3, 4) or polygons.dtype.kind not in "iu":
        raise SimulationError(
            f"mesh {name}: polygons of shape {polygons.shape} and type {polygons.dtype}; expected integers (P, 3 or 4)"
        )
    last = polygons[:, -1:].astype(np.intp)
    return np.concatenate([polygons[:, :3], np.where(last < 0, polygons[:, 2:3], last)], axis=1).astype(np.intp)


def _corners(name: str, points: FloatArray, polygons: IntArray) -> FloatArray:
    """(P, 4, 3) corners [m]."""
    if points.ndim != 2 or points.shape[1] != 3:
        raise SimulationError(f"mesh {name}: corners of shape {points.shape}; expected (V, 3)")
    missing = ((polygons < 0) | (polygons >= len(points))).any(axis=1)
    if missing.any():
        first = int(np.flatnonzero(missing)[0])
        raise SimulationError(
            f"mesh {name}: patch {first} has corners {polygons[first].tolist()}, there are 0 ... {len(points) - 1} "
            f"({int(missing.sum())} such patches); correct the polygons, or add the corners"
        )
    return points[polygons]


def _merged(vertices: FloatArray, region: IntArray, tolerance_m: float) -> FloatArray:
    """(M, 4, 3) rectangles in place of regions that are rectangles, and the patches of all others."""
    if not len(vertices):
        return vertices
    _, example, region = np.unique(region, return_index=True, return_inverse=True)
    area_vectors = np.cross(vertices[:, 2] - vertices[:, 0], vertices[:, 3] - vertices[:, 1]) / 2
    total = np.stack([np.bincount(region, column) for column in area_vectors.T], axis=1)
    area = np.linalg.norm(total, axis=1)
    normal = np.asarray(total / area[:, None])
    side = vertices[example, 1] - vertices[example, 0]
    place = _in_frames(vertices - vertices[example, 0][region, None], _axes(side, normal)[region])
    # The side of a small patch may be turned by the rounding of a file; that of the rectangle hardly is.
    origin = _lowest_corner(vertices, region, place[..., 1] + place[..., 0])
    long_side = _lowest_corner(vertices, region, place[..., 1] - place[..., 0]) - origin
    side = np.where((long_side == 0).all(axis=1, keepdims=True), side, long_side)
    place = _in_frames(vertices - origin[region, None], _axes(side, normal)[region])
    low, high = np.full((len(area), 2), np.inf), np.full((len(area), 2), -np.inf)
    np.minimum.at(low, region, place.min(axis=1))
    np.maximum.at(high, region, place.max(axis=1))
    size = high - low
    whole = np.abs(size.prod(axis=1) - area) <= tolerance_m * size.sum(axis=1)
    uv = np.stack([low, np.stack([high[:, 0], low[:, 1]], 1), high, np.stack([low[:, 0], high[:, 1]], 1)], axis=1)
    rectangles = origin[:, None] + np.einsum("nka,nac->nkc", uv, _axes(side, normal))
    return np.concatenate([rectangles[whole], vertices[~whole[region]]])


def _axes(side: FloatArray, normal: FloatArray) -> FloatArray:
    """(N, 2, 3) unit vectors in planes: along a side, and across it."""
    along = side / np.linalg.norm(side, axis=1, keepdims=True)
    return np.stack([along, np.cross(normal, along)], axis=1)


def _in_frames(relative: FloatArray, axes: FloatArray) -> FloatArray:
    """(P, 4, 2) coordinates of corners (P, 4, 3), from an origin, along axes (P, 2, 3) [m]."""
    return np.asarray(np.einsum("pkc,pac->pka", relative, axes))


def _lowest_corner(vertices: FloatArray, region: IntArray, height: FloatArray) -> FloatArray:
    """(N, 3) corner of each region with the smallest of the (P, 4) heights [m]."""
    order = np.lexsort((height.min(axis=1), region))
    patch = order[np.searchsorted(region[order], np.arange(region.max() + 1))]
    return np.asarray(vertices[patch, height[patch].argmin(axis=1)])
