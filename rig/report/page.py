"""One self-contained HTML file from a compared session: every number in it is one of metrics.json or the journal."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from rig.errors import SessionError
from rig.files.channels import PRIMARIES, codes_of, image_of
from rig.report import figures, pictures
from rig.report.render import headline_of, rendered
from rig.report.timing import seconds_by_step
from rig.session import Session
from rig.stages.comparison import strategies_of
from rig.stages.model import FittedScene, load_model
from rig.stages.radiometry import load_radiometric_calibration
from rig.terminal import OnStep

_SHOWN_FIRST = ("none", "direct", "paper", "exact", "bounded")
_TITLES = {"direct": "direct only", "exact": "exact inverse"}
_MAX_EVENTS = 40


def write_report(session: Session, metrics: Mapping[str, Any], on_step: OnStep) -> Path:
    """Write report.html into the session and return its path. Raises SessionError before the first comparison."""
    if "measured" not in metrics:
        raise SessionError(f"{session.path}: nothing was compared yet; run `rig run {session.path}` first")
    on_step("write report", 0, 3)
    model = load_model(session)
    context = _words(session, metrics, model) | _separation(session, model) | _correspondence(session)
    on_step("write report", 1, 3)
    context |= _strategies(session, metrics, model)
    on_step("write report", 2, 3)
    radiometric = load_radiometric_calibration(session)
    context |= {
        "room_figure": figures.room_figure(model.scene_model),
        "response_figure": figures.response_figure(radiometric.camera, radiometric.projector),
        "timing_figure": figures.timing_figure(seconds_by_step(session)),
        "error_scale": figures.error_scale(),
    }
    path = session.write_report(rendered("report/session.html", context))
    on_step("write report", 3, 3)
    return path


def _words(session: Session, metrics: Mapping[str, Any], model: FittedScene) -> dict[str, Any]:
    """Texts and tables."""
    measured, geometry, comparison = metrics["measured"], metrics["geometry"], metrics["comparison"]
    profile = session.profile
    best = metrics["compensation"]["strategy"]
    gain = measured["compensated"]["mean"] / measured["uncompensated"]["mean"]
    room_size = " × ".join(f"{length:.3f}" for length in geometry["room_size_m"])
    frames = [event for event in session.frame_log() if event["event"] == "frame"]
    notes = [event["note"] for event in session.frame_log() if event["event"] == "note"]
    return {
        "title": f"Session {session.path.name}",
        "subtitle": f"{profile.name}: {profile.description}. Camera {profile.camera.width_px} × "
        f"{profile.camera.height_px} px, projector {profile.projector.width_px} × {profile.projector.height_px} px.",
        "passed": metrics["within_limits"],
        "verdict": f"{sum(r['passed'] for r in metrics['limits'])} of {len(metrics['limits'])} checks passed",
        "headline": [
            headline_of(
                measured["compensated"]["mean"],
                "grey levels of 255",
                f"measured mean error of '{best}', "
                f"{gain:.2f} × the uncompensated {measured['uncompensated']['mean']:.1f}",
            ),
            headline_of(
                comparison["rmse"], "grey levels", "measured against simulated (rms), on frames not used for fitting"
            ),
            headline_of(geometry["rms_px"], "px", "reprojection error (rms) of camera and projector together"),
        ],
        "brightness": f"{profile.brightness.target_white_share:g} × the median of projector white",
        "strategy_note": "none = the target at its best single gain. Clipped: share of driven projector pixels that "
        "their range holds back. All errors over lit, valid camera pixels.",
        "comparison_text": "Difference between what the camera measured and what the model predicted for the codes "
        f"that were shown. Over all frames: rms {comparison['rmse']:.2f}, bias {comparison['bias']:+.2f} grey levels; "
        f"{100 * comparison['within_3_sigma']:.1f} % of the pixels within three standard deviations of the noise. "
        "None of these frames was used to fit the model.",
        "geometry_text": f"Baseline {1000 * geometry['baseline_m']:.0f} mm. Room {room_size} m; "
        f"seen: {', '.join(geometry['faces_seen'])}. {len(model.scene_model.scene.reflectance)} patches, "
        "mean reflectance "
        f"{_numbers(metrics['model']['reflectance_mean'])}. {geometry['room_notes']}{_colour_words(metrics['model'])}",
        "limits": [
            {"what": r["what"], "value": f"{r['value']:.4g}", "limit": f"{r['limit']:g}", "passed": r["passed"]}
            for r in metrics["limits"]
        ],
        "truth_table": _truth_table(metrics.get("truth")),
        "comparison_table": _comparison_table(comparison["frames"]),
        "frame_text": f"{len(frames)} frames, {len(notes)} events (stale or lost frames, retries)."
        + (f" The first {_MAX_EVENTS} are shown." if len(notes) > _MAX_EVENTS else ""),
        "frame_events": notes[:_MAX_EVENTS],
        "repeat": f"rig run {session.path.name} -p {profile.name}",
        "provenance": f"Profile {profile.name}, sha256 {profile.sha256[:16]}…; the session folder holds an exact copy. "
        f"Target: {session.finished('compensate').settings['target']}, sha256 "
        f"{session.finished('compensate').settings['target_sha256'][:16]}….",
        "footer": f"Written {datetime.now(UTC):%Y-%m-%d %H:%M} UTC by procam-rig.",
    }


def _numbers(value: float | list[float]) -> str:
    """One number, or one for each band."""
    return f"{value:.3f}" if isinstance(value, float) else ", ".join(f"{each:.3f}" for each in value)


def _colour_words(model: Mapping[str, Any]) -> str:
    """How the projector's colours mix; empty for a grey rig."""
    if "mixing" not in model:
        return ""
    rows = "; ".join(f"{band} {_numbers(row)}" for band, row in zip(PRIMARIES[3], model["mixing"], strict=True))
    return (
        f" Numbers by band are red, green, blue. Share of white in each band that the projector's red, green and blue "
        f"make: {rows}; over the picture they vary by at most {model['mixing_variation']:.4f}. White is "
        f"{_numbers(model['white_over_channels'])} times their sum."
    )


