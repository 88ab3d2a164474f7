"""What stands before the walls of a room, found where the code says that light does not land on them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.geometry.room import RoomBox
from calibration.surfaces.before_walls import apart_from_walls, before_walls
from calibration.surfaces.bodies import guesses_of_backs
from calibration.surfaces.continued import Continued, continued
from calibration.surfaces.flat_parts import parts_of
from calibration.surfaces.pieces import pieces_of
from calibration.surfaces.point_map import point_map
from calibration.surfaces.triangulated import TriangulatedSurface, triangulated
from calibration.surfaces.up_to_walls import up_to_walls
from rig.profile.tables import FreeSurface, SurfaceFile
from rig.records import Record
from rig.session import Session
from rig.stages.correspondence import load_correspondence, only
from rig.stages.geometry import GeometryRecord, Point
from rig.stages.surface.known import KnownSurface, RegistrationRecord, known_surface
from rig.stages.surface.positions import PositionRecord, less_guessed, positions_of, surfaces_elsewhere
from rig.stages.surface.triangles import flat_parts

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
    backs: bool = True
    """Each triangle has a back close behind it, which nobody saw; False of a known body, which has its own."""
    finer_walls: bool = False
    """The walls have finer patches where this stands; False of sessions of older versions, fitted without."""
    finer_edges: bool = False
    """The same beside edges between walls that the camera sees, and the projector lights."""
    openings: bool = False
    """Walls end where something is seen behind them; False of sessions of older versions, fitted without."""
    n_continued: int = 0
    """Of the triangles, the last so many, which nobody saw: flat parts that the picture's border cuts go on there."""
    backs_m: tuple[Point, ...] | None = None
    """Where each vertex has its back, which nobody saw, with sides between; None: close behind."""
    registration: RegistrationRecord | None = None
    """How a known mesh was found; None of what was measured point by point."""
    positions: tuple[PositionRecord, ...] = ()
    """Other positions of the camera, whose points are merged into it; their triangles follow the camera's own."""

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
            finer_walls=True,
            finer_edges=True,
            openings=True,
        )

    def with_elsewhere(self, more: TriangulatedSurface, position: PositionRecord) -> StandingRecord:
        """Return the record with what only another position saw."""
        first, part = len(self.vertices_m), len(self.flat)
        return replace(
            self,
            vertices_m=(*self.vertices_m, *((x, y, z) for x, y, z in more.vertices_m.tolist())),
            triangles=(*self.triangles, *((a, b, c) for a, b, c in (more.triangles + first).tolist())),
            part=(*self.part, *(more.part + part).tolist()),
            flat=(*self.flat, *more.flat.tolist()),
            sigma_m=(*self.sigma_m, *more.sigma_m.tolist()),
            positions=(*self.positions, position),
        )

    def carried_on(self, more: Continued) -> StandingRecord:
        """Return the record with flat parts carried on; the light has to tell whether they do."""
        first = len(self.vertices_m)
        usual_m = float(np.median(self.sigma_m)) if self.sigma_m else 0.0
        return replace(
            self,
            vertices_m=(*self.vertices_m, *((x, y, z) for x, y, z in more.vertices_m.tolist())),
            triangles=(*self.triangles, *((a, b, c) for a, b, c in (more.triangles + first).tolist())),
            part=(*self.part, *more.part.tolist()),
            sigma_m=(*self.sigma_m, *(usual_m,) * len(more.vertices_m)),
            n_continued=len(more.triangles),
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class FoundStanding:
    """What stands before the walls, and how far the camera's points are from it where it is a known mesh."""

    record: StandingRecord
    misfit_m: NDArray[np.float64] | None = None
    """(H, W) by which they lie before it; NaN where none of it is seen."""
    carried_on: StandingRecord | None = None
    """The same with its flat parts carried on beyond the picture's border; None where all end at edges."""
    box: RoomBox | None = None
    """The room and the devices in it; None of a known mesh, which has backs of its own."""

    def with_other_backs(self, record: StandingRecord) -> tuple[StandingRecord, ...]:
        """Return one of the records with its things as deep as they are wide, in each way that they may be.

        None of a known mesh, nor where nothing was seen that may be deep.
        """
        if self.box is None or not record.triangles:
            return ()
        vertices, triangles = np.array(record.vertices_m), np.array(record.triangles)
        guesses = guesses_of_backs(vertices, triangles, np.array(record.part), flat=np.array(record.flat), box=self.box)
        return tuple(replace(record, backs_m=tuple((x, y, z) for x, y, z in backs_m.tolist())) for backs_m in guesses)


def standing_of(session: Session, geometry: GeometryRecord, shift_m: Point) -> FoundStanding | None:
    """Return what stands before the walls of a room whose surface is free, or a file; None of one that is a box.

    Both devices are moved by so much against walls that nobody measured.

    Raises
    ------
    CalibrationError
        A known mesh does not fit what the camera sees.
    """
    surface = session.profile.surface
    if not isinstance(surface, FreeSurface | SurfaceFile):
        return None
    correspondence = load_correspondence(session)
    box = _box(geometry, shift_m)
    told = before_walls(correspondence, box)
    stands = told.stands
    valid = max(int(correspondence.valid.sum()), 1)
    if isinstance(surface, SurfaceFile):
        points = point_map(correspondence, box.camera, box.projector)
        known = known_surface(
            session.profile, surface, points=points, stands=stands, camera=box.camera, size_m=geometry.surface.size_m
        )
        return _of_known(known, valid)
    every = point_map(correspondence, box.camera, box.projector)
    others, every = positions_of(session, geometry, every, box)
    points = replace(every, distance_m=np.where(stands, every.distance_m, np.nan))
    surely = parts_of(points, pieces_of(points, stands, LEAST_PIXELS), LEAST_PIXELS)
    parts = up_to_walls(every, surely, told.wall_distance_m)
    apart_m = apart_from_walls(box, points.origin_m + points.distance_m[..., None] * points.rays)
    patch_size_m = session.profile.room.patch_size_m
    found = triangulated(every, parts, box.camera, patch_size_m, apart_m=apart_m)
    seen = parts.label >= 0
    record = StandingRecord.of(found, int(seen.sum()) / valid, int((stands & ~seen).sum()) / valid)
    surfaces = surfaces_elsewhere(others, every, parts.label, box=box, patch_size_m=patch_size_m, least=LEAST_PIXELS)
    for one, more_seen in zip(others, surfaces, strict=True):
        record = record.with_elsewhere(more_seen, one.record(more_seen))
    more = less_guessed(continued(every, parts, box, patch_size_m), others)
    return FoundStanding(record=record, carried_on=record.carried_on(more) if len(more.triangles) else None, box=box)


def _box(geometry: GeometryRecord, shift_m: Point) -> RoomBox:
    """The room, and the devices in it."""
    devices = (only(devices).pinhole() for devices in (geometry.cameras, geometry.projectors))
    camera, projector = (
        replace(device, translation_m=device.translation_m - device.rotation @ np.array(shift_m)) for device in devices
    )
    surface = geometry.surface
    return RoomBox(
        size_m=surface.size_m,
        seen=surface.seen,
        faces=surface.faces,
        camera=camera,
        projector=projector,
        angle_error_deg=surface.angle_error_deg,
        off_m=surface.off_m,
        notes=surface.notes,
    )


def _of_known(known: KnownSurface, valid: int) -> FoundStanding:
    record = StandingRecord(
        vertices_m=tuple((x, y, z) for x, y, z in known.vertices_m.tolist()),
        triangles=tuple((a, b, c) for a, b, c in known.triangles.tolist()),
        part=tuple(known.part.tolist()),
        flat=tuple(flat_parts(known.vertices_m, known.triangles, known.part).tolist()),
        sigma_m=(known.record.misfit_median_m,) * len(known.vertices_m),
        share_of_image=float(np.isfinite(known.misfit_m).sum()) / valid,
        share_left_out=0.0,
        finer_walls=True,
        finer_edges=True,
        backs=known.is_open,
        registration=known.record,
    )
    return FoundStanding(record=record, misfit_m=known.misfit_m)
