"""The measured room in patches: walls, and the fronts and backs of what stands before them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calibration.geometry.pinhole import PinholeModel
from calibration.light.alike import Alike
from calibration.surfaces.bodies import sides_between
from rig.profile.schema import refuse_many_patches
from rig.stages.correspondence import only
from rig.stages.geometry import GeometryRecord, Point
from rig.stages.surface.openings import behind_walls, on_the_way, sides_of_openings, with_openings
from rig.stages.surface.standing import StandingRecord
from rig.stages.surface.walls import WallPatches, finer_along, finer_where, finest_m, points_on, seen_edges
from sim.form_factors import FormFactors, form_factors
from sim.geometry.mesh import Mesh
from sim.geometry.scene import Scene
from sim.scenes.gridded import room

FloatArray = NDArray[np.float64]

_BACK_SHARE = 5e-4
"""How far behind its front the back of a surface is put, of the room's largest size: rays have to tell them apart."""
_RAYS = 1024
"""Of each patch: the light on a patch comes out to about 0.2 %, far below what reflectances are known to."""

AnyScene = Scene | Mesh
"""The patches of a room: gridded rectangles, or also triangles."""


def scene_of(geometry: GeometryRecord, patch_size_m: float, standing: StandingRecord | None) -> AnyScene:
    """Return the measured room in patches, of reflectance one half: walls first, then fronts, then backs.

    Of a surface only its front is seen. Its back is taken to be close behind, or where the record says, with sides
    between, and as reflective: between it and the walls light goes to and fro as it does behind the real thing.
    """
    surface = geometry.surface
    refuse_many_patches(surface.size_m, patch_size_m)
    walls = room(surface.size_m, patch_size_m, 0.5, surface.faces, name="measured room")
    if standing is None or not standing.triangles:
        return walls
    fronts = np.array(standing.vertices_m)[np.array(standing.triangles)]
    outside = np.zeros(len(fronts), dtype=bool)
    if standing.openings:
        outside = behind_walls(fronts, surface.size_m)
    devices = _devices(geometry) if standing.finer_edges or outside.any() else []
    fine = _fine_walls(geometry, walls, standing, outside=outside, devices=devices)
    corners, region = _things(standing, surface.size_m, outside, devices=devices, first=len(walls.faces))
    return Mesh(
        name="measured room",
        vertices=np.concatenate([fine.vertices_m, corners]),
        reflectance=np.full(len(fine.region) + len(region), 0.5),
        region=np.concatenate([fine.region, region]),
    )


def _devices(geometry: GeometryRecord) -> list[PinholeModel]:
    """The camera and the projector."""
    return [device.pinhole() for device in (only(geometry.cameras), only(geometry.projectors))]


def _fine_walls(
    geometry: GeometryRecord,
    walls: Scene,
    standing: StandingRecord,
    *,
    outside: NDArray[np.bool_],
    devices: Sequence[PinholeModel],
) -> WallPatches:
    """The walls, finer where something touches them and along lit edges, without what is an opening in them."""
    surface, finest = geometry.surface, finest_m(walls)
    vertices, triangles = np.array(standing.vertices_m), np.array(standing.triangles)
    near = points_on(vertices, triangles, finest) if standing.finer_walls else np.zeros((0, 3))
    behind = points_on(vertices, triangles[outside], finest)
    through = [on_the_way(behind, surface.size_m, device.position_m) for device in devices]
    fine = finer_where(walls, np.concatenate([near, *through]))
    if standing.finer_edges:
        fine = finer_along(walls, fine, seen_edges(surface.size_m, surface.faces, devices, finest))
    if not outside.any():
        return fine
    return with_openings(fine, vertices[triangles[outside]], [device.position_m for device in devices])


def _things(
    standing: StandingRecord,
    size_m: Point,
    outside: NDArray[np.bool_],
    *,
    devices: Sequence[PinholeModel],
    first: int,
) -> tuple[FloatArray, NDArray[np.intp]]:
    """Fronts of what stands, backs and sides: (T, 4, 3) corners, and (T,) numbers of their regions from the first."""
    vertices, triangles = np.array(standing.vertices_m), np.array(standing.triangles)
    front, n_parts = first + np.array(standing.part), len(standing.flat)
    corners, region = [vertices[triangles][:, [0, 1, 2, 2]]], [front]
    if standing.backs:
        back = front + n_parts
        behind = vertices - _BACK_SHARE * max(size_m) * _normals(vertices, triangles)
        if standing.backs_m is not None:
            behind = np.array(standing.backs_m)
            sides, owner, _ = sides_between(vertices, behind, triangles)
            corners.append(sides)
            region.append(back[owner])
        if outside.any():
            positions = [device.position_m for device in devices]
            part = np.array(standing.part)[outside]
            sides, owner = sides_of_openings(vertices, triangles[outside], part, size_m=size_m, devices_m=positions)
            corners.append(sides)
            region.append(back[outside][owner])
        corners.append(behind[triangles[:, ::-1]][:, [0, 1, 2, 2]])
        region.append(back)
    return np.concatenate(corners), np.concatenate(region)


def alike_in(geometry: GeometryRecord, standing: StandingRecord | None) -> Alike:
    """Return what the surfaces of that room are to each other: walls first, then fronts, then backs."""
    n_walls = len(geometry.surface.faces)
    if standing is None or not standing.triangles:
        return Alike.only_walls(n_walls)
    return Alike.with_things(n_walls, len(standing.flat), backs=standing.backs)


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
