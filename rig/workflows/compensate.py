"""The projector images of each strategy and what the model expects of them: step `compensate`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.photometry import codes_from_linear, linear_from_codes
from calibration.records import Response
from rig.errors import UsageError
from rig.session import Session, Step
from rig.terminal import OnStep
from rig.twin import projector_view, sample
from rig.workflows.model import RoomRecord, load_model
from rig.workflows.photometric import load_photometry
from rig.workflows.target import Target
from sim.compensation import STRATEGIES, compensate

BoolArray = NDArray[np.bool_]
Codes = NDArray[np.uint8]
FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class View:
    """The pixels that count, and the target as the camera should see it."""

    mask: BoolArray
    """(H, W) camera pixels over which errors are taken: lit, valid, and not at the picture's edge."""
    target: FloatArray
    """(H, W) grey levels wanted at each camera pixel; NaN outside the mask."""


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
    response = load_photometry(session).projector
    step.save_image("target", {"grey": target.grey})
    active, transport = model.twin.active, projector_view(model.twin)
    wanted = target.grey.ravel()[active].astype(np.float64) * model.level / 255
    options, summary = measured_options(model), {}
    for k, name in enumerate(names):
        on_step("compute compensation images", k, len(names))
        result = compensate(name, transport, wanted, **options.get(name, {}))
        image = np.zeros(active.size)
        image[active] = result.projector_image
        codes = codes_from_linear(response, image.reshape(target.grey.shape), dither_seed=k + 1)
        linear = image.reshape(target.grey.shape)
        step.save_image(f"projector-{name}", {"linear": linear, "codes": codes.astype(np.float32)})
        step.save_image(f"predicted-{name}", {"light": predict(model, response, codes)})
        summary[name] = {
            "clipped_share": float(result.clipped.mean()),
            "iterations": result.iterations,
            "solver_rms": result.residual_rms * 255 / model.level,
            "notes": dict(result.notes),
        }
    on_step("compute compensation images", len(names), len(names))
    step.save_record("compensation", {"strategies": summary, "active_share": float(active.mean())})
    step.finish()


def measured_options(model: RoomRecord) -> dict[str, dict[str, float]]:
    """What the session has measured that a strategy wants to know."""
    noise_rms = float(np.sqrt(model.white_variance[model.lit].mean()))
    return {"tikhonov": {"noise_rms": noise_rms} if noise_rms > 0 else {}, "perceptual": {"white": model.level}}


def predict(model: RoomRecord, response: Response, codes: Codes) -> FloatArray:
    """(H, W) camera light above black that the model expects of any codes; unseen projector pixels count as dark."""
    linear = linear_from_codes(response, codes).ravel()[model.twin.active]
    return np.asarray(model.twin.camera_transport @ linear.astype(np.float64)).reshape(model.twin.camera.lens.shape)


def judged_view(model: RoomRecord, step: Step) -> View:
    """Where errors are taken, and the target there."""
    grey = step.load_image("target")["grey"].astype(np.float64)
    active = model.twin.active
    xy = model.twin.projector_xy_px.reshape(-1, 2)
    shape = model.twin.camera.lens.shape
    surrounded = np.isfinite(sample(np.where(active.reshape(grey.shape), 1.0, 0.0), xy)).reshape(shape)
    mask = surrounded & model.lit
    # Grey level 0 is a wish like any other: shift so that `sample` does not take it for missing.
    wanted = sample(grey + 1.0, xy).reshape(shape) - 1.0
    return View(mask, np.where(mask, wanted, np.nan))
