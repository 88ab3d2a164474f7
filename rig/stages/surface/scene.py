"""The measured room in patches: walls, and the fronts and backs of what stands before them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibration.light.alike import Alike
from calibration.surfaces.bodies import rim_of
from rig.profile.schema import refuse_many_patches
from rig.stages.correspondence import only
from rig.stages.geometry import GeometryRecord
from rig.stages.surface.standing import StandingRecord
from rig.stages.surface.walls import finer_along, finer_where, finest_m, points_on, seen_edges
from sim.form_factors import FormFactors, form_factors
from sim.geometry.mesh import Mesh
from sim.geometry.scene import Scene
from sim.scenes.gridded import room

FloatArray = NDArray[np.float64]

_BACK_SHARE = 5e-4
"""How far behind its front the back of a surface is put, of the room's largest size: rays have to tell them apart."""
_NO_AREA_M2 = 1e-6
"""Of a side between front and back: one that runs straight away from the devices has none."""
_RAYS = 1024
"""Of each patch: the light on a patch comes out to about 0.2 %, far below what reflectances are known to."""

AnyScene = Scene | Mesh
"""The patches of a room: gridded rectangles, or also triangles."""


def scene_of(geometry: GeometryRecord, patch_size_m: float, standing: StandingRecord | None) -> AnyScene:
    """Return the measured room in patches, of reflectance one half: walls first, then fronts, then backs.

    Of a surface only its front is seen. Its back is taken to be close behind, or where the record says, with sides
    between, and as reflective: between it and the walls light goes to and fro as it does behind the real thing.
    """
    refuse_many_patches(geometry.surface.size_m, patch_size_m)
    walls = room(geometry.surface.size_m, patch_size_m, 0.5, geometry.surface.faces, name="measured room")
    if standing is None or not standing.triangles:
        return walls
    vertices, triangles = np.array(standing.vertices_m), np.array(standing.triangles)
    part, n_parts = np.array(standing.part), len(standing.flat)
    first = len(walls.faces)
    corners, region = [vertices[triangles][:, [0, 1, 2, 2]]], [first + part]
    if standing.backs:
        behind = vertices - _BACK_SHARE * max(geometry.surface.size_m) * _normals(vertices, triangles)
        if standing.backs_m is not None:
            behind = np.array(standing.backs_m)
            sides, owner = _sides(vertices, behind, triangles)
            corners.append(sides)
            region.append(first + n_parts + part[owner])
        corners.append(behind[triangles[:, ::-1]][:, [0, 1, 2, 2]])
        region.append(first + n_parts + part)
    near = points_on(vertices, triangles, finest_m(walls)) if standing.finer_walls else np.zeros((0, 3))
    fine = finer_where(walls, near)
    if standing.finer_edges:
        devices = [device.pinhole() for device in (only(geometry.cameras), only(geometry.projectors))]
        surface = geometry.surface
        fine = finer_along(walls, fine, seen_edges(surface.size_m, surface.faces, devices, finest_m(walls)))
    return Mesh(
        name="measured room",
        vertices=np.concatenate([fine.vertices_m, *corners]),
        reflectance=np.full(len(fine.region) + sum(len(some) for some in region), 0.5),
        region=np.concatenate([fine.region, *region]),
    )


def alike_in(geometry: GeometryRecord, standing: StandingRecord | None) -> Alike:
    """Return what the surfaces of that room are to each other: walls first, then fronts, then backs."""
    n_walls = len(geometry.surface.faces)
    if standing is None or not standing.triangles:
        return Alike.only_walls(n_walls)
    return Alike.with_things(n_walls, len(standing.flat), backs=standing.backs)


def _sides(
    vertices_m: FloatArray, behind_m: FloatArray, triangles: NDArray[np.intp]
) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return (S, 4, 3) triangles between rims of fronts and backs, and (S,) the front's triangle that each is of."""
    rim, owner = rim_of(triangles)
    (a, b), (c, d) = (corners[rim].swapaxes(0, 1) for corners in (vertices_m, behind_m))
    sides = np.concatenate([np.stack([b, a, c, c], axis=1), np.stack([b, c, d, d], axis=1)])
    double_m2 = np.linalg.norm(np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0]), axis=1)
    wide = double_m2 > _NO_AREA_M2
    return sides[wide], np.concatenate([owner, owner])[wide]


def _normals(vertices_m: FloatArray, triangles: NDArray[np.intp]) -> FloatArray:
    """(V, 3) unit normals at vertices: the mean of the triangles that meet there, by area."""
    a, b, c = (vertices_m[triangles[:, k]] for k in range(3))
    doubled = np.cross(b - a, c - a)
    total = np.zeros_like(vertices_m)
    for k in range(3):
        np.add.at(total, triangles[:, k], doubled)
    return np.asarray(total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), np.finfo(float).tiny))


def factors_of(scene: AnyScene) -> FormFactors:
    """Return the form factors of a measured room: exact of walls alone, else by rays, shadows and all."""
    return form_factors(scene) if isinstance(scene, Scene) else form_factors(scene, "rays", rays=_RAYS)


def upright_regions(scene: AnyScene) -> NDArray[np.intp]:
    """Return the numbers of the regions that are walls, or stand like walls."""
    numbers = np.unique(scene.region)
    lean = np.array([np.abs(scene.normals[scene.region == k, 2]).mean() for k in numbers])
    return np.asarray(numbers[lean < 0.5], dtype=np.intp)
