"""Lenses, poses and walls from the correspondence map, in metres: step `geometry`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.geometry.contradictions import MOST_DISTANCE_SIGMA
from calibration.geometry.flat.misfit import check_walls_fit
from calibration.geometry.known.lengths import Figures, TapedCalibration
from calibration.geometry.known.scale import scale_from_baseline, scale_from_spots
from calibration.geometry.known.tape import check_against_tape, check_lens_height, tape_sigma_shares
from calibration.geometry.noise import plus_minus
from calibration.geometry.pinhole import PinholeModel, vector_of
from calibration.geometry.room import RoomBox, room_from_stereo
from calibration.geometry.stereo import StereoCalibration, calibrate_stereo
from calibration.structured_light.consistency.map_noise import map_noise_px, most_left_px
from calibration.structured_light.correspondence import Correspondence
from calibration.structured_light.subpixel import WINDOW_VARIANCE_PX2
from rig.profile.lenses import lens_settings, nominal_lenses
from rig.profile.schema import Profile
from rig.records import JsonObject, Record
from rig.session import Session, Step
from rig.stages.correspondence import load_correspondence, load_correspondence_figures
from rig.stages.maps.edges import inside_and_beside
from rig.stages.stripes.showing import blaming_focus
from rig.terminal import OnStep

TAPE_SIGMA = 0.003
"""Standard deviation of a length by tape, as a share of it: a centimetre in three metres."""
_TAPES = 5
"""Lengths by tape: the scale, the room's three, the height of the lens."""

Point = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class DeviceGeometry(Record):
    """Lens and pose of a camera, or of a projector as an inverse camera; OpenCV's conventions."""

    width_px: int
    height_px: int
    focal_px: tuple[float, float]
    principal_point_px: tuple[float, float]
    distortion: tuple[float, float, float, float, float]
    """k1, k2, p1, p2, k3."""
    rotation: tuple[Point, Point, Point]
    """device_from_world, row by row."""
    translation_m: Point
    """device_from_world."""
    rms_px: float
    """Reprojection error in this device's pixels."""

    @classmethod
    def of(cls, model: PinholeModel, rms_px: float) -> DeviceGeometry:
        """Return the record of a calibrated device."""
        first, second, third = ((row[0], row[1], row[2]) for row in model.rotation.tolist())
        x_m, y_m, z_m = model.translation_m.tolist()
        return cls(
            width_px=model.width_px,
            height_px=model.height_px,
            focal_px=model.focal_px,
            principal_point_px=model.principal_point_px,
            distortion=model.distortion,
            rotation=(first, second, third),
            translation_m=(x_m, y_m, z_m),
            rms_px=rms_px,
        )

    def pinhole(self) -> PinholeModel:
        """Return the calibrated device of the record."""
        return PinholeModel(
            width_px=self.width_px,
            height_px=self.height_px,
            focal_px=self.focal_px,
            principal_point_px=self.principal_point_px,
            distortion=self.distortion,
            rotation=np.array(self.rotation),
            translation_m=np.array(self.translation_m),
        )


@dataclass(frozen=True, kw_only=True)
class BoxSurface(Record):
    """The lit surface as a box-shaped room; world is its frame: z up, origin at a lower corner."""

    kind: str = "box"
    size_m: Point
    seen: tuple[str, ...]
    """Faces that were measured."""
    faces: tuple[str, ...]
    """Faces that the model has."""
    angle_error_deg: float
    """Largest deviation of a measured plane from its axis."""
    off_m: float = 0.0
    """How far what was measured of the walls lies off them: 95 % of the points by no more."""
    notes: str
    """What was assumed, in words."""


@dataclass(frozen=True, kw_only=True)
class GeometryRecord(Record):
    """What step `geometry` found: all devices in one frame, and the surface."""

    cameras: Mapping[str, DeviceGeometry]
    projectors: Mapping[str, DeviceGeometry]
    surface: BoxSurface
    baseline_m: float
    rms_px: float
    """Reprojection error of all devices together."""
    inlier_share: float
    sigmas: Mapping[str, float]
    """Standard deviations: lens terms [px or 1]; what ends in _m or _deg, of poses, baseline and room, in that unit.

    Positions of the devices are those in the room; `relative` is the projector in the camera's frame, `surface` the
    distance of a measured wall from the projector. What was guessed, because no wall along an axis was seen, has none.
    """
    right_angle_sigmas: float | None = None
    """By how much the points and the data sheets speak against right angles; None where none were taken."""
    askew_sigmas: Mapping[str, float] | None = None
    """By the same names, what of poses and lengths would be off, were each wall that is taken to be square off by 0.3
    degrees; None where no right angle was taken for granted, and of sessions of older versions."""


