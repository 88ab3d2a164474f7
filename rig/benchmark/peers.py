"""Other tools that install from the package index, run in this process when they are there."""

from __future__ import annotations

import importlib
from importlib import metadata
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.arrays import BoolArray, FloatArray
from sim.geometry.surface import Surface

PEERS = ("pyviewfactor", "mitsuba", "embreex", "scipy", "numpy")
"""Distributions; all but the last two are the optional dependency group ``peers``."""
_TOUCHING = 1e-4
"""Share of a segment left out at both ends, so that it does not meet the surfaces it begins and ends on."""


def versions() -> dict[str, str | None]:
    """Version of each peer; none for those that are not installed."""
    return {name: _version(name) for name in PEERS}


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def present(name: str) -> bool:
    """Tell whether a peer is installed."""
    return _version(name) is not None


def pyviewfactor_mesh(surface: Surface) -> Any:
    """The surface as pyviewfactor takes it."""
    pyvista = importlib.import_module("pyvista")
    corners = surface.vertices.reshape(-1, 3)
    faces = np.column_stack([np.full(surface.n_patches, 4), np.arange(len(corners)).reshape(-1, 4)])
    return pyvista.PolyData(corners, faces.ravel())


def pyviewfactor_factors(mesh: Any, occluded: bool = False) -> FloatArray:
    """(P, P) form factors by pyviewfactor; its matrix is the transpose of ours.

    Parameters
    ----------
    mesh
        From :func:`pyviewfactor_mesh`.
    occluded : bool
        Whether it looks for obstructions (a ray between the centres).
    """
    pyviewfactor = importlib.import_module("pyviewfactor")
    obstacles = [mesh] if occluded else None
    found = pyviewfactor.compute_viewfactor_matrix(mesh, obstacles=obstacles, skip_obstruction=not occluded)
    return np.asarray(found).T


class EmbreeOccluders:
    """Quadrilaterals in Embree's tree, asked which segments they cut."""

    def __init__(self, quads: FloatArray) -> None:
        self._scene = importlib.import_module("embreex.rtcore_scene").EmbreeScene()
        triangles = quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3, 3).astype(np.float32)
        # The scene keeps no reference to the mesh's memory.
        self._mesh = importlib.import_module("embreex.mesh_construction").TriangleMesh(self._scene, triangles)

    def cut(self, begin: FloatArray, along: FloatArray) -> BoolArray:
        """(segments,) whether something lies between the ends, which themselves do not count."""
        origin = (begin + _TOUCHING * along).astype(np.float32)
        length = np.full(len(origin), 1 - 2 * _TOUCHING, dtype=np.float32)
        hit: NDArray[np.int32] = self._scene.run(origin, along.astype(np.float32), dists=length, query="OCCLUDED")
        return np.asarray(hit != -1)


class EmbreeTriangles:
    """Triangles in Embree's tree, asked which one a ray meets first."""

    def __init__(self, triangles: FloatArray) -> None:
        self._scene = importlib.import_module("embreex.rtcore_scene").EmbreeScene()
        corners = np.ascontiguousarray(triangles, dtype=np.float32)
        self._mesh = importlib.import_module("embreex.mesh_construction").TriangleMesh(self._scene, corners)

    def first(self, origins: FloatArray, directions: FloatArray) -> NDArray[np.int32]:
        """(rays,) triangle that each ray meets first, -1 for none."""
        hit: NDArray[np.int32] = self._scene.run(origins.astype(np.float32), directions.astype(np.float32))
        return hit
