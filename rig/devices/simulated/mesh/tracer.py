"""Rays through triangles by Embree: what they hit, and what sees what."""

from __future__ import annotations

import importlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.devices.simulated.mesh.scene import FloatArray, IntArray, TriangleScene
from rig.errors import ProfileError

BoolArray = NDArray[np.bool_]

_LIFT = 2e-5
"""Of the scene's size: how far rays begin above the facet that they leave; a hundred times single precision's step."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RayHits:
    """Where n rays meet the scene first."""

    facet: IntArray
    """(n,) triangle; -1 where a ray escapes."""
    is_back: BoolArray
    """(n,) it is met from behind."""
    u: FloatArray
    """(n,) weight of the triangle's second corner."""
    v: FloatArray
    """(n,) weight of its third corner."""

    def __getitem__(self, chosen: BoolArray | IntArray) -> RayHits:
        return RayHits(facet=self.facet[chosen], is_back=self.is_back[chosen], u=self.u[chosen], v=self.v[chosen])

    @property
    def escaped(self) -> BoolArray:
        """(n,) nothing was met."""
        return np.asarray(self.facet < 0)


class Tracer:
    """A scene in Embree's tree.

    Raises
    ------
    ProfileError
        Embree is not installed; the message names the command.
    """

    def __init__(self, scene: TriangleScene):
        try:
            rtcore_scene = importlib.import_module("embreex.rtcore_scene")
            mesh_construction = importlib.import_module("embreex.mesh_construction")
        except ImportError as error:
            raise ProfileError(
                f"simulation.scene: needs Embree, which is not installed ({error}): pip install 'procam-rig[world]'"
            ) from error
        self.scene = scene
        self.normals = scene.normals
        self._middle_m = scene.triangles_m.reshape(-1, 3).mean(axis=0)  # single precision is finest about 0
        self.lift_m = _LIFT * scene.size_m
        self._tree = rtcore_scene.EmbreeScene()
        corners = (scene.triangles_m - self._middle_m).astype(np.float32)
        # The tree keeps no reference to the mesh's memory.
        self._mesh = mesh_construction.TriangleMesh(self._tree, corners)

    def hits(self, origins_m: FloatArray, directions: FloatArray) -> RayHits:
        """Follow n rays, (n, 3), from their origins, (n, 3) or (3,)."""
        begin, along = self._rays(origins_m, directions)
        found = self._tree.run(begin, along, query="INTERSECT", output=True)
        facet = found["primID"].astype(np.int64)
        is_back = np.einsum("ij,ij->i", self.normals[facet], directions) > 0
        return RayHits(facet=facet, is_back=is_back, u=found["u"].astype(float), v=found["v"].astype(float))

    def clear(self, begin_m: FloatArray, end_m: FloatArray) -> BoolArray:
        """(n,) whether nothing lies between points (n, 3) and (n, 3) or (3,)."""
        begin, along = self._rays(begin_m, end_m - begin_m)
        length = np.full(len(begin), 1 - 1e-5, dtype=np.float32)
        return np.asarray(self._tree.run(begin, along, dists=length, query="OCCLUDED") == -1)

    def points_m(self, hits: RayHits) -> FloatArray:
        """(n, 3) where the rays landed; meaningless where they escaped."""
        a, b, c = np.moveaxis(self.scene.triangles_m[hits.facet], 1, 0)
        return np.asarray(a + hits.u[:, None] * (b - a) + hits.v[:, None] * (c - a))

    def normals_towards(self, hits: RayHits) -> FloatArray:
        """(n, 3) normals on the side that the rays came from."""
        return np.where(hits.is_back[:, None], -self.normals[hits.facet], self.normals[hits.facet])

    def lifted_m(self, hits: RayHits) -> FloatArray:
        """(n, 3) where they landed, a little above the facet."""
        return self.points_m(hits) + self.lift_m * self.normals_towards(hits)

    def _rays(self, begin_m: FloatArray, along: FloatArray) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        begin = np.broadcast_to(begin_m - self._middle_m, along.shape)
        return np.ascontiguousarray(begin, dtype=np.float32), np.ascontiguousarray(along, dtype=np.float32)
