"""Meshes: flat triangles and quads of any size and place."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from sim.scene import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Mesh:
    """Flat triangles and quads with a diffuse reflectance a patch; a ``sim.surface.Surface``."""

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

    @property
    def n_patches(self) -> int:
        """Number of patches, P."""
        return len(self.vertices)

    @cached_property
    def _area_vectors(self) -> FloatArray:
        # Half the cross product of the diagonals, for triangles (last corner repeated) and flat quads alike.
        corners = self.vertices
        return np.asarray(np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]) / 2)

    @cached_property
    def areas(self) -> FloatArray:
        """(P,) areas [m²]."""
        return np.asarray(np.linalg.norm(self._area_vectors, axis=1))

    @cached_property
    def normals(self) -> FloatArray:
        """(P, 3) unit normals."""
        return np.asarray(self._area_vectors / self.areas[:, None])

    @cached_property
    def centres(self) -> FloatArray:
        """(P, 3) centroids [m]."""
        a, b, c, d = np.moveaxis(self.vertices, 1, 0)
        first = np.linalg.norm(np.cross(b - a, c - a), axis=1, keepdims=True)
        second = np.linalg.norm(np.cross(c - a, d - a), axis=1, keepdims=True)
        return np.asarray((first * (a + b + c) + second * (a + c + d)) / (3 * (first + second)))

    @property
    def occluders(self) -> FloatArray:
        """(M, 4, 3) patches that something of the mesh lies behind [m]."""
        return self.vertices

    def with_reflectance(self, reflectance: ArrayLike) -> Mesh:
        """Give the same mesh another reflectance, one number or one a patch."""
        values = np.broadcast_to(np.asarray(reflectance, dtype=np.float64), (self.n_patches,)).copy()
        return Mesh(self.name, self.vertices, values, self.convex, self.closed, self.region)
