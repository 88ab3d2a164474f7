"""What a session has measured, in the keys that others rely on (metrics.json, `rig run --json`)."""

from __future__ import annotations

from typing import Any

import numpy as np

from rig.capture.rig import Rig
from rig.files.channels import by_band, image_of, of_bands
from rig.profile.tables import Limits
from rig.session import Session
from rig.stages.correspondence import load_correspondence
from rig.stages.model import load_model
from rig.truth.scores import score


def collect_metrics(session: Session, rig: Rig, upto: str) -> dict[str, Any]:
    """Metrics of everything that is finished; the verdict when the session was compared."""
    metrics: dict[str, Any] = {}
    if session.is_finished("geometry"):
        metrics["geometry"] = _geometry(session)
    if upto == "calibrate" or not session.is_finished("separation"):
        return metrics
    metrics["separation"] = _separation(session)
    if not session.is_finished("model") or upto == "separate":
        return metrics
    metrics["geometry"]["valid_share"] = _valid_share(session)
    metrics["model"] = _model(session)
    truth = score(rig, session)
    if truth is not None:
        metrics["truth"] = truth
    if upto in ("compensate", "compare") and session.is_finished("compensate"):
        metrics["compensation"] = _compensation(session)
    if upto == "compare":
        metrics |= _comparison(session)
        metrics["limits"] = _limits(metrics, rig.profile.limits)
        metrics["within_limits"] = all(row["passed"] for row in metrics["limits"])
    return metrics


def _geometry(session: Session) -> dict[str, Any]:
    record = session.finished("geometry").load_record("geometry")
    reasons = session.finished("correspondence").load_record("correspondence")
    return {
        "rms_px": record["rms_px"],
        "camera_rms_px": record["camera_rms_px"],
        "projector_rms_px": record["projector_rms_px"],
        "valid_share_of_image": reasons["valid_share_of_image"],
        "baseline_m": record["baseline_m"],
        "room_size_m": record["room"]["size_m"],
        "faces_seen": record["room"]["seen"],
        "room_notes": record["room"]["notes"],
        "sigmas": record["sigmas"],
    }


def _valid_share(session: Session) -> float:
    """Valid pixels among those that the projector lights, by their measured direct light."""
    direct = image_of(session.finished("separation").load_image("separation"), "direct").mean(axis=-1)
    valid = load_correspondence(session).valid
    lit = direct > 0.05 * np.median(direct[valid])
    return float((valid & lit).sum() / max(int(lit.sum()), 1))


def _separation(session: Session) -> dict[str, float]:
    image = session.finished("separation").load_image("separation")
    white, global_ = image_of(image, "white"), image_of(image, "global")
    valid = load_correspondence(session).valid & (white > 0).all(axis=-1)
    share = global_[valid] / white[valid]
    return {"global_share_mean": float(share.mean()), "global_share_median": float(np.median(share))}


def _model(session: Session) -> dict[str, Any]:
    record = session.finished("model").load_record("model")
    model = load_model(session)
    reflectance = of_bands(record["reflectance"], model.channels)
    source = np.array(of_bands(record["source"], model.channels)[0])
    areas = model.scene_model.scene.areas
    return {
        "patches": len(source),
        "reflectance_mean": by_band([float(np.average(band, weights=areas)) for band in reflectance]),
        "patches_lit_and_seen": int((source == 0).sum()),
        "patches_seen_in_global_light": int((source == 1).sum()),
        "patches_unseen": int((source == 2).sum()),
        "unseen_reflectance": record["unseen_reflectance"],
        "unseen_sigma": record["unseen_sigma"],
        "flux": record["flux"],
        "global_rms": record["global_rms"],
        "vignetting_camera": record["vignetting_camera"],
        "vignetting_projector": record["vignetting_projector"],
        "level": record["level"],
        **_colour(session),
    }


def _colour(session: Session) -> dict[str, Any]:
    """How the projector's channels mix; nothing of a grey rig."""
    record = session.finished("response").load_record("radiometric")
    names = ("mixing", "mixing_variation", "white_over_channels", "balance")
    return {name: record[name] for name in names if name in record}


def _compensation(session: Session) -> dict[str, Any]:
    record = session.finished("compensate").load_record("compensation")
    best = _best(list(record["strategies"]))
    return {"strategy": best, "clipped_share": record["strategies"][best]["clipped_share"]}


def _best(names: list[str]) -> str:
    """The strategy that stands for 'compensated': the most complete one that was asked for."""
    return next(name for name in ("bounded", "exact", "paper", "direct", "none") if name in names)


def _comparison(session: Session) -> dict[str, Any]:
    compared = session.finished("compare").load_record("comparison")
    computed = session.finished("compensate").load_record("compensation")["strategies"]
    strategies = {
        name: {
            **entry,
            "clipped_share": computed[name]["clipped_share"],
            "iterations": computed[name]["iterations"],
            "notes": computed[name]["notes"],
        }
        for name, entry in compared["strategies"].items()
    }
    best = _best(list(strategies))
    chosen = {"uncompensated": "none", "compensated": best}
    return {
        "measured": {key: strategies[name]["measured"] for key, name in chosen.items()},
        "strategies": strategies,
        "comparison": {**compared["overall"], "frames": compared["frames"]},
    }


def _limits(metrics: dict[str, Any], limits: Limits) -> list[dict[str, Any]]:
    geometry, comparison = metrics["geometry"], metrics["comparison"]
    rows = [
        ("geometry: reprojection rms, px", geometry["rms_px"], limits.geometry_rms_px, False),
        ("valid share of the lit pixels", geometry["valid_share"], limits.valid_share, True),
        ("measured - simulated: rms, grey levels", comparison["rmse"], limits.comparison_rmse, False),
        ("measured - simulated: |bias|, grey levels", abs(comparison["bias"]), limits.comparison_bias, False),
    ]
    return [
        {"what": what, "value": value, "limit": limit, "passed": bool(value >= limit if least else value <= limit)}
        for what, value, limit, least in rows
    ]
