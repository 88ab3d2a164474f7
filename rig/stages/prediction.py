"""What the model expects the camera to see of any codes, and where and against what a picture is judged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.radiometry.response import Response
from rig.files.channels import image_of
from rig.session import Step
from rig.stages.linear_light import channel_light
from rig.stages.model import FittedScene
from rig.stages.scene_model import sample, sample_bands
from rig.stages.target import Target

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


def wanted_light(model: FittedScene, target: Target) -> FloatArray:
    """Return (n, B) light that a target asks for at the steered pixels, in camera values."""
    levels = target.levels.reshape(-1, model.channels)[model.room.active]
    return np.asarray(levels.astype(np.float64) * model.level / 255)


def whole_picture(model: FittedScene, image: FloatArray) -> FloatArray:
    """Return (H, W, C) picture of n projector values; pixels that are not steered stay black."""
    whole = np.zeros((model.room.active.size, model.channels))
    whole[model.room.active] = image
    return whole.reshape(*model.scene_model.projector.lens.shape, model.channels)


def predict(model: FittedScene, responses: Sequence[Response], codes: Codes) -> FloatArray:
    """Return (H, W, B) camera light above black that the model expects of codes."""
    light = channel_light(responses, codes).reshape(-1, model.channels)
    seen = model.room.camera_transport.forward(light.astype(np.float64))
    return np.asarray(seen.reshape(*model.scene_model.camera.lens.shape, model.channels))


def judged_pixels(model: FittedScene, step: Step) -> JudgedPixels:
    """Return where errors are taken, and the target there."""
    grey = image_of(step.load_image("target"), "grey").astype(np.float64)
    xy = model.scene_model.light.projector_xy_px.reshape(-1, 2)
    shape = model.scene_model.camera.lens.shape
    active = np.where(model.room.active.reshape(grey.shape[:2]), 1.0, 0.0)
    mask = np.isfinite(sample(active, xy)).reshape(shape) & model.lit
    # Grey level 0 is a wish like any other: shift so that `sample` does not take it for missing.
    wanted = sample_bands(grey + 1.0, xy).reshape(*shape, model.channels) - 1.0
    return JudgedPixels(mask, np.where(mask[..., None], wanted, np.nan))
