"""What stands before the walls of a room, found where the code says that light does not land on them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.geometry.room import RoomBox
from calibration.surfaces.before_walls import before_walls
from calibration.surfaces.flat_parts import parts_of
from calibration.surfaces.pieces import pieces_of
from calibration.surfaces.point_map import point_map
from calibration.surfaces.triangulated import TriangulatedSurface, triangulated
from rig.records import Record
from rig.session import Session
from rig.stages.correspondence import load_correspondence, only
from rig.stages.geometry import GeometryRecord, Point

LEAST_PIXELS = 40
"""Camera pixels of a part of surface: in fewer, no plane is told from a bend."""


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
    def of(cls, surface: TriangulatedSurface, share_of_image: float, share_left_out: float) -> StandingRecord:
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
    stands = before_walls(correspondence, box).stands
    points = point_map(correspondence, camera, projector, stands)
    pieces = pieces_of(points, stands, LEAST_PIXELS)
    parts = parts_of(points, pieces, LEAST_PIXELS)
    found = triangulated(points, parts, camera, session.profile.room.patch_size_m)
    valid = max(int(correspondence.valid.sum()), 1)
    seen = int((parts.label >= 0).sum())
    return StandingRecord.of(found, seen / valid, (int(stands.sum()) - seen) / valid)
