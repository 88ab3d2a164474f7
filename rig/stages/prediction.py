"""What the model expects the camera to see of any codes, and where and against what a picture is judged."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.radiometry.response import light_sigma
from rig.files.channels import image_of, layers
from rig.session import Step
from rig.stages.linear_light import RadiometricCalibration, channel_light
from rig.stages.maps.sampling import sample, sample_bands
from rig.stages.maps.uncertainty import SPLIT_BIAS
from rig.stages.model import FittedScene
from rig.stages.target import Target

BoolArray = NDArray[np.bool_]
Codes = NDArray[np.uint8]
FloatArray = NDArray[np.float64]


JUDGED = "the target sharp on the wall, through the camera"
"""Against what pictures are judged: settings of the steps that do."""
_NO_LIGHT = 1e-9


@dataclass(frozen=True, eq=False)
class JudgedPixels:
    """The pixels that count, and the target as the camera should see it."""

    mask: BoolArray
    """(H, W) camera pixels over which errors are taken: lit, valid, and not at the picture's edge."""
    target: FloatArray
    """(H, W, B) grey levels that each camera pixel would see of the target sharp on the wall; NaN outside the mask."""


def wanted_light(model: FittedScene, target: Target) -> FloatArray:
    """Return (n, B) light that a target asks for at the steered pixels, in camera values."""
    levels = target.levels.reshape(-1, model.channels)[model.room.active]
    return np.asarray(levels.astype(np.float64) * model.level / 255)


def whole_picture(model: FittedScene, image: FloatArray) -> FloatArray:
    """Return (H, W, C) picture of n projector values; pixels that are not steered stay black."""
    whole = np.zeros((model.room.active.size, model.channels))
    whole[model.room.active] = image
    return whole.reshape(*model.scene_model.projector.lens.shape, model.channels)


@dataclass(frozen=True, eq=False)
class Prediction:
    """What the model expects the camera to see, and how sure it is, (H, W, B) each."""

    light: FloatArray
    """Above black."""
    sigma: FloatArray
    """Standard deviation, without the noise of the photograph that it is held against."""

    @property
    def channels(self) -> dict[str, NDArray[np.generic]]:
        """Of an image file."""
        return layers("light", self.light) | layers("sigma", self.sigma)


def predict(model: FittedScene, radiometric: RadiometricCalibration, codes: Codes) -> Prediction:
    """Return the camera light that the model expects of codes, with its standard deviation."""
    light = channel_light(radiometric.projector, codes).reshape(-1, model.channels).astype(np.float64)
    transport = model.room.camera_transport
    mixed, white = light @ transport.mixing.T, transport.mixing.sum(axis=1)
    bands = [
        _predict_band(model, band, mixed[:, band], white=white[band], radiometric=radiometric)
        for band in range(model.channels)
    ]
    value, sigma = (np.stack(parts, axis=-1) for parts in zip(*bands, strict=True))
    return Prediction(value, sigma)


@dataclass(frozen=True, eq=False, kw_only=True)
class PictureParts:
    """A picture's light in one band, (H, W) each."""

    direct: FloatArray
    global_: FloatArray
    white_direct: FloatArray
    """Of white ..."""
    white_global: FloatArray
    variance: FloatArray
    """Of the whole, but for what the model does not know of global light, and of the split as a whole."""

    @property
    def value(self) -> FloatArray:
        """All light."""
        return self.direct + self.global_

    @property
    def apart_from_white(self) -> FloatArray:
        """Global light, less what white has of it where the picture is so bright: a relative error makes so much."""
        share = _at_most_all(self.direct, self.white_direct)
        return np.asarray(self.global_ - self.white_global * share)

    def moved_by(self, error: FloatArray | float) -> FloatArray:
        """Return what a relative error of direct light makes of the picture; in white it cancels."""
        share = _at_most_all(self.global_, self.white_global)
        return np.asarray(error * (self.direct - self.white_direct * share))


def picture_parts(
    model: FittedScene, radiometric: RadiometricCalibration, *, band: int, light: FloatArray, white: float = 1.0
) -> PictureParts:
    """Return what a band's light (n pixels,) of the projector makes in the camera, in parts."""
    transport, shape = model.room.camera_transport.bands[band], model.scene_model.camera.lens.shape
    images = np.stack([light, np.full_like(light, white)], axis=-1)
    direct, global_ = (np.asarray(part @ images).reshape(*shape, 2) for part in (transport.direct, transport.global_))
    value = direct[..., 0] + global_[..., 0]
    in_white = direct[..., 1] + global_[..., 1]
    noise = model.white_variance[..., band] * _at_most_all(value, in_white) ** 2
    place, width = _edges(model, band, light)
    return PictureParts(
        direct=direct[..., 0],
        global_=global_[..., 0],
        white_direct=direct[..., 1],
        white_global=global_[..., 1],
        variance=noise + place**2 + width**2 + curve_sigma(radiometric, band, value, in_white) ** 2,
    )


