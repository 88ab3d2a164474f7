"""Sessions of the same rig with the camera elsewhere: what they saw of this room is measured, too."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.geometry.pinhole import vector_of
from calibration.geometry.room import RoomBox
from calibration.structured_light.correspondence import Correspondence
from calibration.surfaces.before_walls import apart_from_walls, before_walls, opened
from calibration.surfaces.continued import Continued
from calibration.surfaces.flat_parts import parts_of
from calibration.surfaces.pieces import pieces_of
from calibration.surfaces.point_map import PointMap, point_map
from calibration.surfaces.positions.lit_map import covered, lit_map, read_at
from calibration.surfaces.positions.merged import (
    MOST_APART,
    Agreement,
    agreement_of,
    looked_at,
    looked_through,
    merged,
    seen_along,
)
from calibration.surfaces.positions.placed import PlacedCamera, place_camera, placement_sigma_m, relative_to
from calibration.surfaces.triangulated import TriangulatedSurface, triangulated
from rig.errors import UsageError
from rig.profile.schema import Profile
from rig.profile.tables import FreeSurface
from rig.records import JsonObject, Record
from rig.session import Session
from rig.stages.correspondence import load_correspondence, only
from rig.stages.geometry import GeometryRecord, load_geometry

BoolArray = NDArray[np.bool_]

_SIGMAS = 5.0
"""By which a length of the room, or the projector's place in it, differs where it is no chance: along a flat wall a
projector that moved makes the same codes, and the points of both sessions fit."""
_FEW_THROUGH, _SHARE_THROUGH = 10, 0.01
"""Of pixels that see what only another position saw, those through which this camera may look. In simulated furnished
rooms 0 were in four pairs of sessions; 18 of 733 and 345 of 758 where a table had moved by 8 and by 14 cm."""
_THROUGH_PX = 3
"""Window that has to be looked through whole: along edges there are strips of two pixels though nothing moved."""
_THIN_PX = 5
"""Window that a strip has to fill which only another position saw: along edges strips are left that all saw in part."""


@dataclass(frozen=True, kw_only=True)
class PositionRecord(Record):
    """What a session of the same rig with the camera elsewhere saw of this room."""

    session: str
    """As the profile names it."""
    camera_m: tuple[float, float, float]
    """Where its camera stood in this room."""
    residual_px: float
    """Median distance of its pixels from where this session's points are seen from there."""
    share_of_seen: float
    """Of this camera's points, those that it saw, too."""
    median_apart: float
    """Of the absolute differences between the two, over the distance."""
    apart_sigmas: float
    """Root mean square of the differences in their standard deviations."""
    triangles: int
    """Of what stands before the walls, those that only it saw."""
    area_m2: float
    """Of these."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Elsewhere:
    """Another position of the camera, in this session's room."""

    name: str
    correspondence: Correspondence
    placed: PlacedCamera
    points: PointMap
    agreement: Agreement

    def record(self, surface: TriangulatedSurface) -> PositionRecord:
        """Return what is to be told of it, and of the surface that only it saw."""
        a, b, c = (surface.vertices_m[surface.triangles[:, k]] for k in range(3))
        x_m, y_m, z_m = self.placed.camera.position_m.tolist()
        return PositionRecord(
            session=self.name,
            camera_m=(x_m, y_m, z_m),
            residual_px=self.placed.residual_px,
            share_of_seen=self.agreement.share_of_seen,
            median_apart=self.agreement.median,
            apart_sigmas=self.agreement.sigmas,
            triangles=len(surface.triangles),
            area_m2=float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2),
        )


def positions_settings(session: Session) -> JsonObject:
    """Return what a model depends on: the maps and lenses of the sessions that a session's profile names.

    Raises
    ------
    UsageError
        One of them is not there, is named twice, or has another projector.
    SessionError
        One is not calibrated.
    """
    named = _sessions(session)
    if not named:
        return {}
    steps = ("correspondence", "geometry")
    return {"also": [[other.finished(step, verb="calibrate").outputs_sha256 for step in steps] for _, other in named]}


def positions_of(
    session: Session, geometry: GeometryRecord, points: PointMap, box: RoomBox
) -> tuple[tuple[Elsewhere, ...], PointMap]:
    """Return the other positions in a room, and this session's points merged with theirs.

    Parameters
    ----------
    session
        Whose profile names the others.
    geometry
        Of this session.
    points
        All that it decoded.
    box
        The room and its devices.

    Raises
    ------
    UsageError, SessionError
        As :func:`positions_settings`.
    CalibrationError
        What a session saw is not what this one did; with the cause.
    """
    own = lit_map(points, box.projector)
    found, together = [], points
    for name, other in _sessions(session):
        there, correspondence = load_geometry(other), load_correspondence(other)
        one, together = _elsewhere(name, there, correspondence, own=own, points=points, together=together, box=box)
        _refuse_contradictions(one, geometry, there)
        found.append(one)
    return tuple(found), together


