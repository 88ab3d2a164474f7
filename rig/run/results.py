"""What a finished session has measured, collected from the records of its steps."""

from __future__ import annotations

import numpy as np

from rig.files.channels import image_of
from rig.profile.tables import FreeSurface
from rig.records import Verdict, all_met
from rig.run.expectations import expected_figures
from rig.run.lamp import drift_left_percent, lamp_change
from rig.run.steps import VERBS, Verb
from rig.run.stillness import stillness_verdicts
from rig.run.verdicts import checks_verdicts, lateness_verdicts, room_light_verdicts, verdicts
from rig.session import Session
from rig.stages.comparison import load_comparison
from rig.stages.compensation import load_compensation
from rig.stages.correspondence import load_correspondence, load_correspondence_figures, only
from rig.stages.geometry import load_geometry
from rig.stages.light.darkness import darkness_of
from rig.stages.light.exposure import load_exposure
from rig.stages.model import load_model, load_model_record, load_standing
from rig.stages.photograph import ExposureBracket
from rig.stages.radiometry import PairRadiometry, RadiometricRecord
from rig.stages.results import (
    ByBand,
    CompensationResult,
    GeometryResult,
    LearnedResult,
    MeasuredResult,
    ModelComparison,
    ModelResult,
    PartialResult,
    SeparationResult,
    SessionResult,
    StandingResult,
    StrategyResult,
    TruthErrors,
)
from rig.stages.separation import load_separation_record, processing_of_pictures_dn
from rig.stages.surface.openings import SeenBehind, left_open, seen_behind, sigmas_with_openings
from rig.stages.surface.standing import StandingRecord
from rig.stages.target import shown_target
from rig.stages.transport.evidence import gathered_evidence
from rig.stages.transport.records import TransportRecord

_LAMP_PERCENT_LEFT = 0.4
"""Of white: one grey level of 255, as of room light that swells."""
_LAMP_PERCENT_PER_MINUTE = 1.0
"""Of white: two and a half grey levels of 255 in a minute, which no model could explain; warm lamps keep 0.2."""
_LEAST_DIRECT = 0.05
"""A pixel counts as lit when its direct light is above this share of the median of the valid ones."""


def partial_result(session: Session, verb: Verb, truth: TruthErrors | None) -> PartialResult:
    """Return what is measured when the steps up to a verb are done."""
    reached = VERBS.index(verb)
    return PartialResult(
        geometry=_geometry(session, is_separated=reached >= VERBS.index("model")),
        separation=_separation(session) if reached >= VERBS.index("separate") else None,
        model=_model(session) if reached >= VERBS.index("model") else None,
        truth=truth,
        compensation=_compensation(session) if reached >= VERBS.index("compensate") else None,
    )


def session_result(session: Session, truth: TruthErrors | None) -> SessionResult:
    """Return what is measured of a session whose steps are all done, and the verdict."""
    geometry, comparison = _geometry(session, is_separated=True), _comparison(session)
    exposure = load_exposure(session)
    strategies, best = _strategies(session), load_compensation(session).best
    model = _model(session)
    limits = (
        *verdicts(geometry, model, comparison, session.profile),
        *room_light_verdicts(exposure),
        *lateness_verdicts(exposure),
        *checks_verdicts(load_separation_record(session)),
        _lamp_verdict(session),
        *stillness_verdicts(session),
    )
    return SessionResult(
        geometry=geometry,
        separation=_separation(session),
        model=model,
        truth=truth,
        compensation=_compensation(session),
        measured=MeasuredResult(uncompensated=strategies["none"].measured, compensated=strategies[best].measured),
        strategies=strategies,
        comparison=comparison,
        limits=limits,
        within_limits=all_met(limits),
        darkness=darkness_of(session),
        expected=expected_figures(session, geometry, comparison, strategies[best]),
    )