def geometry_settings(session: Session) -> JsonObject:
    """Return what step `geometry` depends on."""
    profile = session.profile
    unused = {"patch_size_m", "file", "unit", "up", "also", "size_to_walls"}
    unused |= {"lens_height_m"} if profile.room.lens_height_m is None else set()
    unused |= {"askew_deg"} if not profile.room.askew_deg else set()
    return {
        "hfov_deg": [profile.camera.hfov_deg, profile.projector.hfov_deg],
        **({"lenses": lenses} if (lenses := lens_settings(profile)) else {}),
        "scale": profile.scale.model_dump(mode="json"),
        "box": profile.room.model_dump(mode="json", exclude=unused),
        "third_wall": "strips of it beside edges, too",
        "inside": "by what is around",
    }


def fit_geometry(session: Session, step: Step, on_step: OnStep) -> None:
    """Step `geometry`: lenses, poses, planes, metres, room."""
    figures, correspondence = load_correspondence_figures(session), load_correspondence(session)
    with blaming_focus(figures.stripes_times):
        found = geometry_of(correspondence, session.profile, on_step, averaged_px2=figures.averaged_px2)
    step.save_record("geometry", found)


def geometry_of(
    correspondence: Correspondence, profile: Profile, on_step: OnStep, *, averaged_px2: float = WINDOW_VARIANCE_PX2
) -> GeometryRecord:
    """Find lenses, poses, walls and metres, and hold them against every length that the profile gives.

    Parameters
    ----------
    correspondence
        Of the profile's camera and projector.
    profile
        Fields of view, lengths, and what is known of the room.
    on_step
        Told how far it is.
    averaged_px2
        Variance of the camera's window over which coordinates are means; default: that of refined codes. [px²]

    Returns
    -------
    GeometryRecord

    Raises
    ------
    CalibrationError
        If the correspondence does not determine them, or something contradicts; with the cause.
    """
    inside, beside = inside_and_beside(correspondence)
    rows, columns = np.concatenate([np.nonzero(inside), np.nonzero(beside)], axis=1)
    sigma = correspondence.sigma_px
    pair = calibrate_stereo(
        np.stack([columns, rows], axis=1).astype(np.float64),
        correspondence.projector_xy_px[rows, columns].astype(np.float64),
        nominal_lenses(profile),
        right_angles=profile.room.right_angles,
        askew_deg=profile.room.askew_deg,
        one_wall=not profile.room.closed,
        sigma_px=None if sigma is None else sigma[rows, columns].astype(np.float64),
        beside=int(beside.sum()),
        averaged_px2=averaged_px2,
        on_step=lambda done, total: on_step("fit geometry", done, total),
    )
    taped = _held_to_tape(TapedCalibration.apart(pair, _TAPES), profile)
    room = _room(taped.pair, profile, taped.tape_errors)
    sigmas = _sigmas(taped, profile, room)
    check_walls_fit(room.pair, most_left_px(map_noise_px(correspondence.projector_xy_px)))
    check_devices_placed(room.box, sigmas, room.pair.baseline)
    exact = any(axis >= 0 for axis in taped.pair.axes) and not profile.room.askew_deg
    askew = _askew_sigmas(taped, profile, room) if exact else None
    return _record(profile, room, {**taped.pair.sigmas, **sigmas}, askew)


def tape_sigmas(profile: Profile) -> NDArray[np.float64]:
    """Return the standard deviations of lengths by tape, as shares: (5,) scale, the room's three, lens height."""
    return tape_sigma_shares(TAPE_SIGMA, profile.room.size_m, profile.room.lens_height_m, profile.room.askew_deg)


