"""Whether a session can succeed from where the devices stand: what of the picture is seen, decoded, sharp and in depth.

The first steps of a session are done with the same functions, so that what would end a session ends here, in the same
words.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.arrays import BoolArray, FloatArray
from calibration.geometry.pinhole import world_rays
from calibration.light.overshoot import overshoot_percent, side_px
from calibration.radiometry.photon_transfer import fit_camera_noise
from calibration.radiometry.response import Response
from calibration.structured_light.correspondence import Correspondence, PixelReason
from calibration.structured_light.orientation import without_mirrored
from calibration.structured_light.patterns import Pattern, checker
from calibration.structured_light.subpixel import refine_subpixel
from rig.errors import CalibrationFailed
from rig.records import Record, Verdict
from rig.self_check.parts.linearity import CameraCurve, Sweep
from rig.self_check.results import PartResult
from rig.self_check.rig_under_test import RigUnderTest
from rig.stages.correspondence import only
from rig.stages.error_tree import one_error_tree
from rig.stages.geometry import GeometryRecord, geometry_of
from rig.stages.linear_light import RadiometricCalibration
from rig.stages.stripes.showing import (
    CodePhotographs,
    as_light,
    blaming_focus,
    focus_verdicts,
    out_of_focus,
    photograph_code,
    photograph_in_parts,
    read_in_parts,
)
from rig.stages.stripes.superposition import superposition_percent, superposition_verdicts
from rig.stages.stripes.width import as_named
from rig.terminal import silent

_LIT = 0.2
"""Of the brightest direct light (95th percentile): pixels with less see the projector's light only off the walls."""
_LEAST_PARALLAX_DEG = 2.0
"""A tenth of a pixel of a usual lens (1 px: 0.1 degree) is then half a per cent of the distance."""
_PIXELS = 2000
"""Of which the parallax is told."""
_CODES = tuple(range(0, 256, 17))
"""Of which the projector's curve is told where stripes have grey levels."""
_CHECKS_AROUND = 1.5
"""Within which a lit pixel finds one that lies in the middle of a check, at any place of the pattern."""


@dataclass(frozen=True, kw_only=True)
class View(Record):
    """What a session will find of the picture."""

    lit_share: float
    """Of the camera's pixels."""
    decoded_share: float
    """Of the camera's pixels: have a projector pixel."""
    decoded_share_of_lit: float
    reasons: Mapping[str, float]
    """Share of the camera's pixels by reason."""
    sharpness: float
    """Contrast of the session's checks, share of full."""
    overshoot_percent: float | None = None
    """By how much more direct light there is beside the edges of large checks than in their middles; None where the
    camera sees too little of them."""
    stripes_times: int = 1
    """How many times as wide as the code's own stripes were, because the lenses blur these away."""
    superposition_percent: float | None = None
    """Of white: by how much more light patterns have with their inverses than white has; None where nobody could tell.
    """
    walls: tuple[str, ...]
    """That were told apart; empty where geometry says why not."""
    parallax_deg: float | None = None
    """Median angle at which the lines of sight of camera and projector meet."""
    angle_error_deg: float | None = None
    """Largest angle by which a wall is off its axis."""
    baseline_m: float | None = None
    geometry_rms_px: float | None = None
    geometry: str
    """Why there is none, in the words of a session; empty where there is one."""
    notes: str
    """What geometry assumed and rests on, in the words of a session."""


def check_view(tested: RigUnderTest, curve: CameraCurve, sweep: Sweep) -> PartResult[View]:
    """Shares lit and decoded, sharpness, walls; lenses and poses as a session fits them."""
    radiometric = _radiometric(tested, curve, sweep)
    decoded = _decoded(tested, radiometric, curve)
    correspondence = decoded.correspondence
    lit, sharpness = _lit_and_sharp(tested, curve)
    size_px = side_px(correspondence)
    first, second = _checker_and_complement(tested, curve, size_px, "view-large-checker")
    overshoot = overshoot_percent(np.abs(first - second), correspondence, size_px)
    geometry, reason = _geometry(tested, decoded)
    valid = correspondence.valid
    view = View(
        lit_share=float(lit.mean()),
        decoded_share=float(valid.mean()),
        decoded_share_of_lit=float((valid & lit).sum() / max(int(lit.sum()), 1)),
        reasons={code.name.lower(): float((correspondence.reason == code).mean()) for code in PixelReason},
        sharpness=sharpness,
        overshoot_percent=overshoot,
        stripes_times=decoded.stripes_times,
        superposition_percent=decoded.superposition_percent,
        walls=geometry.surface.seen if geometry else (),
        parallax_deg=_parallax_deg(geometry, correspondence) if geometry else None,
        angle_error_deg=geometry.surface.angle_error_deg if geometry else None,
        baseline_m=geometry.baseline_m if geometry else None,
        geometry_rms_px=geometry.rms_px if geometry else None,
        geometry=reason,
        notes=geometry.surface.notes if geometry else "",
    )
    return PartResult(verdicts=_verdicts(tested, view), numbers=view)


