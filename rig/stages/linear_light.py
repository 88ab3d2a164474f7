"""Linear light from a session's frames: black subtracted, exposures merged, with its variance.

The unit is the camera's full scale at the session's reference exposure; the bands of a colour camera are balanced, so
that projector white has the same median light in each.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from calibration.radiometry.response import Response, codes_from_linear, light_of_levels, linear_from_codes
from rig.files.channels import layers, one_or_all
from rig.records import Record
from rig.session import Step
from rig.stages.photograph import ExposureBracket, frame_name

Codes = NDArray[np.uint8]
FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
BoolArray = NDArray[np.bool_]

BLACK_REPEATS = 4
"""Frames of black at each exposure; black then adds a quarter of one frame's noise to every light image."""
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
    def channels(self) -> dict[str, NDArray[np.generic]]:
        """Of an image file: light and its variance."""
        return layers("light", self.value) | layers("variance", self.variance)

    @property
    def any_saturated(self) -> BoolArray:
        """(H, W) clipped in any band."""
        return np.asarray(self.saturated.any(axis=-1))


@dataclass(frozen=True, eq=False, kw_only=True)
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
        """Return (full scale + 1,) linear light of each digital number; below the offset it goes on straight."""
        above = np.arange(self.full_scale_dn + 1, dtype=np.float64) - self.offset_dn
        return np.asarray(light_of_levels(self.camera, above), dtype=np.float32)

    @property
    def saturation_dn(self) -> int:
        """From here on a pixel counts as clipped."""
        return int(self.full_scale_dn * 0.95)


def merge_exposures(
    step: Step, pattern: str, bracket: ExposureBracket, radiometric: RadiometricCalibration
) -> LightImage:
    """Merge a pattern's frames (exposures × repeats) to balanced light above black, by inverse variance.

    Parameters
    ----------
    step
        That has the frames.
    pattern
        Name of what was shown.
    bracket
        How it was photographed.
    radiometric
        How digital numbers become light.

    Returns
    -------
    LightImage
        (H, W, B) light in the camera's full scale at the reference exposure; where every exposure is clipped, the
        shortest one's.
    """
    parts = []
    for exposure, exposure_s in enumerate(bracket.exposures_s):
        names = [frame_name(pattern, exposure, repeat) for repeat in range(bracket.repeats)]
        parts.append(_single_exposure(step, names, exposure_s, radiometric))
    if not parts:
        raise ValueError("a bracket needs at least one exposure")
    weights = [np.where(part.saturated, np.float32(0), 1 / part.variance) for part in parts]
    weighted = [weight * part.value for weight, part in zip(weights, parts, strict=True)]
    weight_sum, total = reduce(np.add, weights), reduce(np.add, weighted)
    good = weight_sum > 0
    safe = np.where(good, weight_sum, 1)
    balance = radiometric.balance.astype(np.float32)
    value, variance = np.where(good, total / safe, parts[0].value), np.where(good, 1 / safe, parts[0].variance)
    return LightImage(value * balance, np.asarray(variance * balance**2, np.float32), ~good)


def _single_exposure(
    step: Step, names: Sequence[str], exposure_s: float, radiometric: RadiometricCalibration
) -> LightImage:
    """Light above black of one exposure's frames, in units of the reference exposure, not balanced."""
    frames = [step.load_frame(name).pixels for name in names]
    table, black = radiometric.table(), radiometric.black[exposure_s]
    # The first frame comes last: the order of a sum is part of its last digits, and those of a session do not change.
    total = sum(table[frame] for frame in frames[1:]) + table[frames[0]]
    mean = np.asarray(total / np.float32(len(frames)), dtype=np.float32)
    ratio = np.float32(exposure_s / radiometric.reference_exposure_s)
    noise = _noise(mean, radiometric) / len(frames) + _noise(black, radiometric) / BLACK_REPEATS
    variance = np.asarray(noise / ratio**2, dtype=np.float32)
    clipped = np.any([frame >= radiometric.saturation_dn for frame in frames], axis=0)
    return LightImage((mean - black) / ratio, variance, clipped)


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


@dataclass(frozen=True, kw_only=True)
class ResponseRecord(Record):
    """A response curve, as a session keeps it."""

    levels: tuple[float, ...]
    """Device levels, increasing: digital numbers above black of a camera, codes of a projector."""
    linear: tuple[float, ...]
    """Linear light at those levels."""
    rms: float
    """Residual of the fit, share of full scale."""

    @classmethod
    def of(cls, response: Response) -> ResponseRecord:
        """Return the record of a response."""
        return cls(levels=tuple(response.levels.tolist()), linear=tuple(response.linear.tolist()), rms=response.rms)

    def response(self) -> Response:
        """Return the response of the record."""
        return Response(np.array(self.levels), np.array(self.linear), self.rms)