def _held_to_tape(apart: TapedCalibration, profile: Profile) -> TapedCalibration:
    """Refuse lengths by tape that contradict the points; hold the points to those that they tell, too."""
    size_m, height_m, shares = profile.room.size_m, profile.room.lens_height_m, tape_sigmas(profile)
    room = _room(apart.pair, profile, apart.tape_errors)
    sigmas = _sigmas(apart, profile, room)
    sides = [] if size_m is None else room.box.lengths_measured
    if size_m is not None:
        size_sigma_m = np.array([sigmas.get(f"room_{axis}_m", np.inf) for axis in "xyz"])
        check_against_tape(room.box, size_m, size_sigma_m, shares[1:4].tolist(), right_angles=profile.room.right_angles)
    has_height = height_m is not None and "floor" in room.box.seen
    if height_m is not None and has_height:
        check_lens_height(room.box.projector.position_m[2], height_m, sigmas["projector_z_m"], shares[4])
    told = [*sides, 3] if has_height else sides
    tape_m = np.array([*(size_m or (0.0, 0.0, 0.0)), height_m or 0.0])

    def differences(pair: StereoCalibration, tape_errors: NDArray[np.float64]) -> NDArray[np.float64]:
        box, taped_m = _room(pair, profile, tape_errors).box, tape_m * (1 + shares[1:] * tape_errors[1:])
        off_m = np.array([*box.size_m, box.projector.position_m[2]]) - taped_m
        return np.asarray(off_m[told])

    return apart.held_to(differences)


def check_devices_placed(box: RoomBox, sigmas: Mapping[str, float], baseline_m: float) -> None:
    """Refuse a room that may stand in many ways around the devices: seen from nearly one place, three walls may turn.

    Parameters
    ----------
    box
        The room.
    sigmas
        Standard deviations of the devices' places in it, and of the baseline, by the names of the record.
    baseline_m
        Between the devices.

    Raises
    ------
    CalibrationError
        If a place is known no better than to a tenth of the room's longest side.
    """
    places = {f"{who}_{axis}_m": (who, axis) for who in ("camera", "projector") for axis in "xyz"}
    # What is no number is not determined, and compares with nothing.
    known_m = {name: float(np.nan_to_num(sigmas.get(name, 0.0), nan=np.inf)) for name in places}
    worst = max(places, key=lambda name: known_m[name])
    sigma_m, longest_m, (who, axis) = known_m[worst], max(box.size_m), places[worst]
    if len(box.seen) == 1 or sigma_m <= MOST_DISTANCE_SIGMA * longest_m:
        return
    known = f"known to +- {sigma_m:.2f} m" if sigma_m <= longest_m else "not determined"
    apart = plus_minus(sigmas.get("baseline_m", 0.0), "m", most=longest_m)
    raise CalibrationError(
        f"the points leave open how the room stands around the devices: the {who}'s {axis} is {known} in a "
        f"room of {longest_m:.2f} m, the limit is {100 * MOST_DISTANCE_SIGMA:.0f} % of it. Camera and projector are "
        f"{baseline_m:.2f} m {apart} apart, too little parallax for the walls that are seen: move the camera further "
        "aside, show more of floor or ceiling, give both devices a lens file (rig lenses), or their distance "
        "(baseline_m)"
    )


@dataclass(frozen=True, eq=False)
class _ScaledRoom:
    pair: StereoCalibration
    """In metres."""
    box: RoomBox


def _room(pair: StereoCalibration, profile: Profile, tape_errors: NDArray[np.float64]) -> _ScaledRoom:
    """Metres and box, if lengths by tape (scale, room's three, lens height) were so many sigmas longer, (5,)."""
    longer = 1 + tape_sigmas(profile) * tape_errors
    scale, size_m = profile.scale, profile.room.size_m
    if scale.baseline_m is not None:
        pair = scale_from_baseline(pair, scale.baseline_m * longer[0])
    else:
        pair = scale_from_spots(pair, np.array(scale.spots_px), float(scale.distance_m or 0) * longer[0])
    if size_m is not None:
        size_m = (size_m[0] * longer[1], size_m[1] * longer[2], size_m[2] * longer[3])
    height_m = profile.room.lens_height_m
    height_m = None if height_m is None else height_m * longer[4]
    things = profile.surface.kind in ("free", "file")
    box = room_from_stereo(pair, size_m, profile.room.closed, lens_height_m=height_m, with_things=things)
    return _ScaledRoom(pair, box)


def _sigmas(taped: TapedCalibration, profile: Profile, room: _ScaledRoom) -> dict[str, float]:
    """Standard deviations of poses and lengths: the fit's, and the tape's."""
    return _named(taped.sigmas_of(_figures_by(profile, room)), profile, room)


