"""Linear light from a session's frames: black subtracted, exposures merged, with its variance.

The unit is the camera's full scale at the session's reference exposure; the bands of a colour camera are balanced, so
that projector white has the same median light in each.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, reduce

import numpy as np
from numpy.typing import NDArray

from calibration.radiometry.mosaic import Mosaic
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
"""Frames of black at each exposure, at least; black then adds a quarter of one frame's noise to every light image."""
_WITHIN_STEP, _EVEN_VARIANCE = np.array([-0.4, -0.2, 0.0, 0.2, 0.4]), 1 / 12
"""Levels that are rounded to one digital number, five for all of them. [dn]"""
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

    def in_bands(self, mosaic: Mosaic | None) -> LightImage:
        """Return the image of a sensor behind a mosaic, (H, W, 1), in three bands; of another, itself."""
        if mosaic is None:
            return self
        return LightImage(
            mosaic.interpolated(self.value),
            mosaic.interpolated_variance(self.variance),
            mosaic.touched(self.saturated),
        )


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
    processing_noise_dn: float = 0.0
    """What the camera's processing, as JPEG, adds to a frame, and to each repeat alike; 0 for raw frames."""
    black: Mapping[float, Float32Array]
    """(H, W, B) linear light (not relative to exposure, not balanced) while the projector shows black, by exposure.
    [full scale]"""
    black_ripple: Mapping[float, float] = field(default_factory=dict)
    """Standard deviation of that light from frame to frame, share of it, by exposure: a mains light that flickers.
    Where photographs are averaged over its period, such that the mean of as many frames of black has what is left."""
    black_repeats: int = BLACK_REPEATS
    """Frames of black at each exposure."""
    black_swell: Mapping[float, float] = field(default_factory=dict)
    """By what share of that light a mains light makes single frames brighter and darker, by exposure."""
    mixing: FloatArray
    """(B, B) K[b, q]: share of white in band b that channel q of the projector makes; rows sum to 1."""
    balance: FloatArray
    """(B,) factors that make projector white alike in the bands."""
    mosaic: Mosaic | None = None
    """Of a camera whose frames have one number a pixel, and three bands all the same."""

    def table(self) -> Float32Array:
        """Return (full scale + 1,) linear light of each digital number; below the offset it goes on straight.

        It is the mean over all levels that are rounded to that number.
        """
        return np.asarray(self._light_within_steps().mean(axis=0), dtype=np.float32)

    def noise(self, linear: FloatArray | Float32Array) -> Float32Array:
        """Return the variance of one frame's linear light: shot noise, read noise and rounding; any shape."""
        rounding = np.interp(linear, *self._rounding).astype(np.float32)
        return np.asarray(self._sensor_noise(linear) + rounding)

    def noise_of_mean(self, frames: Sequence[NDArray[np.uint16]], mean: Float32Array) -> Float32Array:
        """Return the variance of the mean light of frames of digital numbers; all of one shape."""
        rounding = self._rounding[1].astype(np.float32)
        rounded = reduce(np.add, [rounding[frame] for frame in frames]) / np.float32(len(frames))
        return np.asarray((self._sensor_noise(mean) + rounded) / np.float32(len(frames)), dtype=np.float32)

    def processing_noise(self, linear: Float32Array) -> Float32Array:
        """Return the variance that processing leaves of linear light, of one frame or many."""
        return np.asarray((self.processing_noise_dn * self.light_of_a_dn(linear)) ** 2, dtype=np.float32)

    def light_of_a_dn(self, linear: FloatArray | Float32Array) -> FloatArray:
        """Return the light that a digital number makes at some light, any shape."""
        light = self._rounding[0]
        return np.asarray(np.interp(linear, light, np.gradient(light)))

    def black_seen(self, exposure_s: float) -> Float32Array:
        """Return the light of black as frames have it: (H, W, B), or (H, W, 1) of a mosaic."""
        black = self.black[exposure_s]
        return black if self.mosaic is None else np.asarray(self.mosaic.seen(black), np.float32)

    def black_noise(self, exposure_s: float) -> Float32Array:
        """Return the variance of one frame of black, in the shape of :meth:`black_seen`."""
        return self._black_noise[exposure_s]

    def noise_dn(self) -> Float32Array:
        """Return (full scale + 1,) standard deviation of a pixel at each digital number. [dn]."""
        above = np.arange(self.full_scale_dn + 1, dtype=np.float64) - self.offset_dn
        light = np.maximum(light_of_levels(self.camera, above), 0)
        brighter = np.interp(light + np.sqrt(self._sensor_noise(light)), self.camera.linear, self.camera.levels)
        top = (self.camera.levels[-1] - self.camera.levels[-2]) / (self.camera.linear[-1] - self.camera.linear[-2])
        least = np.sqrt(self._sensor_noise(light)) * top
        return np.asarray(np.hypot(np.maximum(brighter - np.maximum(above, 0), least), 1 / 12**0.5), dtype=np.float32)

    def sum_noise_dn(self, white: NDArray[np.uint16], black: NDArray[np.uint16]) -> FloatArray:
        """Return the noise of the bands' sum, root mean square of a lit and an unlit frame (H, W, B): (H, W) [dn]."""
        noise = self.noise_dn()
        return np.asarray(np.sqrt(((noise[white] ** 2 + noise[black] ** 2) / 2).sum(axis=2)), dtype=np.float64)

    def _sensor_noise(self, linear: FloatArray | Float32Array) -> Float32Array:
        """Variance of linear light before it is rounded."""
        scale = np.float32(self.camera.linear[-1] / self.camera.levels[-1])
        shot_noise = np.maximum(linear / scale, 0) / np.float32(self.gain_e_per_dn)
        return np.asarray((shot_noise + np.float32(self.read_noise_dn**2)) * scale**2, dtype=np.float32)

    def _light_within_steps(self) -> FloatArray:
        """(5, full scale + 1) light of levels that are rounded to each digital number."""
        above = np.arange(self.full_scale_dn + 1, dtype=np.float64) - self.offset_dn
        return light_of_levels(self.camera, above + _WITHIN_STEP[:, None])

    @cached_property
    def _rounding(self) -> tuple[FloatArray, FloatArray]:
        """Light of each digital number, and the variance of what is rounded to it."""
        within = self._light_within_steps()
        return within.mean(axis=0), within.var(axis=0) * (_EVEN_VARIANCE / _WITHIN_STEP.var())

    @cached_property
    def _black_noise(self) -> dict[float, Float32Array]:
        """Variance of one frame of black, by exposure; kept, for it is asked for with every frame."""
        return {exposure_s: self.noise(self.black_seen(exposure_s)) for exposure_s in self.black}

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
    return merge_raw_exposures(step, pattern, bracket, radiometric).in_bands(radiometric.mosaic)


