"""One self-contained HTML file from a compared session: every number in it is one of metrics.json or the journal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from markupsafe import Markup

from calibration.light.check_size import why_checks_are_larger
from rig.files.atomic import write_bytes
from rig.files.channels import image_of
from rig.profile.apply import guessed_keys
from rig.records import Verdict
from rig.report import figures, pictures
from rig.report.focus import focus_figure, focus_of, focus_text
from rig.report.links import link_pages
from rig.report.pictures import EmbeddedPicture
from rig.report.render import Headline, TextTable, embedded_json, headline_of, rendered
from rig.report.room import darkness_text, geometry_text
from rig.report.scene.shadows import COLOURS, FATES, shadow_map
from rig.report.scene.shown import (
    learned_errors,
    learned_pictures,
    learned_text,
    misfit_picture,
    placed_pictures,
)
from rig.report.scene.view import view_of
from rig.report.strategy_pictures import PictureRow, picture_rows
from rig.report.terms import explained, name_of
from rig.session import Session
from rig.session.timing import seconds_by_step
from rig.stages.compensation import load_compensation
from rig.stages.correspondence import load_correspondence_figures, map_name
from rig.stages.model import FittedScene, load_model
from rig.stages.photograph import FrameNote, frame_notes
from rig.stages.radiometry import load_radiometric_calibration
from rig.stages.results import (
    ExpectedFigure,
    SessionResult,
    StrategyResult,
    TruthErrors,
)
from rig.stages.separation import load_separation_record
from rig.stages.target import ShownTarget
from rig.terminal import OnStep
from rig.terminal.line import counted
from rig.version import __version__

_SHOWN_FIRST = ("none", "direct", "paper", "exact", "bounded")
_MAX_EVENTS = 40
"""Rows of the frame log that still make a page to read."""
_STRATEGY_NOTE = (
    "none = the target at its best single gain. Clipped: share of driven projector pixels that their range holds back. "
    "All errors over lit, valid camera pixels."
)
_LIGHT_SCALE = "light, 1 = the camera's full scale at the reference exposure"
_CORRESPONDENCE_TEXT = (
    "Projector pixel that each camera pixel sees, from Gray code with inverses, and why a pixel has none."
)


@dataclass(frozen=True)
class _Reason:
    """Why pixels have no partner, and how many."""

    name: str
    colour: str
    share: str


@dataclass(frozen=True, kw_only=True)
class _SessionPage:
    """What the template shows, by its names."""

    title: str
    subtitle: str
    met: bool
    verdict: str
    failed: Sequence[Verdict]
    headline: Sequence[Headline]
    brightness: str
    strategies: Sequence[PictureRow]
    error_scale: str
    strategy_table: TextTable
    strategy_note: str
    comparison_text: str
    comparison_table: TextTable
    separation_text: str
    separation_images: Sequence[EmbeddedPicture]
    light_scale: str
    focus_text: str
    focus_figure: str
    geometry_text: str
    room_figure: str
    room_data: Markup
    """The scene as JSON, for the 3-D view."""
    shadows: EmbeddedPicture
    placed: Sequence[EmbeddedPicture]
    placed_text: str
    misfit: EmbeddedPicture | None
    learned: Sequence[EmbeddedPicture]
    learned_text: str
    shadow_legend: Sequence[_Reason]
    correspondence_text: str
    correspondence_images: Sequence[EmbeddedPicture]
    correspondence_scales: Sequence[str]
    reasons: Sequence[_Reason]
    response_figure: str
    truth_table: TextTable | None
    limits: Sequence[Verdict]
    expected: Sequence[ExpectedFigure]
    timing_figure: str
    frame_text: str
    frame_events: Sequence[FrameNote]
    repeat: str
    folder: str
    guesses: Sequence[str]
    words: Mapping[str, str]
    provenance: str
    footer: str


def write_report(session: Session, result: SessionResult, on_step: OnStep, output: Path | None = None) -> Path:
    """Write report.html into a compared session, or another file, which leaves the session alone; return its path."""
    on_step("write report", 0, 2)
    page = _page(session, result, load_model(session))
    on_step("write report", 1, 2)
    html = rendered("report/session.html", page)
    if output is None:
        output = session.write_report(html)
        link_pages(session.path)
    else:
        write_bytes(output, html.encode())
    on_step("write report", 2, 2)
    return output


def _page(session: Session, result: SessionResult, model: FittedScene) -> _SessionPage:
    profile, radiometric = session.profile, load_radiometric_calibration(session)
    names, notes = _in_order(load_compensation(session).strategies), frame_notes(session)
    before_and_after = learned_errors(session, model, load_compensation(session).best)
    focus, shadows = focus_of(model, load_separation_record(session)), shadow_map(model)
    held = [row for row in result.limits if row.limit is not None]
    return _SessionPage(
        title=f"Session {session.path.name}",
        subtitle=f"{profile.name}: {profile.description}. Camera {profile.camera.width_px} × "
        f"{profile.camera.height_px} px, projector {profile.projector.width_px} × {profile.projector.height_px} px.",
        met=result.within_limits,
        verdict=f"{sum(row.met for row in held)} of {len(held)} limits kept",
        failed=tuple(row for row in result.limits if not row.met),
        headline=_headline(result),
        brightness=f"{profile.brightness.target_white_share:g} × the median of projector white",
        strategies=picture_rows(session, model, names),
        error_scale=figures.error_scale(),
        strategy_table=_strategy_table(result.strategies, names),
        strategy_note=_STRATEGY_NOTE,
        comparison_text=_comparison_text(result),
        comparison_table=_comparison_table(result),
        separation_text=_separation_text(session, model),
        separation_images=_separation_images(session, model),
        light_scale=figures.colour_bar("gray", 0.0, _light_at_white(session, model), _LIGHT_SCALE, gamma=2.2),
        focus_text=focus_text(focus),
        focus_figure=focus_figure(focus),
        geometry_text=geometry_text(result.geometry, result.model) + darkness_text(result.darkness),
        room_figure=figures.room_figure(model.scene_model),
        room_data=embedded_json(view_of(session, model)),
        shadows=pictures.picture(shadows.picture, "What becomes of each projector pixel"),
        placed=placed_pictures(session),
        placed_text="" if result.compensation.target is None else result.compensation.target.sentence,
        misfit=misfit_picture(session),
        learned=learned_pictures(before_and_after),
        learned_text=learned_text(before_and_after),
        shadow_legend=[
            _Reason(name, colour, f"{100 * share:.1f} %")
            for name, colour, share in zip(FATES, COLOURS, shadows.shares, strict=True)
        ],
        correspondence_text=_CORRESPONDENCE_TEXT,
        correspondence_images=correspondence_images(session),
        correspondence_scales=_correspondence_scales(session),
        reasons=_reasons(session),
        response_figure=figures.response_figure(radiometric.camera, radiometric.projector),
        truth_table=_truth_table(result.truth),
        limits=result.limits,
        expected=result.expected,
        timing_figure=figures.timing_figure(seconds_by_step(session)),
        frame_text=_frame_text(session, len(notes)),
        frame_events=notes[:_MAX_EVENTS],
        repeat="\n".join(session.commands) or f"rig run {session.path} -p {profile.path}",
        folder=str(session.path),
        guesses=guessed_keys(profile.text),
        words=explained(_words_of(result, names)),
        provenance=_provenance(session, result.compensation.target),
        footer=f"Written {datetime.now(UTC):%Y-%m-%d %H:%M} UTC by procam-rig {__version__}.",
    )


def _in_order(computed: Mapping[str, object]) -> list[str]:
    """Names of strategies, the usual ones first."""
    return [name for name in _SHOWN_FIRST if name in computed] + [name for name in computed if name not in _SHOWN_FIRST]


def _headline(result: SessionResult) -> list[Headline]:
    compensated, uncompensated = result.measured.compensated.mean, result.measured.uncompensated.mean
    return [
        headline_of(
            compensated,
            "grey levels of 255",
            f"measured mean error of '{result.compensation.strategy}', "
            f"{compensated / uncompensated:.2f} × the uncompensated {uncompensated:.1f}",
        ),
        headline_of(
            result.comparison.rmse,
            "grey levels",
            "measured against simulated (rms), on frames not used for fitting",
        ),
        headline_of(result.geometry.rms_px, "px", "reprojection error (rms) of camera and projector together"),
    ]


def _comparison_text(result: SessionResult) -> str:
    comparison = result.comparison
    return (
        "Difference between what the camera measured and what the model predicted for the codes "
        f"that were shown. Over all frames: rms {comparison.rmse:.2f}, bias {comparison.bias:+.2f} grey levels; "
        f"{100 * comparison.within_3_sigma:.1f} % of the pixels within three standard deviations of the noise. "
        "None of these frames was used to fit the model."
    )


def _frame_text(session: Session, n_notes: int) -> str:
    n_frames = len({event["file"] for event in session.frame_log() if event["event"] == "frame"})
    cut = f" The first {_MAX_EVENTS} are shown." if n_notes > _MAX_EVENTS else ""
    frames, events = counted(n_frames, "frame"), counted(n_notes, "event")
    return f"{frames}, {events} (stale or lost frames, retries).{cut}{_association(session)}"


def _association(session: Session) -> str:
    """How photographs without time stamps were told to belong to their pictures, by camera; empty where none are."""
    waiting = [camera.name for camera in session.profile.cameras if camera.driver == "gphoto2"]
    if not waiting:
        return ""
    return (
        f" Photographs of {', '.join(waiting)} have no time stamps: they belong to their pictures by waiting. The "
        "shutter was released when the picture had been on screen for the projector's latency, by the rig's clock."
    )


def _provenance(session: Session, target: ShownTarget | None) -> str:
    profile, settings = session.profile, session.finished("compensate").settings
    return (
        f"Profile {profile.name}, sha256 {profile.sha256[:16]}…; the session folder holds an exact copy. "
        f"Target: {target.sentence if target else settings['target']}, "
        f"sha256 {str(settings['target_sha256'])[:16]}…. "
        f"Measured with procam-rig {session.versions['procam-rig']}."
    )


def _truth_table(truth: TruthErrors | None) -> TextTable | None:
    if truth is None:
        return None
    rows = [[name_of(key), f"{value:.4g}"] for key, value in truth.as_json().items()]
    return TextTable(["what", "error"], rows)


def _comparison_table(result: SessionResult) -> TextTable:
    rows = [
        [name, f"{f.rmse:.2f}", f"{f.bias:+.2f}", f"{100 * f.within_3_sigma:.1f}", f"{f.noise_rms:.2f}"]
        for name, f in result.comparison.frames.items()
    ]
    return TextTable(["frame", "rms", "bias", "within 3 σ, %", "noise rms"], rows)


def _strategy_table(entries: Mapping[str, StrategyResult], names: Sequence[str]) -> TextTable:
    head = ["strategy", "measured mean", "sd", "max", "rms", "SSIM"]
    head += ["predicted mean", "predicted rms", "clipped, %", "iterations"]
    rows = []
    for name in names:
        m, p = entries[name].measured, entries[name].predicted
        cells = [f"{m.mean:.1f}", f"{m.sd:.1f}", f"{m.max:.0f}", f"{m.rms:.1f}", f"{m.ssim:.3f}"]
        cells += [f"{p.mean:.1f}", f"{p.rms:.1f}", f"{100 * entries[name].clipped_share:.1f}"]
        rows.append([name, *cells, str(entries[name].iterations)])
    return TextTable(head, rows)


def _separation_text(session: Session, model: FittedScene) -> str:
    image, lit = session.finished("separation").load_image("separation"), model.lit
    share = float(np.median(image_of(image, "global")[lit] / np.maximum(image_of(image, "white")[lit], 1e-9)))
    return (
        "Light for projector white: reflected once (direct) and more than once (global), measured with shifted "
        f"checkers and simulated by the room model. Median share of global light: {100 * share:.0f} %. "
        f"All four at the same exposure.{_check_words(session)}"
    )


def _check_words(session: Session) -> str:
    """Why checks are larger than the profile asks for; empty where they are not."""
    record, asked_px = load_separation_record(session), session.profile.patterns.checker_size_px
    if record.checker_size_px == asked_px:
        return ""
    why = why_checks_are_larger(record.stripes_blur_px, record.camera_pixel_px)
    return (
        f" Checks of {record.checker_size_px} px were shown in place of {asked_px} px: {why}. Focusing both lenses, or "
        "a camera of more pixels, brings the smaller ones back."
    )


def _light_at_white(session: Session, model: FittedScene) -> float:
    """Light that pictures of it show as white: nearly the brightest of projector white."""
    measured = session.finished("separation").load_image("separation")
    return float(np.quantile(image_of(measured, "white")[model.lit], 0.98))


def _words_of(result: SessionResult, names: Sequence[str]) -> list[str]:
    """What the page's tables and grids call things."""
    tables = (_strategy_table(result.strategies, names), _comparison_table(result))
    heads = [cell for table in tables for cell in table.head]
    return [
        *names,
        *("target", "projected", "predicted", "measured", "error"),
        *heads,
        *(r.what for r in result.limits),
    ]