def _geometry(session: Session, *, is_separated: bool) -> GeometryResult:
    record, figures = load_geometry(session), load_correspondence_figures(session)
    openings = _doubtful_openings(session) if is_separated else ()
    return GeometryResult(
        rms_px=record.rms_px,
        camera_rms_px=only(record.cameras).rms_px,
        projector_rms_px=only(record.projectors).rms_px,
        valid_share_of_image=figures.valid_share_of_image,
        baseline_m=record.baseline_m,
        room_size_m=record.surface.size_m,
        faces_seen=record.surface.seen,
        room_notes=record.surface.notes,
        off_walls_m=record.surface.off_m,
        sigmas=sigmas_with_openings(record.sigmas, openings),
        openings_m={one.face: one.depth_m for one in openings},
        right_angle_sigmas=record.right_angle_sigmas,
        askew_sigmas=record.askew_sigmas,
        valid_share=_valid_share(session) if is_separated else None,
        stripes_times=figures.stripes_times,
        superposition_percent=figures.superposition_percent,
    )


def _doubtful_openings(session: Session) -> tuple[SeenBehind, ...]:
    """Openings that leave open from where to where the tape was held; none where the profile says it."""
    surface = session.profile.surface
    if not isinstance(surface, FreeSurface) or surface.size_m is None or surface.size_to_walls:
        return ()
    found = load_standing(session)
    return () if found is None else left_open(_seen_behind(session, found), load_geometry(session).surface.seen)


def _valid_share(session: Session) -> float:
    """Valid pixels among those that the projector lights, by their measured direct light."""
    direct = image_of(session.finished("separation").load_image("separation"), "direct").mean(axis=-1)
    valid = load_correspondence(session).valid
    lit = direct > _LEAST_DIRECT * np.median(direct[valid])
    return float((valid & lit).sum() / max(int(lit.sum()), 1))


def _separation(session: Session) -> SeparationResult:
    image = session.finished("separation").load_image("separation")
    white, global_ = image_of(image, "white"), image_of(image, "global")
    valid = load_correspondence(session).valid & (white > 0).all(axis=-1)
    share = global_[valid] / white[valid]
    return SeparationResult(global_share_mean=float(share.mean()), global_share_median=float(np.median(share)))


def _model(session: Session) -> ModelResult:
    record, areas = load_model_record(session), load_model(session).scene_model.scene.areas
    source, colour = np.array(record.bands[0].source), _colour(session)
    projector = only(record.projectors)
    return ModelResult(
        patches=len(source),
        reflectance_mean=_by_band([float(np.average(band.reflectance, weights=areas)) for band in record.bands]),
        reflectance_sigma=_by_band([band.reflectance_sigma for band in record.bands]),
        patches_lit_and_seen=int((source == 0).sum()),
        patches_seen_in_global_light=int((source == 1).sum()),
        patches_unseen=int((source == 2).sum()),
        unseen_reflectance=_by_band([band.unseen_reflectance for band in record.bands]),
        unseen_sigma=_by_band([band.unseen_sigma for band in record.bands]),
        flux=_by_band(list(projector.flux)),
        global_rms=_by_band([band.global_rms for band in record.bands]),
        vignetting_camera=only(record.cameras).vignetting,
        vignetting_projector=projector.vignetting,
        level=record.level,
        placed=record.placed,
        standing=_standing(session),
        learned=_learned(session),
        evidence=gathered_evidence(session),
        mixing=None if colour is None else colour.mixing,
        mixing_variation=None if colour is None else colour.mixing_variation,
        white_over_channels=None if colour is None else colour.white_over_channels,
        balance=None if colour is None else colour.balance,
    )


def _standing(session: Session) -> StandingResult | None:
    found = load_standing(session)
    if found is None:
        return None
    return StandingResult(
        parts=len(found.flat),
        flat_parts=sum(found.flat),
        triangles=len(found.triangles),
        share_of_image=found.share_of_image,
        share_left_out=found.share_left_out,
        n_continued=found.n_continued,
        behind=_seen_behind(session, found),
        positions=found.positions,
        deep=found.backs_m is not None,
        registration=found.registration,
    )


