"""The projector images of each strategy and what the model expects of them: step `compensate`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.radiometry.response import Response
from rig.errors import UsageError
from rig.files.channels import code_layers, image_of, layers
from rig.session import Session, Step
from rig.stages.linear_light import channel_codes, channel_light
from rig.stages.model import FittedScene, load_model
from rig.stages.radiometry import load_radiometric_calibration
from rig.stages.scene_model import sample, sample_bands
from rig.stages.target import Target
from rig.terminal import OnStep
from sim.compensation import STRATEGIES, compensate

BoolArray = NDArray[np.bool_]
Codes = NDArray[np.uint8]
FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class JudgedPixels:
    """The pixels that count, and the target as the camera should see it."""

    mask: BoolArray
    """(H, W) camera pixels over which errors are taken: lit, valid, and not at the picture's edge."""
    target: FloatArray
    """(H, W, B) grey levels wanted at each camera pixel; NaN outside the mask."""


def check_strategies(names: tuple[str, ...]) -> tuple[str, ...]:
    """Known strategies, `none` always first, for it is what the others are measured against; `all` is every one."""
    names = tuple(STRATEGIES) if "all" in names else names
    unknown = [name for name in names if name not in STRATEGIES]
    if unknown:
        raise UsageError(f"unknown strategy {', '.join(unknown)}; there are {', '.join(STRATEGIES)}, or all")
    return ("none", *(name for name in dict.fromkeys(names) if name != "none"))


def compute_compensation(session: Session, target: Target, strategies: tuple[str, ...], on_step: OnStep) -> None:
    """Solve each strategy in the projector view; predict the camera image of the codes that will be shown."""
    names = check_strategies(strategies)
    settings = {"target": target.name, "target_sha256": target.sha256, "strategies": names}
    step = session.step("compensate", settings=settings, needs=("response", "model"))
    if step.done:
        return
    model = load_model(session)
    responses = load_radiometric_calibration(session).projector
    step.save_image("target", layers("grey", target.levels))
    active, transport = model.room.active, model.room.projector_transport
    wanted = wanted_light(model, target)
    options, summary = measured_options(model), {}
    for k, name in enumerate(names):
        on_step("compute compensation images", k, len(names))
        result = compensate(name, transport, wanted, **options.get(name, {}))
        linear = whole_picture(model, result.projector_image)
        codes = channel_codes(responses, linear, seed=k + 1)
        step.save_image(f"projector-{name}", layers("linear", linear) | code_layers(codes))
        step.save_image(f"predicted-{name}", layers("light", predict(model, responses, codes)))
        summary[name] = {
            "clipped_share": float(result.clipped.mean()),
            "iterations": result.iterations,
            "solver_rms": result.residual_rms * 255 / model.level,
            "notes": dict(result.notes),
        }
    on_step("compute compensation images", len(names), len(names))
    step.save_record("compensation", {"strategies": summary, "active_share": float(active.mean())})
    step.finish()


def measured_options(model: FittedScene) -> dict[str, dict[str, float]]:
    """What the session has measured that a strategy wants to know."""
    noise_rms = float(np.sqrt(model.white_variance[model.lit].mean()))
    return {"tikhonov": {"noise_rms": noise_rms} if noise_rms > 0 else {}, "perceptual": {"white": model.level}}


def wanted_light(model: FittedScene, target: Target) -> FloatArray:
    """(n, B) light that a target asks for at the steered pixels, in camera values."""
    levels = target.levels.reshape(-1, model.channels)[model.room.active]
    return np.asarray(levels.astype(np.float64) * model.level / 255)


def whole_picture(model: FittedScene, image: FloatArray) -> FloatArray:
    """(H, W, C) picture of n projector values; pixels that are not steered stay black."""
    whole = np.zeros((model.room.active.size, model.channels))
    whole[model.room.active] = image
    return whole.reshape(*model.scene_model.projector.lens.shape, model.channels)


def predict(model: FittedScene, responses: Sequence[Response], codes: Codes) -> FloatArray:
    """(H, W, B) camera light above black that the model expects of any codes; unseen projector pixels are dark."""
    light = channel_light(responses, codes).reshape(-1, model.channels)[model.room.active]
    seen = model.room.camera_transport.forward(light.astype(np.float64))
    return np.asarray(seen.reshape(*model.scene_model.camera.lens.shape, model.channels))


def judged_pixels(model: FittedScene, step: Step) -> JudgedPixels:
    """Where errors are taken, and the target there."""
    grey = image_of(step.load_image("target"), "grey").astype(np.float64)
    xy = model.scene_model.projector_xy_px.reshape(-1, 2)
    shape = model.scene_model.camera.lens.shape
    active = np.where(model.room.active.reshape(grey.shape[:2]), 1.0, 0.0)
    mask = np.isfinite(sample(active, xy)).reshape(shape) & model.lit
    # Grey level 0 is a wish like any other: shift so that `sample` does not take it for missing.
    wanted = sample_bands(grey + 1.0, xy).reshape(*shape, model.channels) - 1.0
    return JudgedPixels(mask, np.where(mask[..., None], wanted, np.nan))