def _askew_sigmas(taped: TapedCalibration, profile: Profile, room: _ScaledRoom) -> dict[str, float]:
    """What of poses and lengths would be off, were each wall that is taken to be square off by 0.3 degrees."""
    return _named(taped.askew_sigmas_of(_figures_by(profile, room)), profile, room)


def _figures_by(profile: Profile, room: _ScaledRoom) -> Figures:
    def figures(calibration: StereoCalibration, tape_errors: NDArray[np.float64]) -> NDArray[np.float64]:
        return _figures(_room(calibration, profile, tape_errors), room)

    return figures


def _named(sigmas: NDArray[np.float64], profile: Profile, room: _ScaledRoom) -> dict[str, float]:
    guessed = _guessed(profile, room)
    return {name: float(sigma) for name, sigma in zip(_FIGURES, sigmas, strict=True) if name not in guessed}


def _guessed(profile: Profile, room: _ScaledRoom) -> set[str]:
    """Names of what nobody measured: along axes of which no face was seen, or one only and no size was given."""
    found = set()
    # Before one wall alone, neither size_m nor lens_height_m says anything of the piece that is lit.
    is_alone = len(room.box.faces) == 1
    size_m, height_m = (None, None) if is_alone else (profile.room.size_m, profile.room.lens_height_m)
    for axis, faces in zip("xyz", (("x0", "x1"), ("y0", "y1"), ("floor", "ceiling")), strict=True):
        seen = set(faces) & set(room.box.seen)
        if axis == "z" and height_m is not None:
            seen.add("floor")
        if not seen or (len(seen) == 1 and size_m is None):
            found.add(f"room_{axis}_m")
        if not seen or (seen == {faces[1]} and size_m is None):
            found |= {f"camera_{axis}_m", f"projector_{axis}_m"}
        found |= {f"surface_{face}_m" for face in faces if face not in room.box.seen}
    return found


_FIGURES = (
    *(f"{device}_{axis}_m" for device in ("camera", "projector", "relative", "room") for axis in "xyz"),
    *(f"surface_{face}_m" for face in ("x0", "y0", "floor", "x1", "y1", "ceiling")),
    *(f"{device}_rotation_{axis}_deg" for device in ("camera", "projector", "relative") for axis in "xyz"),
    "baseline_m",
)


def _figures(room: _ScaledRoom, nominal: _ScaledRoom) -> NDArray[np.float64]:
    """In the order of the names; rotations are what is left from the nominal ones, about the device's axes."""
    camera, projector = room.box.camera, room.box.projector
    relative = camera.rotation @ (projector.position_m - camera.position_m)
    before = nominal.box
    turns = [
        vector_of(now.rotation @ then.rotation.T)
        for now, then in ((camera, before.camera), (projector, before.projector))
    ]
    relative_then = before.projector.rotation @ before.camera.rotation.T
    turns.append(vector_of(projector.rotation @ camera.rotation.T @ relative_then.T))
    size_m = np.array(room.box.size_m)
    surfaces = [projector.position_m, size_m - projector.position_m]
    lengths = [camera.position_m, projector.position_m, relative, size_m, *surfaces]
    return np.concatenate([*lengths, np.degrees(np.concatenate(turns)), [np.linalg.norm(relative)]])


def _record(
    profile: Profile, room: _ScaledRoom, sigmas: Mapping[str, float], askew: Mapping[str, float] | None
) -> GeometryRecord:
    pair, box = room.pair, room.box
    return GeometryRecord(
        cameras={profile.camera.name: DeviceGeometry.of(box.camera, pair.camera_rms_px)},
        projectors={profile.projector.name: DeviceGeometry.of(box.projector, pair.projector_rms_px)},
        surface=BoxSurface(
            size_m=box.size_m,
            seen=box.seen,
            faces=box.faces,
            angle_error_deg=box.angle_error_deg,
            off_m=box.off_m,
            notes=box.notes,
        ),
        baseline_m=pair.baseline,
        rms_px=pair.rms_px,
        inlier_share=pair.inlier_share,
        sigmas=sigmas,
        right_angle_sigmas=pair.right_angle_sigmas,
        askew_sigmas=askew,
    )


def load_geometry(session: Session) -> GeometryRecord:
    """Return what the finished step `geometry` found."""
    return session.finished("geometry").load_record("geometry", GeometryRecord)
