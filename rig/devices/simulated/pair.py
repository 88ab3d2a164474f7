"""The simulated world as one camera and one projector share it: all that does not hang on what the scene is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from rig.devices.protocols import Codes
from rig.devices.simulated.defocus import defocused
from rig.devices.simulated.optics import SimulatedOptics, blurred, haloed, make_optics, relative_illumination
from rig.devices.simulated.settings import SimulatedProjectorSettings, SimulationSettings

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Light:
    """What reaches the camera's pixels, before its lens: radiosity, relative units, (H, W)."""

    direct: Float32Array
    global_: Float32Array
    ambient: Float32Array

    @property
    def total(self) -> Float32Array:
        """All of it."""
        return np.asarray(self.direct + self.global_ + self.ambient)


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenSurface:
    """What the middles of a camera's pixels look at; NaN where they look at nothing."""

    points_m: FloatArray
    """(H, W, 3)."""
    normals: FloatArray
    """(H, W, 3) unit vectors on the side that is seen."""
    reflectance: FloatArray
    """(H, W) matte."""


class SimulatedPair(ABC):
    """Lenses and response of a simulated rig. Light depends on the shown picture only, not on time.

    Parameters
    ----------
    camera_shape, projector_shape : (H, W)
    band : int, optional
        Of a colour camera: 0 red, 1 green, 2 blue; None: all, as a grey camera sees it.
    """

    def __init__(
        self,
        settings: SimulationSettings,
        camera_shape: tuple[int, int],
        projector_shape: tuple[int, int],
        band: int | None,
    ):
        self.settings = settings
        self.band = band
        self.camera: SimulatedOptics = make_optics(settings.camera, camera_shape)
        self.projector: SimulatedOptics = make_optics(settings.projector, projector_shape)

    @abstractmethod
    def light_of(self, linear: Float32Array) -> Light:
        """Radiosity for a picture in linear light, (H, W), 1 = white."""

    @property
    @abstractmethod
    def ambient(self) -> Float32Array:
        """(H, W) radiosity of the room light alone, its mean over time."""

    @property
    @abstractmethod
    def surface(self) -> SeenSurface:
        """What the camera's pixels look at."""

    def light(self, codes: Codes) -> Light:
        """Radiosity that the camera sees while the projector shows `codes`."""
        return self.light_of(self.projector_linear(codes))

    def projector_linear(self, codes: Codes) -> Float32Array:
        """(H, W) linear light in this band that the projector makes of codes; black above 0.

        White is the sum of `channel_weights`: 1 unless the profile's mixing says otherwise.
        """
        responses, weights = projector_responses(self.settings.projector), self.channel_weights
        if codes.ndim == 2:
            return np.asarray(grey_table(responses, weights)[codes], dtype=np.float32)
        coloured = cv2.LUT(codes, responses.T[None] if len(responses) > 1 else responses[0])
        mixed = cv2.transform(coloured, weights[None, :])
        if not (boost := self.settings.projector.white_boost):
            return np.asarray(mixed, dtype=np.float32)
        white = boost * weights.sum() * coloured.min(axis=2)
        return np.asarray((mixed + white) / (1 + boost), dtype=np.float32)

    @property
    def channel_weights(self) -> FloatArray:
        """(3,) light of the projector's channels in this band: a row of the mixing, for a grey camera their mean."""
        mixing = np.array(self.settings.projector.mixing)
        return np.asarray(mixing.mean(axis=0) if self.band is None else mixing[self.band])

    @cached_property
    def vignetting(self) -> Float32Array:
        """(H, W) relative illumination of the camera's pixels."""
        return relative_illumination(self.camera, pixel_grid(self.camera.shape)).astype(np.float32)

    def through_lens(self, radiosity: Float32Array) -> Float32Array:
        """(H, W) light on the sensor: out of focus, blurred and vignetted."""
        sharp = radiosity
        if self.settings.camera.aperture_m > 0:
            sharp = defocused(self.camera, radiosity, self.camera.depth_m(self.surface.points_m))
        return np.asarray(haloed(self.camera, blurred(self.camera, sharp)) * self.vignetting, dtype=np.float32)

    def ambient_swell(self, starts_s: FloatArray, exposure_s: float) -> FloatArray:
        """Return by how much the room light is above its mean during exposures, share of the mean; as `starts_s`."""
        settings = self.settings
        middle = np.sin(2 * np.pi * settings.ambient_flicker_hz * (starts_s + exposure_s / 2))
        return np.asarray(settings.ambient_flicker * np.sinc(settings.ambient_flicker_hz * exposure_s) * middle)

    def lamp(self, starts_s: FloatArray, exposure_s: float) -> FloatArray:
        """Return the projector's light during exposures as a share of a warm lamp's; as `starts_s`."""
        projector = self.settings.projector
        return 1 - projector.lamp_drift * np.exp(-(starts_s + exposure_s / 2) / projector.lamp_warm_up_s)


class SeenLight:
    """What reaches the camera's sensor through its lens; that of the last few pictures is kept."""

    def __init__(self, world: SimulatedPair, kept: int):
        self._world = world
        self._kept = kept
        self._known: list[tuple[Codes, Float32Array]] = []

    def of(self, codes: Codes) -> Float32Array:
        """(H, W) relative light on the sensor while the projector shows `codes`."""
        for k, (known, light) in enumerate(self._known):
            if np.array_equal(known, codes):
                self._known.insert(0, self._known.pop(k))
                return light
        light = self.through_lens(self._world.light(codes).total)
        self._known = [(codes, light), *self._known[: self._kept - 1]]
        return light

    def through_lens(self, radiosity: Float32Array) -> Float32Array:
        """(H, W) light on the sensor, blurred and vignetted."""
        return self._world.through_lens(radiosity)


def projector_responses(projector: SimulatedProjectorSettings) -> Float32Array:
    """(1 or 3, 256) linear light of each code: power law mixed with a smooth step, above the black level."""
    x, gamma = np.arange(256) / 255, np.array(projector.gamma)[:, None]
    curve = (1 - projector.s_shape) * x**gamma + projector.s_shape * x * x * (3 - 2 * x)
    black = 1 / projector.contrast
    return np.asarray(black + (1 - black) * curve, dtype=np.float32)


def grey_table(responses: Float32Array, weights: FloatArray) -> Float32Array:
    """(256,) light of grey codes in a band that gets these weights (3,) of the channels."""
    if len(responses) == 1:
        return np.asarray(responses[0] * np.float32(weights.sum()), dtype=np.float32)
    return np.asarray(weights @ responses, dtype=np.float32)


def pixel_grid(shape: tuple[int, int], samples: int = 1) -> FloatArray:
    """(H·samples, W·samples, 2) pixel coordinates (x, y) of sub-sample centres."""
    y, x = ((np.arange(n * samples) + 0.5) / samples - 0.5 for n in shape)
    return np.stack(np.meshgrid(x, y), axis=-1)
