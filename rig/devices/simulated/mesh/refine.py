"""Facets are split where something else stands on them or pierces them, so that light may change quickly there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rig.devices.simulated.mesh.light_grid import LightGrid, Partitions, make_light_grid
from rig.devices.simulated.mesh.scene import IntArray, TriangleScene
from rig.devices.simulated.mesh.tracer import Tracer

_FINEST = 1 / 8
"""Of a cell: chosen on a partition that meets a ceiling, where a whole cell lost up to 8 % of the light in the corner,
and an eighth loses nothing that a path tracer can see."""
_MOST_ROUNDS = 16


def refined(scene: TriangleScene, cell_size_m: float) -> tuple[Tracer, LightGrid, Partitions]:
    """Return the tree of a scene that is split where it is cut, its cells and which are cut. Raises ProfileError."""
    for _ in range(_MOST_ROUNDS):
        tracer, grid = Tracer(scene), make_light_grid(scene, cell_size_m)
        partitions = Partitions(grid, tracer)
        cut = np.unique(grid.facet_of_cell[np.flatnonzero(partitions.is_cut) % grid.n_cells])
        edges = np.roll(scene.triangles_m[cut], -1, axis=1) - scene.triangles_m[cut]
        longest = np.linalg.norm(edges, axis=2).max(axis=1)
        large = cut[longest > np.sqrt(2) * cell_size_m * _FINEST]
        if not len(large):
            break
        scene = _quartered(scene, large)
    return tracer, grid, partitions


def _quartered(scene: TriangleScene, facets: IntArray) -> TriangleScene:
    """Replace each of some triangles by four similar ones."""
    a, b, c = np.moveaxis(scene.triangles_m[facets], 1, 0)
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    parts = [np.stack(three, axis=1) for three in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (bc, ca, ab))]
    kept = np.setdiff1d(np.arange(len(scene.triangles_m)), facets)
    index = np.concatenate([kept, np.tile(facets, 4)])
    return replace(
        scene,
        triangles_m=np.concatenate([scene.triangles_m[kept], *parts]),
        material=scene.material[index],
        reflectance=scene.reflectance[index],
        gloss=scene.gloss[index],
        roughness=scene.roughness[index],
    )