def _seen_behind(session: Session, found: StandingRecord) -> tuple[SeenBehind, ...]:
    if not found.openings or not found.triangles:
        return ()
    corners_m = np.array(found.vertices_m)[np.array(found.triangles)]
    return seen_behind(corners_m, load_geometry(session).surface.size_m)


def _learned(session: Session) -> LearnedResult | None:
    if not session.is_finished("transport"):
        return None
    found = session.finished("transport").load_record("transport", TransportRecord)
    before = [each.rms_before for each in found.photographs]
    return LearnedResult(
        photographs=len(found.photographs),
        rms_before=max(before, default=found.rms_left),
        rms_left=found.rms_left,
        left_out_rms=found.left_out_rms,
        left_out_expected=found.left_out_expected,
        gloss=found.gloss,
        another_brings=found.another_brings,
        noise=found.noise_of_place,
    )


def _by_band(values: list[float]) -> ByBand:
    return values[0] if len(values) == 1 else tuple(values)


def _colour(session: Session) -> PairRadiometry | None:
    """How the projector's channels mix; None of a grey rig, whose only channel is all of the light."""
    pair = session.finished("response").load_record("radiometric", RadiometricRecord).pairs[0]
    return None if len(pair.balance) == 1 else pair


def _compensation(session: Session) -> CompensationResult:
    record = load_compensation(session)
    target = shown_target(session.finished("compensate").settings)
    clipped_share = record.strategies[record.best].clipped_share
    return CompensationResult(strategy=record.best, clipped_share=clipped_share, target=target)


def _strategies(session: Session) -> dict[str, StrategyResult]:
    computed = load_compensation(session).strategies
    return {
        name: StrategyResult(
            measured=errors.measured,
            predicted=errors.predicted,
            clipped_share=computed[name].clipped_share,
            iterations=computed[name].iterations,
            notes=computed[name].notes,
        )
        for name, errors in load_comparison(session).strategies.items()
    }


def _comparison(session: Session) -> ModelComparison:
    record = load_comparison(session)
    overall = record.overall
    return ModelComparison(
        rmse=overall.rmse,
        bias=overall.bias,
        within_3_sigma=overall.within_3_sigma,
        noise_rms=overall.noise_rms,
        sigma_rms=overall.sigma_rms,
        frames=record.frames,
        photographs=session.finished("project").load_record("shot", ExposureBracket).repeats,
        processing_noise_dn=processing_of_pictures_dn(session),
    )


def _lamp_verdict(session: Session) -> Verdict:
    """White that changes is in all light that is compared: judged is what is left when even drift was taken out.

    Where nobody took it out, how fast white changed.
    """
    change, exposure = lamp_change(session), load_exposure(session)
    swells = any(not one.met for one in room_light_verdicts(exposure))
    late = any(not one.met for one in lateness_verdicts(exposure))
    other = "room light that swells changes" if swells else "photographs that begin too early change" if late else ""
    others = f"{other} white, too (see above). If it is the lamp: " if other else ""
    left = drift_left_percent(session)
    rate = abs(change.percent_per_minute)
    cause = (
        f"by {change.here_percent:.1f} % in some parts of the picture and by {change.there_percent:.1f} % in others, "
        "which no lamp does: light in the room was switched or let in, or somebody or something stood in the light or "
        "moved; keep the room as it is, and begin a new session"
        if change.is_uneven and not swells
        else f"{others}let the projector warm up, eco mode and dynamic iris off; daylight drifts, too"
    )
    return Verdict(
        what="lamp: drift of white",
        value=rate if left is None else left,
        limit=_LAMP_PERCENT_PER_MINUTE if left is None else _LAMP_PERCENT_LEFT,
        unit="% a minute" if left is None else "% of white left",
        advice=f"white was {change.percent:.2f} % brighter at its brightest than at its darkest, and changed by "
        f"{rate:.2f} % a minute: {cause}",
    )
