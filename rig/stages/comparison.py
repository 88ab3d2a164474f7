"""Project, photograph, compare: steps `project` and `compare`."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.structured_light.patterns import Pattern
from rig.capture.rig import Rig
from rig.files.channels import codes_of, image_of, layers
from rig.session import Session, Step
from rig.stages.compensation import JudgedPixels, judged_pixels, predict
from rig.stages.linear_light import LightImage, merge_exposures
from rig.stages.model import FittedScene, load_model, simulated_white
from rig.stages.photograph import ExposureBracket, photograph
from rig.stages.picture_errors import picture_errors
from rig.stages.radiometry import load_radiometric_calibration, measuring_bracket
from rig.terminal import OnStep

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


def held_out_patterns(shape: tuple[int, int]) -> list[Pattern]:
    """Pictures that nothing was fitted to: one half white (interreflection across the corner), and soft blobs."""
    height, width = shape
    half = np.zeros(shape, dtype=np.uint8)
    half[:, : width // 2] = 255
    noise = np.random.default_rng(12).uniform(size=(6, 8)).astype(np.float32)
    blobs = cv2.resize(noise, (width, height), interpolation=cv2.INTER_CUBIC)
    return [
        Pattern("held-out-half", half),
        Pattern("held-out-blobs", np.clip(255 * blobs, 0, 255).astype(np.uint8)),
    ]


def project_and_photograph(rig: Rig, session: Session, on_step: OnStep) -> None:
    """Show every compensation image and the held-out pictures, and photograph them."""
    shot = measuring_bracket(rig, session)
    compensated = session.finished("compensate")
    step = session.step(
        "project", settings={"exposures_s": shot.exposures_s, "repeats": shot.repeats}, needs=("compensate",)
    )
    if step.done:
        return
    patterns = [
        Pattern(f"shown-{name}", codes_of(compensated.load_image(f"projector-{name}")))
        for name in strategies_of(session)
    ]
    patterns += held_out_patterns(rig.projector.shape)
    photograph(rig, session, step, patterns, shot, len(patterns), on_step)
    step.save_record("shot", {"exposures_s": list(shot.exposures_s), "repeats": shot.repeats})
    step.finish()


def strategies_of(session: Session) -> list[str]:
    """Strategies of the session's compensation, in order."""
    return list(session.finished("compensate").load_record("compensation")["strategies"])


def compare_all(session: Session, on_step: OnStep) -> None:
    """Measure the errors: against the target for each strategy, against the prediction for every frame."""
    step = session.step("compare", settings={}, needs=("response", "model", "compensate", "project"))
    if step.done:
        return
    model, compensated, projected = load_model(session), session.finished("compensate"), session.finished("project")
    view = judged_pixels(model, compensated)
    names = strategies_of(session)
    total = len(names) + 2
    frames: dict[str, Any] = {}
    strategies: dict[str, Any] = {}
    residuals: list[tuple[FloatArray, FloatArray]] = []
    shot_record = projected.load_record("shot")
    shot = ExposureBracket(tuple(shot_record["exposures_s"]), shot_record["repeats"])
    radiometric = load_radiometric_calibration(session)
    for k, name in enumerate(names):
        on_step("compare measured and simulated", k, total)
        measured = merge_exposures(projected, f"shown-{name}", shot, radiometric)
        predicted = image_of(compensated.load_image(f"predicted-{name}"), "light").astype(np.float64)
        strategies[name] = {
            "measured": _against_target(measured.value.astype(np.float64), view, model.level),
            "predicted": _against_target(predicted, view, model.level),
        }
        frames[name] = _compare_frame(step, name, measured, predicted, view.mask, model, residuals)
    for k, pattern in enumerate(held_out_patterns(model.scene_model.projector.lens.shape)):
        on_step("compare measured and simulated", len(names) + k, total)
        measured = merge_exposures(projected, pattern.name, shot, radiometric)
        predicted = predict(model, radiometric.projector, pattern.codes)
        frames[pattern.name] = _compare_frame(step, pattern.name, measured, predicted, view.mask, model, residuals)
    on_step("compare measured and simulated", total, total)
    white = simulated_white(model.room)
    step.save_image("simulated-white", layers("direct", white["direct"]) | layers("global", white["global"]))
    difference, sigma = (np.concatenate(part) for part in zip(*residuals, strict=True))
    overall = _residual_figures(difference, sigma)
    judged = {"mask": view.mask.astype(np.float32), **layers("target", np.nan_to_num(view.target))}
    step.save_image("judged", judged, folder="maps")
    step.save_record("comparison", {"overall": overall, "frames": frames, "strategies": strategies})
    step.finish()


def _against_target(light: FloatArray, view: JudgedPixels, level: float) -> dict[str, float]:
    """Errors in grey levels on the session's brightness scale."""
    return picture_errors(light * 255 / level, view.target, view.mask)


def _compare_frame(
    step: Step,
    name: str,
    measured: LightImage,
    predicted: FloatArray,
    mask: BoolArray,
    model: FittedScene,
    residuals: list[tuple[FloatArray, FloatArray]],
) -> dict[str, float]:
    """Measured minus predicted on one frame, over all bands, in grey levels; keeps the images and the residuals."""
    step.save_image(f"measured-{name}", measured.channels)
    if name.startswith("held-out"):
        step.save_image(f"predicted-{name}", layers("light", predicted))
    scale = 255 / model.level
    usable = mask & ~measured.any_saturated
    difference = ((measured.value - predicted) * scale)[usable]
    # The model's direct light was measured too: its noise is part of what is to be expected.
    relative = model.white_variance[usable] / np.maximum(model.white[usable], 1e-6) ** 2
    variance = measured.variance[usable] + predicted[usable] ** 2 * relative
    sigma = np.sqrt(variance) * scale
    residuals.append((difference, sigma))
    return _residual_figures(difference, sigma)


def _residual_figures(difference: FloatArray, sigma: FloatArray) -> dict[str, float]:
    return {
        "rmse": float(np.sqrt((difference**2).mean())),
        "bias": float(difference.mean()),
        "within_3_sigma": float((np.abs(difference) <= 3 * sigma).mean()),
        "noise_rms": float(np.sqrt((sigma**2).mean())),
    }
