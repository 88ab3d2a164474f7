"""What the light falls on: the room's walls in patches, and, of a free surface, whatever stands before them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.geometry.room import RoomBox
from calibration.surfaces.before_walls import before_walls
from calibration.surfaces.flat_parts import parts_of
from calibration.surfaces.free_surface import FreeSurface, triangulated
from calibration.surfaces.pieces import pieces_of
from calibration.surfaces.point_map import point_map
from rig.profile.schema import refuse_many_patches
from rig.records import Record
from rig.session import Session
from rig.stages.correspondence import load_correspondence, only
from rig.stages.geometry import GeometryRecord, Point
from sim.form_factors import FormFactors, form_factors
from sim.geometry.mesh import Mesh
from sim.geometry.scene import Scene
from sim.scenes.gridded import room

FloatArray = NDArray[np.float64]

LEAST_PIXELS = 40
"""Camera pixels of a part of surface, and of a patch before its light counts."""
_BACK_SHARE = 5e-4
"""How far behind its front the back of a surface is put, of the room's largest size: rays have to tell them apart."""

_RAYS = 1024
"""Of each patch: the light on a patch comes out to about 0.2 %, far below what reflectances are known to."""

AnyScene = Scene | Mesh
"""The patches of a room: gridded rectangles, or also triangles."""


@dataclass(frozen=True, kw_only=True)
class StandingRecord(Record):
    """What stands before the walls, as triangles that the camera sees."""

    vertices_m: tuple[Point, ...]
    triangles: tuple[tuple[int, int, int], ...]
    part: tuple[int, ...]
    """Part of surface of each triangle."""
    flat: tuple[bool, ...]
    """Of each part: a plane."""
    sigma_m: tuple[float, ...]
    """Standard deviation of each vertex along the camera's ray, of the correspondence alone."""
    share_of_image: float
    """Of the valid pixels, those that see something before the walls."""
    share_left_out: float
    """Of the valid pixels, those of pieces that are too small for a surface."""

    @classmethod
    def of(cls, surface: FreeSurface, share_of_image: float, share_left_out: float) -> StandingRecord:
        """Return the record of a surface."""
        return cls(
            vertices_m=tuple((x, y, z) for x, y, z in surface.vertices_m.tolist()),
            triangles=tuple((a, b, c) for a, b, c in surface.triangles.tolist()),
            part=tuple(surface.part.tolist()),
            flat=tuple(surface.flat.tolist()),
            sigma_m=tuple(surface.sigma_m.tolist()),
            share_of_image=share_of_image,
            share_left_out=share_left_out,
        )


def standing_of(session: Session, geometry: GeometryRecord, shift_m: Point) -> StandingRecord | None:
    """Return what stands before the walls of a room whose surface is free; None of one that is a box.

    Both devices are moved by so much against walls that nobody measured.
    """
    if session.profile.surface.kind != "free":
        return None
    correspondence = load_correspondence(session)
    devices = (only(devices).pinhole() for devices in (geometry.cameras, geometry.projectors))
    camera, projector = (
        replace(device, translation_m=device.translation_m - device.rotation @ np.array(shift_m)) for device in devices
    )
    surface = geometry.surface
    box = RoomBox(
        size_m=surface.size_m,
        seen=surface.seen,
        faces=surface.faces,
        camera=camera,
        projector=projector,
        angle_error_deg=surface.angle_error_deg,
        notes=surface.notes,
    )
    stands = before_walls(correspondence, camera, projector, box).stands
    points = point_map(correspondence, camera, projector, stands)
    pieces = pieces_of(points, stands, LEAST_PIXELS)
    parts = parts_of(points, pieces, LEAST_PIXELS)
    found = triangulated(points, parts, camera, session.profile.room.patch_size_m)
    valid = max(int(correspondence.valid.sum()), 1)
    seen = int((parts.label >= 0).sum())
    return StandingRecord.of(found, seen / valid, (int(stands.sum()) - seen) / valid)


def scene_of(geometry: GeometryRecord, patch_size_m: float, standing: StandingRecord | None) -> AnyScene:
    """Return the measured room in patches, of reflectance one half: walls first, then fronts, then backs.

    Of a surface only its front is seen. Its back is taken to be close behind, and as reflective: between it and the
    walls light goes to and fro as it does behind the real thing.
    """
    refuse_many_patches(geometry.surface.size_m, patch_size_m)
    walls = room(geometry.surface.size_m, patch_size_m, 0.5, geometry.surface.faces, name="measured room")
    if standing is None or not standing.triangles:
        return walls
    vertices, triangles = np.array(standing.vertices_m), np.array(standing.triangles)
    behind = vertices - _BACK_SHARE * max(geometry.surface.size_m) * _normals(vertices, triangles)
    corners, backs = vertices[triangles], behind[triangles[:, ::-1]]
    part, n_parts = np.array(standing.part), len(standing.flat)
    first = len(walls.faces)
    return Mesh(
        name="measured room",
        vertices=np.concatenate([walls.vertices, *(each[:, [0, 1, 2, 2]] for each in (corners, backs))]),
        reflectance=np.full(walls.n_patches + 2 * len(corners), 0.5),
        region=np.concatenate([walls.region, first + part, first + n_parts + part]),
    )


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


def names_of_regions(geometry: GeometryRecord, standing: StandingRecord | None) -> Mapping[int, str]:
    """Return what people call the regions of the scene."""
    names = dict(enumerate(geometry.surface.faces))
    first, n_parts = len(names), 0 if standing is None else len(standing.flat)
    names |= {first + k: f"part {k + 1}" for k in range(n_parts)}
    return names | {first + n_parts + k: f"back of part {k + 1}" for k in range(n_parts)}


def upright_regions(scene: AnyScene) -> NDArray[np.intp]:
    """Return the numbers of the regions that are walls, or stand like walls."""
    numbers = np.unique(scene.region)
    lean = np.array([np.abs(scene.normals[scene.region == k, 2]).mean() for k in numbers])
    return np.asarray(numbers[lean < 0.5], dtype=np.intp)