def _separation_images(session: Session, model: FittedScene) -> list[EmbeddedPicture]:
    measured = session.finished("separation").load_image("separation")
    simulated = session.finished("compare").load_image("simulated-white")
    scale = 255 / _light_at_white(session, model)
    shown = [
        ("Direct, measured", image_of(measured, "direct")),
        ("Direct, simulated", image_of(simulated, "direct")),
        ("Global, measured", image_of(measured, "global")),
        ("Global, simulated", image_of(simulated, "global")),
    ]
    return [pictures.picture(pictures.photograph(image * scale), alt) for alt, image in shown]


def correspondence_images(session: Session) -> list[EmbeddedPicture]:
    """Return pictures of the finished map from camera to projector, and of why pixels have no place in it."""
    image = session.finished("correspondence").load_image(map_name(session.profile))
    valid = image["reason"] == 0
    return [
        pictures.picture(pictures.ramp(image["column"], valid, "turbo"), "Projector column"),
        pictures.picture(pictures.ramp(image["row"], valid, "turbo"), "Projector row"),
        pictures.picture(pictures.reasons(image["reason"]), "Validity: why a pixel is or is not used"),
    ]


def _correspondence_scales(session: Session) -> list[str]:
    """A colour bar below each of the two maps of places."""
    image = session.finished("correspondence").load_image(map_name(session.profile))
    valid = image["reason"] == 0
    ends = {name: image[name][valid] if valid.any() else np.zeros(1) for name in ("column", "row")}
    return [
        figures.colour_bar("turbo", float(values.min()), float(values.max()), f"projector {name}, px")
        for name, values in ends.items()
    ]


def _reasons(session: Session) -> list[_Reason]:
    """Shares of the reasons; sessions of older versions know fewer of them."""
    shares = load_correspondence_figures(session).reasons.values()
    return [
        _Reason(name, colour, f"{100 * share:.1f} %")
        for (name, colour), share in zip(pictures.reason_legend(), shares, strict=False)
    ]