def _verdicts(tested: RigUnderTest, view: View) -> tuple[Verdict, ...]:
    limits, of_session = tested.limits, tested.rig.profile.limits
    return (
        Verdict(
            what="part of the camera's picture that the projector lights",
            value=view.lit_share,
            limit=limits.lit_share,
            unit="of all",
            at_least=True,
            advice="aim the camera at the projected picture, or go nearer",
        ),
        Verdict(
            what="lit pixels that have a projector pixel",
            value=view.decoded_share_of_lit,
            limit=of_session.valid_share,
            unit="of lit",
            at_least=True,
            advice="focus the projector and the camera, darken the room, and keep glossy things out of the picture",
        ),
        Verdict(
            what=f"sharpness: contrast of a checker of {tested.rig.profile.patterns.checker_size_px} pixels",
            value=view.sharpness,
            limit=limits.sharpness,
            unit="of full",
            at_least=True,
            advice="focus the projector, then the camera; or set patterns.checker_size_px higher",
        ),
        Verdict(
            what="sharpening: light beside the edges of checks over that in their middles",
            value=None if view.overshoot_percent is None else max(view.overshoot_percent, 0.0),
            limit=limits.overshoot_percent,
            unit="%",
            advice="the camera sees too little of the picture to tell"
            if view.overshoot_percent is None
            else "the camera or the projector sharpens its pictures, which biases direct light in a session: set its "
            "sharpness (detail, edge enhancement, picture style) to the least, or take raw frames",
        ),
        *focus_verdicts(view.stripes_times),
        *superposition_verdicts(view.superposition_percent),
        Verdict(
            what="walls that are told apart",
            value=float(len(view.walls)),
            limit=float(limits.walls if tested.rig.profile.room.closed else limits.walls_of_open_scene),
            at_least=True,
            advice=view.geometry or "aim both at an edge between two walls",
        ),
        Verdict(
            what="geometry: reprojection rms",
            value=view.geometry_rms_px,
            limit=of_session.geometry_rms_px if view.geometry_rms_px is not None else None,
            unit="px",
            advice=view.geometry
            or out_of_focus(view.stripes_times)
            or "nothing may move while it is calibrated; look whether the walls are flat and stand at right angles",
        ),
        Verdict(
            what="parallax: angle between the lines of sight of camera and projector, median",
            value=view.parallax_deg,
            limit=_LEAST_PARALLAX_DEG if view.parallax_deg is not None else None,
            unit="degrees",
            at_least=True,
            advice=view.geometry or "move the camera further aside from the projector",
        ),
        Verdict(
            what="largest angle of a wall with its axis",
            value=view.angle_error_deg,
            unit="degrees",
            advice=view.geometry or "walls that are not square need right_angles = false",
        ),
        Verdict(what="distance of camera and projector", value=view.baseline_m, unit="m", advice=view.notes),
    )


