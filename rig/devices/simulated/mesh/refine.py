"""Facets are split where something stands on them or beside them: light changes quickly there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rig.devices.simulated.mesh.gloss import frames_of
from rig.devices.simulated.mesh.light_grid import LightGrid, Partitions, make_light_grid
from rig.devices.simulated.mesh.scene import IntArray, TriangleScene
from rig.devices.simulated.mesh.tracer import Tracer

_FINEST = 1 / 8
"""Of a cell: chosen on a partition that meets a ceiling; what it hides of a cell is then narrower than a pixel."""
_FINEST_BESIDE = 1 / 2
"""The same beside concave edges, where irradiance rises steeply and straight lines between nodes lie below it: half as
wide cells there halve the bias against a path tracer, quarters cost three times as many nodes."""
_STEEP = np.radians(30.0)
"""What rises by more beside a facet is another wall, no bend of the same."""
_MOST_ROUNDS = 16


def refined(scene: TriangleScene, cell_size_m: float) -> tuple[Tracer, LightGrid, Partitions]:
    """Return the tree of a scene that is split where it is cut, its cells and which are cut. Raises ProfileError."""
    for _ in range(_MOST_ROUNDS):
        tracer, grid = Tracer(scene), make_light_grid(scene, cell_size_m)
        partitions = Partitions(grid, tracer)
        cut = grid.facet_of_cell[np.flatnonzero(partitions.is_cut) % grid.n_cells]
        beside = grid.facet_of_cell[_has_a_wall_beside(grid, tracer)]
        longest = np.sqrt(2) * cell_size_m
        large = np.union1d(_longer(scene, cut, longest * _FINEST), _longer(scene, beside, longest * _FINEST_BESIDE))
        if not len(large):
            break
        scene = _quartered(scene, large)
    return tracer, grid, partitions


def _longer(scene: TriangleScene, facets: IntArray, length_m: float) -> IntArray:
    """Those of some facets that have a longer edge, each once."""
    edges = np.roll(scene.triangles_m[facets], -1, axis=1) - scene.triangles_m[facets]
    return np.unique(facets[np.linalg.norm(edges, axis=2).max(axis=1) > length_m])


def _has_a_wall_beside(grid: LightGrid, tracer: Tracer) -> NDArray[np.bool_]:
    """(C,) cells that have something steep within their own size, on either side."""
    middle = grid.cell_corners_m.mean(axis=1)
    size = np.sqrt(2 * grid.cell_area_m2)[:, None]
    axes = frames_of(tracer.normals[grid.facet_of_cell])
    found = np.zeros(grid.n_cells, dtype=bool)
    for side in (1.0, -1.0):
        begin = middle + side * tracer.lift_m * axes[:, 2]
        for angle in np.arange(0, 2 * np.pi, np.pi / 4):
            along = np.cos(angle) * axes[:, 0] + np.sin(angle) * axes[:, 1]
            way = np.cos(_STEEP) * along + side * np.sin(_STEEP) * axes[:, 2]
            found |= ~tracer.clear(begin, begin + size * way)
    return found


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
