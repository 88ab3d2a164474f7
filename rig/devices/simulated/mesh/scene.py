"""A scene of triangles, as the simulated world is told of it: where they are, and what they do with light."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rig.errors import ProfileError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

LARGEST_ALBEDO = 0.99
"""Of matte and glossy reflection together; above it interreflection takes hundreds of bounces."""
_LARGEST_ASPECT = 4.0
"""Longest edge over the height on it; chosen: facets that are cut into similar ones would be slivers beyond it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TriangleScene:
    """Triangles, each with a material; both sides of a triangle reflect alike.

    Matte reflection is Lambert's; glossy reflection is a microfacet lobe without colour
    (:mod:`rig.devices.simulated.mesh.gloss`).
    """

    name: str
    triangles_m: FloatArray
    """(T, 3, 3) corners."""
    material: IntArray
    """(T,) index of each triangle's material."""
    materials: tuple[str, ...]
    """Their names."""
    reflectance: FloatArray
    """(T, 3) matte reflectance in red, green and blue."""
    gloss: FloatArray
    """(T,) share of light that the glossy lobe sends back at most."""
    roughness: FloatArray
    """(T,) width of the lobe: the GGX distribution's alpha."""

    @property
    def normals(self) -> FloatArray:
        """(T, 3) unit normals, by the order of the corners."""
        a, b, c = np.moveaxis(self.triangles_m, 1, 0)
        across = np.cross(b - a, c - a)
        return np.asarray(across / np.linalg.norm(across, axis=1, keepdims=True))

    @property
    def size_m(self) -> float:
        """Diagonal of the box around it."""
        corners = self.triangles_m.reshape(-1, 3)
        return float(np.linalg.norm(np.ptp(corners, axis=0)))


def made_fit(scene: TriangleScene, longest_m: float) -> TriangleScene:
    """Return the scene without triangles that have no area, long ones halved until they are no slivers.

    Raises
    ------
    ProfileError
        Nothing is left; a corner is no number; or something reflects more than it may.
    """
    if not np.isfinite(scene.triangles_m).all():
        raise ProfileError(f"simulation.scene {scene.name}: a corner is not a number; export the mesh again")
    flat = _heights_m(scene.triangles_m)[1] <= 1e-9 * max(scene.size_m, 1e-9)
    scene = _chosen(scene, np.flatnonzero(~flat))
    if not len(scene.triangles_m):
        raise ProfileError(f"simulation.scene {scene.name}: has no triangle with an area; export surfaces")
    _refuse_bright(scene)
    while True:
        edge_m, height_m = _heights_m(scene.triangles_m)
        long = (edge_m > longest_m) & (edge_m > _LARGEST_ASPECT * height_m)
        if not long.any():
            return scene
        scene = _halved(scene, long)


def _heights_m(triangles_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(T,) longest edge of each triangle, and the height on it."""
    edges = np.roll(triangles_m, -1, axis=1) - triangles_m
    longest = np.linalg.norm(edges, axis=2).max(axis=1)
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    return longest, area / np.maximum(longest, 1e-30)


def _refuse_bright(scene: TriangleScene) -> None:
    albedo = scene.reflectance.max(axis=1) + scene.gloss
    worst = int(np.argmax(albedo))
    if albedo[worst] > LARGEST_ALBEDO + 1e-9:
        name = scene.materials[scene.material[worst]]
        raise ProfileError(
            f"simulation.scene {scene.name}: material {name!r} reflects {albedo[worst]:.3g} in all, more than "
            f"{LARGEST_ALBEDO}; lower its reflectance or gloss in [[simulation.material]]"
        )


def _halved(scene: TriangleScene, long: NDArray[np.bool_]) -> TriangleScene:
    """Cut the longest edge of some triangles in the middle."""
    t = scene.triangles_m[long]
    first = np.linalg.norm(np.roll(t, -1, axis=1) - t, axis=2).argmax(axis=1)
    a, b, c = (np.take_along_axis(t, ((first + k) % 3)[:, None, None], axis=1)[:, 0] for k in range(3))
    middle = (a + b) / 2
    halves = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    index = np.flatnonzero(long)
    kept = _chosen(scene, np.concatenate([np.flatnonzero(~long), index, index]))
    return replace(kept, triangles_m=np.concatenate([scene.triangles_m[~long], halves]))


def _chosen(scene: TriangleScene, index: IntArray) -> TriangleScene:
    return replace(
        scene,
        triangles_m=scene.triangles_m[index],
        material=scene.material[index],
        reflectance=scene.reflectance[index],
        gloss=scene.gloss[index],
        roughness=scene.roughness[index],
    )