def _elsewhere(
    name: str,
    there: GeometryRecord,
    correspondence: Correspondence,
    *,
    own: PointMap,
    points: PointMap,
    together: PointMap,
    box: RoomBox,
) -> tuple[Elsewhere, PointMap]:
    """One other position, held against the camera's own points; and the points of all so far merged with its."""
    start = relative_to(box.projector, only(there.cameras).pinhole(), only(there.projectors).pinhole())
    try:
        placed = place_camera(own, box.projector, correspondence, start)
    except CalibrationError as error:
        raise CalibrationError(
            f"{name}, which [surface] also names, cannot be placed: {error}; is it of this room?"
        ) from error
    seen = point_map(correspondence, placed.camera, box.projector)
    uncertain_m = placement_sigma_m(placed, box.projector, correspondence, seen)
    sure = np.hypot(seen.sigma_m, uncertain_m)
    seen = _only(seen, np.nan_to_num(uncertain_m, nan=np.inf) <= MOST_APART * np.nan_to_num(seen.distance_m))
    along_m, sigma_m = seen_along(points, lit_map(replace(seen, sigma_m=sure), box.projector), box.projector)
    agreement = agreement_of(points, along_m, sigma_m)
    one = Elsewhere(name=name, correspondence=correspondence, placed=placed, points=seen, agreement=agreement)
    return one, merged(together, along_m, sigma_m)


def surfaces_elsewhere(
    others: Sequence[Elsewhere],
    points: PointMap,
    label: NDArray[np.int64],
    *,
    box: RoomBox,
    patch_size_m: float,
    least: int,
) -> list[TriangulatedSurface]:
    """Return what stands before the walls and only other positions saw, a surface each.

    Parameters
    ----------
    others
        In the room.
    points, label
        Of this session's camera, and the parts of surface that its pixels see (-1: none).
    box
        The room and its devices.
    patch_size_m
        Longest wanted side of a triangle. [m]
    least
        Pixels of the smallest part.

    Raises
    ------
    CalibrationError
        This camera looks through what another position saw.
    """
    known = covered(points, label >= 0, box.projector)
    found = []
    for one in others:
        camera = one.placed.camera
        there = replace(box, camera=camera)
        new = before_walls(one.correspondence, there).stands & one.points.known
        new &= ~_lit_by(known, one.correspondence)
        new = opened(new, _THIN_PX)
        through = looked_through(points, box.camera, _only(one.points, new))
        _refuse_looking_through(one, opened(through, _THROUGH_PX), new)
        new &= ~through
        parts = parts_of(one.points, pieces_of(one.points, new, least), least)
        places = one.points.origin_m + one.points.distance_m[..., None] * one.points.rays
        apart_m = apart_from_walls(there, places)
        found.append(triangulated(one.points, parts, camera, patch_size_m, apart_m=apart_m))
        known |= covered(one.points, parts.label >= 0, box.projector)
    return found


def less_guessed(more: Continued, others: Sequence[Elsewhere]) -> Continued:
    """Return flat parts carried on beyond the picture, but for those of which another position sees whether they do."""
    middles_m = more.vertices_m[more.triangles].mean(axis=1)
    looked = np.zeros(len(middles_m), dtype=bool)
    for one in others:
        looked |= looked_at(one.points, one.placed.camera, middles_m)
    kept = ~np.isin(more.part, more.part[looked])
    return replace(more, triangles=more.triangles[kept], part=more.part[kept])


def _only(points: PointMap, chosen: BoolArray) -> PointMap:
    """The points of some pixels."""
    return replace(points, distance_m=np.where(chosen, points.distance_m, np.nan))


def _lit_by(pixels: BoolArray, correspondence: Correspondence) -> BoolArray:
    """(H, W) camera pixels that see the light of some projector pixels."""
    found = np.zeros(correspondence.valid.shape, dtype=bool)
    code_px = correspondence.projector_xy_px[correspondence.valid].astype(np.float64)
    found[correspondence.valid] = (
        read_at(pixels.astype(np.float64), np.clip(code_px, 0, np.array(pixels.shape)[::-1] - 1)) > 0
    )
    return found


def _sessions(session: Session) -> list[tuple[str, Session]]:
    """The sessions that a session's profile names, by these names."""
    profile, surface = session.profile, session.profile.surface
    if not isinstance(surface, FreeSurface) or not surface.also:
        return []
    paths = [profile.path.parent / name for name in surface.also]
    places = [session.path.resolve(), *(path.resolve() for path in paths)]
    if len(set(places)) < len(places):
        raise UsageError(
            f"{profile.path}: surface.also: names a session twice, or {session.path} itself; name each other position "
            "of the camera once"
        )
    return [(name, _session(profile, path)) for name, path in zip(surface.also, paths, strict=True)]