def merge_raw_exposures(
    step: Step, pattern: str, bracket: ExposureBracket, radiometric: RadiometricCalibration
) -> LightImage:
    """Merge as :func:`merge_exposures`, and leave each pixel of a mosaic what it saw: (H, W, 1) of one."""
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
    if radiometric.mosaic is not None:
        balance = radiometric.mosaic.of_bands(radiometric.balance, parts[0].value.shape[:2])
    value, variance = np.where(good, total / safe, parts[0].value), np.where(good, 1 / safe, parts[0].variance)
    return LightImage(value * balance, np.asarray(variance * balance**2, np.float32), ~good)


def _single_exposure(
    step: Step, names: Sequence[str], exposure_s: float, radiometric: RadiometricCalibration
) -> LightImage:
    """Light above black of one exposure's frames, in units of the reference exposure, not balanced."""
    shots = [step.load_frame(name) for name in names]
    frames = [shot.pixels for shot in shots]
    table, black = radiometric.table(), radiometric.black_seen(exposure_s)
    # The first frame comes last: the order of a sum is part of its last digits, and those of a session do not change.
    total = sum(table[frame] for frame in frames[1:]) + table[frames[0]]
    mean = np.asarray(total / np.float32(len(frames)), dtype=np.float32)
    ratio = np.float32(shots[0].exposure_s / radiometric.reference_exposure_s)
    noise = radiometric.noise_of_mean(distinct(frames), mean)
    noise += radiometric.black_noise(exposure_s) / radiometric.black_repeats
    # room light that flickers is not the same in a frame and in the black that is subtracted from it
    ripple = np.float32(radiometric.black_ripple.get(exposure_s, 0.0))
    noise += (ripple * black) ** 2 * np.float32(1 / len(frames) + 1 / radiometric.black_repeats)
    if radiometric.processing_noise_dn:
        noise += radiometric.processing_noise(mean)
    variance = np.asarray(noise / ratio**2, dtype=np.float32)
    clipped = np.any([frame >= radiometric.saturation_dn for frame in frames], axis=0)
    return LightImage((mean - black) / ratio, variance, clipped)


def distinct(frames: Sequence[NDArray[np.uint16]]) -> list[NDArray[np.uint16]]:
    """Leave out frames that are an earlier one over again: a recording gives its last frame as often as it is asked."""
    kept: list[NDArray[np.uint16]] = []
    for frame in frames:
        if not any(np.array_equal(frame, other) for other in kept):
            kept.append(frame)
    return kept


def channel_light(responses: Sequence[Response], codes: Codes) -> Float32Array:
    """(H, W, C) linear light of each channel for codes (H, W), which count for all channels, or (H, W, C)."""
    channels = np.broadcast_to(codes.reshape(*codes.shape[:2], -1), (*codes.shape[:2], len(responses)))
    return np.stack([linear_from_codes(response, channels[..., q]) for q, response in enumerate(responses)], axis=-1)


def channel_codes(responses: Sequence[Response], linear: FloatArray, seed: int | None) -> Codes:
    """Codes of linear light (H, W, C), dithered if a seed is given: (H, W) of one channel, else (H, W, C)."""
    codes = [
        codes_from_linear(response, linear[..., q], dither_seed=None if seed is None else seed + _SEEDS_APART * q)
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
    sigma: tuple[float, ...] = ()
    """Standard errors of the light, where they are known."""

    @classmethod
    def of(cls, response: Response) -> ResponseRecord:
        """Return the record of a response."""
        return cls(
            levels=tuple(response.levels.tolist()),
            linear=tuple(response.linear.tolist()),
            rms=response.rms,
            sigma=() if response.sigma is None else tuple(response.sigma.tolist()),
        )

    def response(self) -> Response:
        """Return the response of the record."""
        sigma = np.array(self.sigma) if self.sigma else None
        return Response(np.array(self.levels), np.array(self.linear), self.rms, sigma)
