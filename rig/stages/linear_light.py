"""Linear light from a session's frames: black subtracted, exposures merged, with its variance.

The unit is the camera's full scale at the session's reference exposure; the bands of a colour camera are balanced, so
that projector white has the same median light in each.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.radiometry.response import Response, codes_from_linear, light_of_levels, linear_from_codes
from rig.files.channels import layers, one_or_all
from rig.session import Step
from rig.stages.photograph import ExposureBracket, frame_name

Codes = NDArray[np.uint8]
FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
BoolArray = NDArray[np.bool_]

_SEEDS_APART = 1000
"""Between the dithers of two channels."""


@dataclass(frozen=True, slots=True)
class LightImage:
    """A photograph in linear light, all (H, W, B)."""

    value: Float32Array
    variance: Float32Array
    saturated: BoolArray
    """Clipped in every exposure."""

    @property
    def channels(self) -> dict[str, NDArray[Any]]:
        """Of an image file: light and its variance."""
        return layers("light", self.value) | layers("variance", self.variance)

    @property
    def any_saturated(self) -> BoolArray:
        """(H, W) clipped in any band."""
        return np.asarray(self.saturated.any(axis=-1))


@dataclass(frozen=True, eq=False)
class RadiometricCalibration:
    """How digital numbers become light on this rig."""

    reference_exposure_s: float
    offset_dn: float
    """Digital number without any light."""
    full_scale_dn: int
    camera: Response
    """The same in each band."""
    projector: tuple[Response, ...]
    """Of each channel."""
    gain_e_per_dn: float
    read_noise_dn: float
    black: Mapping[float, Float32Array]
    """(H, W, B) linear light (not relative to exposure, not balanced) while the projector shows black, by exposure.
    [full scale]"""
    mixing: FloatArray
    """(B, B) K[b, q]: share of white in band b that channel q of the projector makes; rows sum to 1."""
    balance: FloatArray
    """(B,) factors that make projector white alike in the bands."""

    def table(self) -> Float32Array:
        """(full scale + 1,) linear light of each digital number; below the offset it goes on straight."""
        above = np.arange(self.full_scale_dn + 1, dtype=np.float64) - self.offset_dn
        return np.asarray(light_of_levels(self.camera, above), dtype=np.float32)

    @property
    def saturation_dn(self) -> int:
        """From here on a pixel counts as clipped."""
        return int(self.full_scale_dn * 0.95)


def merge_exposures(step: Step, pattern: str, shot: ExposureBracket, radiometric: RadiometricCalibration) -> LightImage:
    """Merge a pattern's frames (exposures × repeats) to balanced light above black, by inverse variance."""
    table = radiometric.table()
    weight_sum: Float32Array | None = None
    for exposure, exposure_s in enumerate(shot.exposures_s):
        mean, clipped = _mean_of_repeats(step, pattern, exposure, shot.repeats, table, radiometric)
        ratio = np.float32(exposure_s / radiometric.reference_exposure_s)
        variance = (
            _noise(mean, radiometric) / shot.repeats + _noise(radiometric.black[exposure_s], radiometric) / 4
        ) / ratio**2
        weight = np.where(clipped, np.float32(0), 1 / variance)
        value = (mean - radiometric.black[exposure_s]) / ratio
        if weight_sum is None:
            weight_sum, total, shortest, shortest_variance = weight, weight * value, value, variance
        else:
            weight_sum, total = weight_sum + weight, total + weight * value
    if weight_sum is None:
        raise ValueError("a shot needs at least one exposure")
    good = weight_sum > 0
    safe = np.where(good, weight_sum, 1)
    balance = radiometric.balance.astype(np.float32)
    value, variance = np.where(good, total / safe, shortest), np.where(good, 1 / safe, shortest_variance)
    return LightImage(value * balance, np.asarray(variance * balance**2, np.float32), ~good)


def _mean_of_repeats(
    step: Step, pattern: str, exposure: int, repeats: int, table: Float32Array, radiometric: RadiometricCalibration
) -> tuple[Float32Array, BoolArray]:
    frames = [step.load_frame(frame_name(pattern, exposure, r)).pixels for r in range(repeats)]
    mean = sum(table[f] for f in frames[1:]) + table[frames[0]] if len(frames) > 1 else table[frames[0]]
    clipped = np.any([f >= radiometric.saturation_dn for f in frames], axis=0)
    return np.asarray(mean / np.float32(repeats)), clipped


def _noise(linear: Float32Array, radiometric: RadiometricCalibration) -> Float32Array:
    """Variance of one frame's linear light: shot noise, read noise and rounding."""
    scale = np.float32(radiometric.camera.linear[-1] / radiometric.camera.levels[-1])
    digital = np.maximum(linear / scale, 0)
    shot_noise = digital / np.float32(radiometric.gain_e_per_dn)
    return np.asarray((shot_noise + np.float32(radiometric.read_noise_dn**2 + 1 / 12)) * scale**2, dtype=np.float32)


def channel_light(responses: Sequence[Response], codes: Codes) -> Float32Array:
    """(H, W, C) linear light of each channel for codes (H, W), which count for all channels, or (H, W, C)."""
    channels = np.broadcast_to(codes.reshape(*codes.shape[:2], -1), (*codes.shape[:2], len(responses)))
    return np.stack([linear_from_codes(response, channels[..., q]) for q, response in enumerate(responses)], axis=-1)


def channel_codes(responses: Sequence[Response], linear: FloatArray, seed: int) -> Codes:
    """Codes of linear light (H, W, C), dithered: (H, W) of one channel, else (H, W, C)."""
    codes = [
        codes_from_linear(response, linear[..., q], dither_seed=seed + _SEEDS_APART * q)
        for q, response in enumerate(responses)
    ]
    return one_or_all(np.stack(codes, axis=-1))


def response_record(response: Response) -> dict[str, Any]:
    """A response for a JSON record."""
    return {"levels": response.levels.tolist(), "linear": response.linear.tolist(), "rms": response.rms}


def response_of(record: Mapping[str, Any]) -> Response:
    """The inverse of :func:`response_record`."""
    return Response(np.array(record["levels"]), np.array(record["linear"]), float(record["rms"]))