def curve_sigma(radiometric: RadiometricCalibration, band: int, value: FloatArray, in_white: FloatArray) -> FloatArray:
    """Return (H, W) what errors of both response curves make of light (H, W) in a band, beside that of white there.

    Light is read by the camera's curve in the picture, and in white.
    A camera's curve is found by its slopes, from full scale down: errors of its logarithm add up as in a random walk,
    and what both readings share cancels. Of the projector's curve the error counts at the share of white's light that a
    pixel sees: the codes that light it are near.
    """
    balance, share = radiometric.balance[band], _at_most_all(value, in_white)
    read, read_white = (balance * light_sigma(radiometric.camera, light / balance) for light in (value, in_white))
    shown = in_white * light_sigma(radiometric.projector[band], share)
    return np.asarray(np.sqrt(np.abs(read**2 - (share * read_white) ** 2) + shown**2))


def _predict_band(
    model: FittedScene, band: int, light: FloatArray, *, white: float, radiometric: RadiometricCalibration
) -> tuple[FloatArray, FloatArray]:
    """(H, W) light, and its standard deviation."""
    parts = picture_parts(model, radiometric, band=band, light=light, white=white)
    split = model.uncertainty.split[..., band]
    if model.learned is not None:
        learned = model.learned[band]
        known = learned.variance(light / white, parts.direct, parts.white_direct)
        variance = parts.moved_by(split) ** 2 + known + (learned.uneven * parts.apart_from_white) ** 2
    else:
        # An error of the split moves light between direct and global; in white it cancels.
        unseen = np.broadcast_to(model.unseen, (*parts.direct.shape, model.channels))[..., band]
        of_patches = np.hypot(model.global_error, unseen) * parts.apart_from_white
        variance = parts.moved_by(np.hypot(SPLIT_BIAS, split)) ** 2 + of_patches**2
    return parts.value, np.sqrt(parts.variance + variance)


def _at_most_all(light: FloatArray, of_white: FloatArray) -> FloatArray:
    """Light over that of white, 0 … 1: no picture is brighter, and where next to nothing arrives neither tells."""
    return np.asarray(np.clip(light / np.maximum(of_white, _NO_LIGHT), 0.0, 1.0))


def _edges(model: FittedScene, band: int, light: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(H, W) what errors of the places and of the blur's variance make of a picture's edges."""
    scene_model = model.room.bands[band]
    blur = model.room.camera_transport.bands[band].blur
    picture = (light if blur is None else blur.apply(light)).reshape(scene_model.projector.lens.shape)
    down, right = (np.asarray(np.gradient(picture, axis=axis)) for axis in (0, 1))
    high, wide = np.asarray(np.gradient(down, axis=0)), np.asarray(np.gradient(right, axis=1))
    xy = np.nan_to_num(scene_model.light.projector_xy_px, nan=-10.0).astype(np.float32)
    seen = [
        cv2.remap(image.astype(np.float32), xy[..., 0], xy[..., 1], cv2.INTER_LINEAR).astype(np.float64)
        for image in (np.hypot(down, right), np.abs(wide), np.abs(high))
    ]
    known, gain = model.uncertainty, scene_model.light.direct_gain
    # The variance of a Gaussian is its time in the heat equation: ∂s/∂v = ½ ∂²s/∂x².
    width = 0.5 * (known.variance_px2[..., 0] * seen[1] + known.variance_px2[..., 1] * seen[2])
    return gain * known.place_px * seen[0], gain * width


def judged_pixels(model: FittedScene, step: Step) -> JudgedPixels:
    """Return where errors are taken, and the target there."""
    room, grey = model.room, image_of(step.load_image("target"), "grey").astype(np.float64)
    # The picture is wanted on the wall: what the camera's own blur makes of it is no error of it.
    on_wall = np.zeros((room.active.size, model.channels))
    on_wall[room.active] = room.through_camera(grey.reshape(-1, model.channels)[room.active])
    xy = model.scene_model.light.projector_xy_px.reshape(-1, 2)
    shape = model.scene_model.camera.lens.shape
    active = np.where(room.active.reshape(grey.shape[:2]), 1.0, 0.0)
    mask = np.isfinite(sample(active, xy)).reshape(shape) & model.lit
    # Grey level 0 is a wish like any other: shift so that `sample` does not take it for missing.
    wanted = sample_bands(on_wall.reshape(grey.shape) + 1.0, xy).reshape(*shape, model.channels) - 1.0
    return JudgedPixels(mask, np.where(mask[..., None], wanted, np.nan))