def _session(profile: Profile, path: Path) -> Session:
    if not Session.exists(path):
        raise UsageError(
            f"{path}: there is no session here, which [surface] also names; correct it (its path begins at the profile)"
        )
    session, own = Session.read(path), profile.projector
    other = session.profile.projector
    if (other.name, other.shape) != (own.name, own.shape):
        raise UsageError(
            f"{path}, which [surface] also names, has projector {other.name!r} of {other.width_px} x {other.height_px} "
            f"px, this session {own.name!r} of {own.width_px} x {own.height_px} px: name sessions of the same "
            "projector, in the same place"
        )
    return session


def _refuse_contradictions(one: Elsewhere, here: GeometryRecord, there: GeometryRecord) -> None:
    """Refuse a session whose points are not where this one's are, with the cause."""
    found = one.agreement
    cause = _other_room(here, there) or _projector_moved(here, there)
    if not cause and (found.median > MOST_APART or found.elsewhere.any()):
        cause = _thing_moved(found)
    if cause:
        raise CalibrationError(
            f"{one.name}, which [surface] also names, does not fit. {cause} (Half of what both saw is "
            f"{100 * found.median:.3f} % of the distance apart and more, the limit is {100 * MOST_APART:.2f} %; "
            f"{100 * found.share_elsewhere:.1f} % stands elsewhere, nothing may.)"
        )


def _other_room(here: GeometryRecord, there: GeometryRecord) -> str:
    """That lengths of the room differ; empty where they do not."""
    for axis, (own, other) in enumerate(zip(here.surface.size_m, there.surface.size_m, strict=True)):
        sigma = _together(here, there, f"room_{'xyz'[axis]}_m")
        if abs(other - own) > _SIGMAS * sigma:
            return (
                f"It is of another room: there it is {other:.3f} m along {'xyz'[axis]}, here {own:.3f} m, the two are "
                f"known to {sigma:.3f} m; name sessions of this room, or correct size_m in the profile of one."
            )
    return ""


def _projector_moved(here: GeometryRecord, there: GeometryRecord) -> str:
    """That the projector stands elsewhere in the room; empty where it does not."""
    own, other = (only(one.projectors).pinhole() for one in (here, there))
    shift_m = other.position_m - own.position_m
    turn_deg = np.degrees(vector_of(other.rotation @ own.rotation.T))
    sigmas = np.array(
        [
            *(_together(here, there, f"projector_{axis}_m") for axis in "xyz"),
            *(_together(here, there, f"projector_rotation_{axis}_deg") for axis in "xyz"),
        ]
    )
    if not (np.abs([*shift_m, *turn_deg]) > _SIGMAS * sigmas).any():
        return ""
    return (
        f"The projector moved between the two: by {100 * np.linalg.norm(shift_m):.1f} cm and "
        f"{np.linalg.norm(turn_deg):.2f} degrees in the room; it has to stay where it is, only the camera may move: "
        "photograph the other position again."
    )


def _thing_moved(found: Agreement) -> str:
    """What else it may be: a thing, where most of what both saw fits."""
    if found.median > MOST_APART:
        return (
            "Neither the room's lengths nor the projector's place explain it: was its zoom, focus or keystone changed, "
            "or most of what stands in the room moved? Photograph the other position again."
        )
    rows, columns = np.nonzero(found.elsewhere)
    side = "further away" if found.elsewhere_m > 0 else "nearer"
    return (
        f"Something in the room moved between the two: at row {int(np.median(rows))}, column {int(np.median(columns))} "
        f"of this camera's picture a surface is {100 * abs(found.elsewhere_m):.1f} cm {side} there; put it back and "
        "photograph the other position again."
    )


def _refuse_looking_through(one: Elsewhere, through: BoolArray, new: BoolArray) -> None:
    """Refuse what another position saw where this camera sees something behind it."""
    if through.sum() <= max(_FEW_THROUGH, _SHARE_THROUGH * new.sum()):
        return
    rows, columns = np.nonzero(through)
    raise CalibrationError(
        f"{one.name}, which [surface] also names, saw something at row {int(np.median(rows))}, column "
        f"{int(np.median(columns))} of its picture, in {int(through.sum())} pixels, through which this session's "
        "camera looks: it moved between the two; put it back and photograph the other position again"
    )


def _together(here: GeometryRecord, there: GeometryRecord, name: str) -> float:
    """Standard deviation of the difference of a figure in two sessions; infinite where one has guessed it."""
    return float(np.hypot(here.sigmas.get(name, np.inf), there.sigmas.get(name, np.inf)))