def _parallax_deg(geometry: GeometryRecord, correspondence: Correspondence) -> float:
    """Median over pixels of the angle between the two rays that meet on the surface."""
    camera, projector = (only(devices).pinhole() for devices in (geometry.cameras, geometry.projectors))
    rows, columns = np.nonzero(correspondence.valid)
    few = slice(None, None, max(1, len(rows) // _PIXELS))
    row, column = rows[few], columns[few]
    seen = world_rays(camera, np.column_stack([column, row]).astype(np.float64))
    lit = world_rays(projector, correspondence.projector_xy_px[row, column])
    return float(np.degrees(np.median(np.arccos(np.clip((seen * lit).sum(axis=1), -1, 1)))))


def _radiometric(tested: RigUnderTest, curve: CameraCurve, sweep: Sweep) -> RadiometricCalibration:
    """As a session finds it, at the working exposure."""
    noise = fit_camera_noise(sweep.samples_dn, np.repeat(sweep.exposures_s, 2), curve.response)
    bands = tested.rig.camera.shape[2]
    return RadiometricCalibration(
        reference_exposure_s=tested.exposure_s,
        offset_dn=tested.offset_dn,
        full_scale_dn=tested.full_scale_dn,
        camera=curve.response,
        projector=(),
        gain_e_per_dn=noise.gain_e_per_dn,
        read_noise_dn=noise.read_noise_dn,
        black={},
        mixing=np.eye(bands),
        balance=np.ones(bands),
    )


@dataclass(frozen=True, eq=False)
class _Decoded:
    correspondence: Correspondence
    stripes_times: int
    superposition_percent: float | None


def _decoded(tested: RigUnderTest, radiometric: RadiometricCalibration, curve: CameraCurve) -> _Decoded:
    """The map of a session's code, photographed as a session does: wider, or in parts, where that is needed."""
    frames: dict[str, NDArray[np.uint16]] = {}

    def take(patterns: Iterable[Pattern]) -> None:
        for pattern in as_light(patterns, lambda: (_projector_curve(tested, curve),)):
            frames[pattern.name] = tested.shoot(pattern.codes, pattern.name).pixels

    profile = tested.rig.profile
    by = CodePhotographs(profile=profile, radiometric=radiometric, take=take, frame=frames.__getitem__)
    shown = photograph_code(by, silent)
    if shown is None:
        named = as_named(profile)
        return _Decoded(refine_subpixel(by.read(named)), 1, superposition_percent(by, named))
    in_parts = photograph_in_parts(by, shown)
    first = by.read(shown)
    found = refine_subpixel(read_in_parts(by, first, shown) if in_parts else first)
    return _Decoded(found, shown.times, superposition_percent(by, shown))


def _projector_curve(tested: RigUnderTest, curve: CameraCurve) -> Response:
    """Light of some codes, as well as sinusoids need it."""
    mean = [
        float(_light(tested, curve, np.full(tested.picture_shape, k, np.uint8), "level")[tested.lit].mean())
        for k in _CODES
    ]
    share = np.maximum.accumulate((np.array(mean) - mean[0]) / (mean[-1] - mean[0]))
    return Response(np.array(_CODES, dtype=np.float64), share, 0.0)


def _lit_and_sharp(tested: RigUnderTest, curve: CameraCurve) -> tuple[BoolArray, float]:
    """(H, W) pixels with direct light, and how much of it the session's checks keep on average.

    A checker and its complement light the room alike, so their difference is direct light; blur takes it away at the
    edges of checks first.
    """
    size_px = tested.rig.profile.patterns.checker_size_px
    first, second = _checker_and_complement(tested, curve, size_px, "view-checker")
    change = np.abs(first - second)
    around = 2 * round(_CHECKS_AROUND * size_px * change.shape[1] / tested.picture_shape[1] / 2) + 1
    direct = cv2.dilate(cv2.medianBlur(change.astype(np.float32), 3), np.ones((around, around), np.uint8))
    lit = np.asarray(direct > _LIT * np.quantile(direct, 0.95))
    return lit, float((change[lit] / direct[lit]).mean())


def _checker_and_complement(
    tested: RigUnderTest, curve: CameraCurve, size_px: int, name: str
) -> tuple[FloatArray, FloatArray]:
    boards = [checker(tested.picture_shape, size_px, (0, shift_px)) for shift_px in (size_px, 0)]
    first, second = (_light(tested, curve, board, f"{name}-{k}") for k, board in enumerate(boards))
    return first, second


def _light(tested: RigUnderTest, curve: CameraCurve, codes: NDArray[np.uint8], name: str) -> FloatArray:
    return curve.light(tested.photograph(codes, name))


def _geometry(tested: RigUnderTest, decoded: _Decoded) -> tuple[GeometryRecord | None, str]:
    """As a session fits it, or its refusal."""
    try:
        with one_error_tree(), blaming_focus(decoded.stripes_times):
            return geometry_of(without_mirrored(decoded.correspondence), tested.rig.profile, silent), ""
    except CalibrationFailed as error:
        return None, str(error)