def _truth_table(truth: Mapping[str, float] | None) -> dict[str, Any] | None:
    if not truth:
        return None
    rows = [[key.replace("_", " "), f"{value:.4g}"] for key, value in truth.items()]
    return {"head": ["what", "error"], "rows": rows}


def _comparison_table(frames: Mapping[str, Mapping[str, float]]) -> dict[str, Any]:
    head = ["frame", "rms", "bias", "within 3 σ, %", "noise rms"]
    rows = [
        [name, f"{f['rmse']:.2f}", f"{f['bias']:+.2f}", f"{100 * f['within_3_sigma']:.1f}", f"{f['noise_rms']:.2f}"]
        for name, f in frames.items()
    ]
    return {"head": head, "rows": rows}


def _strategies(session: Session, metrics: Mapping[str, Any], model: FittedScene) -> dict[str, Any]:
    """Rows of pictures and the table of errors."""
    compensated, compared = session.finished("compensate"), session.finished("compare")
    judged = compared.load_image("judged")
    mask, target = judged["mask"] > 0, image_of(judged, "target")
    scale = 255 / model.level
    rows = []
    computed = strategies_of(session)
    names = [name for name in _SHOWN_FIRST if name in computed]
    names += [name for name in computed if name not in _SHOWN_FIRST]
    for name in names:
        codes = codes_of(compensated.load_image(f"projector-{name}"))
        predicted = image_of(compensated.load_image(f"predicted-{name}"), "light") * scale
        measured = image_of(compared.load_image(f"measured-{name}"), "light") * scale
        images = [
            pictures.picture(pictures.photograph(target, mask), "Target as the camera should see it"),
            pictures.picture(codes, f"Codes sent to the projector, {name}"),
            pictures.picture(pictures.photograph(predicted, mask), f"Predicted camera image, {name}"),
            pictures.picture(pictures.photograph(measured, mask), f"Measured camera image, {name}"),
            pictures.picture(pictures.signed_error(measured - target, mask), f"Measured minus target, {name}"),
        ]
        rows.append({"name": _TITLES.get(name, name), "images": images})
    return {"strategies": rows, "strategy_table": _strategy_table(metrics["strategies"], names)}


def _strategy_table(entries: Mapping[str, Any], names: list[str]) -> dict[str, Any]:
    head = ["strategy", "measured mean", "sd", "max", "rms", "SSIM"]
    head += ["predicted mean", "predicted rms", "clipped, %", "iterations"]
    rows = []
    for name in names:
        m, p = entries[name]["measured"], entries[name]["predicted"]
        figures_ = [f"{m['mean']:.1f}", f"{m['sd']:.1f}", f"{m['max']:.0f}", f"{m['rms']:.1f}", f"{m['ssim']:.3f}"]
        figures_ += [f"{p['mean']:.1f}", f"{p['rms']:.1f}", f"{100 * entries[name]['clipped_share']:.1f}"]
        rows.append([_TITLES.get(name, name), *figures_, str(entries[name]["iterations"])])
    return {"head": head, "rows": rows}


def _separation(session: Session, model: FittedScene) -> dict[str, Any]:
    image, simulation = (
        session.finished(step).load_image(name)
        for step, name in (("separation", "separation"), ("compare", "simulated-white"))
    )
    measured = {name: image_of(image, name) for name in ("direct", "global", "white")}
    simulated = {name: image_of(simulation, name) for name in ("direct", "global")}
    lit = model.lit
    share = float(np.median(measured["global"][lit] / np.maximum(measured["white"][lit], 1e-9)))
    scale = 255 / float(np.quantile(measured["white"][lit], 0.98))
    shown = [
        ("Direct, measured", measured["direct"]),
        ("Direct, simulated", simulated["direct"]),
        ("Global, measured", measured["global"]),
        ("Global, simulated", simulated["global"]),
    ]
    return {
        "separation_text": "Light for projector white: reflected once (direct) and more than once (global), measured "
        f"with shifted checkers and simulated by the room model. Median share of global light: {100 * share:.0f} %. "
        "All four at the same exposure.",
        "separation_images": [pictures.picture(pictures.photograph(image * scale), alt) for alt, image in shown],
    }


def _correspondence(session: Session) -> dict[str, Any]:
    step = session.finished("correspondence")
    image, record = step.load_image("correspondence"), step.load_record("correspondence")
    valid = image["reason"] == 0
    shares = list(record["reasons"].values())
    return {
        "correspondence_text": "Projector pixel that each camera pixel sees, from Gray code with inverses, and why a "
        "pixel has none.",
        "reasons": [
            {"name": name, "colour": colour, "share": f"{100 * share:.1f} %"}
            for (name, colour), share in zip(pictures.reason_legend(), shares, strict=True)
        ],
        "correspondence_images": [
            pictures.picture(pictures.ramp(image["column"], valid, "turbo"), "Projector column"),
            pictures.picture(pictures.ramp(image["row"], valid, "turbo"), "Projector row"),
            pictures.picture(pictures.reasons(image["reason"]), "Validity: why a pixel is or is not used"),
        ],
    }
