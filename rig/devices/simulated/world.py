"""The simulated world that camera and projector share: what light a picture makes, and what the truth is."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from rig.devices.protocols import Codes
from rig.devices.simulated.optics import (
    SimulatedOptics,
    blurred,
    directions,
    flux_density,
    make_optics,
    pixels_of,
    relative_illumination,
)
from rig.devices.simulated.room import (
    SimulatedRoom,
    SurfacePoints,
    cells_of,
    in_light,
    interpolation,
    make_room,
    reflectance_at,
    trace,
)
from rig.devices.simulated.settings import BANDS, SimulatedProjectorSettings, SimulationSettings

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]

_STRIP_ROWS = 16
"""Rows of sub-sampled pixels that are computed together: what they need stays in the cache."""


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


class SimulatedWorld:
    """Scene, optics and response of a simulated rig. Light depends on the shown picture only, not on time.

    Parameters
    ----------
    camera_shape, projector_shape : (H, W)
    room : SimulatedRoom, optional
        In one band of a colour camera (:func:`make_simulated_worlds`); default: as a grey camera sees it.
    """

    def __init__(
        self,
        settings: SimulationSettings,
        camera_shape: tuple[int, int],
        projector_shape: tuple[int, int],
        room: SimulatedRoom | None = None,
    ):
        self.settings = settings
        self.room: SimulatedRoom = make_room(settings) if room is None else room
        self.camera: SimulatedOptics = make_optics(settings.camera, camera_shape)
        self.projector: SimulatedOptics = make_optics(settings.projector, projector_shape)
        self.emission, self._pixel_flux = _splat(self.room, self.projector, settings.projector.flux)
        self._map, self._direct_gain = _direct_path(self.room, self.camera, self.projector, settings.projector.flux)
        surface = trace(self.room, self.camera.position_m, directions(self.camera, pixel_grid(camera_shape)))
        self._view = interpolation(self.room, surface)
        self._reflectance = _point_reflectance(self.room, surface).astype(np.float32)
        self._ambient = self._ambient_radiosity()

    def light(self, codes: Codes) -> Light:
        """Radiosity that the camera sees while the projector shows `codes`."""
        return self.light_of(self.projector_linear(codes))

    def light_of(self, linear: Float32Array) -> Light:
        """Radiosity for a picture in linear light, (H, W), 1 = white."""
        emission = self.emission @ linear.ravel()
        irradiance = (self._view @ self.room.indirect_irradiance(emission).astype(np.float32)).astype(np.float32)
        global_ = self._reflectance * irradiance.reshape(self.camera.shape)
        return Light(self._direct(linear), global_, self._ambient)

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
        return np.asarray(mixing.mean(axis=0) if self.room.band is None else mixing[self.room.band])

    @property
    def vignetting(self) -> Float32Array:
        """(H, W) relative illumination of the camera's pixels."""
        return relative_illumination(self.camera, pixel_grid(self.camera.shape)).astype(np.float32)

    @property
    def ambient(self) -> Float32Array:
        """(H, W) radiosity of the room light alone, its mean over time."""
        return self._ambient

    def ambient_swell(self, starts_s: FloatArray, exposure_s: float) -> FloatArray:
        """Return by how much the room light is above its mean during exposures, share of the mean; as `starts_s`."""
        settings = self.settings
        middle = np.sin(2 * np.pi * settings.ambient_flicker_hz * (starts_s + exposure_s / 2))
        return np.asarray(settings.ambient_flicker * np.sinc(settings.ambient_flicker_hz * exposure_s) * middle)

    def lamp(self, starts_s: FloatArray, exposure_s: float) -> FloatArray:
        """Return the projector's light during exposures as a share of a warm lamp's; as `starts_s`."""
        projector = self.settings.projector
        return 1 - projector.lamp_drift * np.exp(-(starts_s + exposure_s / 2) / projector.lamp_warm_up_s)

    def _direct(self, linear: Float32Array) -> Float32Array:
        picture = blurred(self.projector, linear)
        fine = cv2.remap(picture, *self._map, interpolation=cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        lit = np.multiply(fine, self._direct_gain, dtype=np.float32)
        height, width = self.camera.shape
        return np.asarray(cv2.resize(lit, (width, height), interpolation=cv2.INTER_AREA), dtype=np.float32)

    def _ambient_radiosity(self) -> Float32Array:
        """Room light: even irradiance on every surface, with its interreflection."""
        even = np.full(len(self.room.reflectance), self.settings.ambient)
        indirect = self.room.indirect_irradiance(self.room.reflectance * even)
        seen = (self._view @ (indirect + even).astype(np.float32)).reshape(self.camera.shape)
        return np.asarray(self._reflectance * seen, dtype=np.float32)


def make_simulated_worlds(
    settings: SimulationSettings, camera_shape: tuple[int, int], projector_shape: tuple[int, int], channels: int
) -> tuple[SimulatedWorld, ...]:
    """The simulated world in each band of a camera of 1 or 3 channels."""
    if channels == 1:
        return (SimulatedWorld(settings, camera_shape, projector_shape),)
    first = make_room(settings, 0)
    rooms = [first, *(in_light(first, band) for band in range(1, BANDS))]
    return tuple(SimulatedWorld(settings, camera_shape, projector_shape, room) for room in rooms)


class SeenLight:
    """What reaches the camera's sensor through its lens; that of the last few pictures is kept."""

    def __init__(self, world: SimulatedWorld, kept: int):
        self._world = world
        self._kept = kept
        self._vignetting = world.vignetting
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
        return np.asarray(blurred(self._world.camera, radiosity) * self._vignetting, dtype=np.float32)


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


def _splat(room: SimulatedRoom, projector: SimulatedOptics, flux: float) -> tuple[csr_array, FloatArray]:
    """(cells, pixels): reflected emission of each cell for each pixel, the pixel's flux shared by sub-samples."""
    height, width = projector.shape
    samples = room.settings.pixel_samples
    grid = pixel_grid(projector.shape, samples)
    cells = cells_of(room, trace(room, projector.position_m, directions(projector, grid)))
    pixel_flux = flux / (height * width) * relative_illumination(projector, pixel_grid(projector.shape))
    y, x = (np.arange(n * samples) // samples for n in projector.shape)
    pixels = y[:, None] * width + x[None, :]
    hit = cells >= 0
    share = pixel_flux.ravel()[pixels[hit]] / samples**2 / room.cell_area_m2[cells[hit]]
    data = (share * room.reflectance[cells[hit]]).astype(np.float32)
    matrix = csr_array((data, (cells[hit], pixels[hit])), shape=(len(room.reflectance), height * width))
    return matrix, pixel_flux


def _direct_path(
    room: SimulatedRoom, camera: SimulatedOptics, projector: SimulatedOptics, flux: float
) -> tuple[tuple[Float32Array, Float32Array], Float32Array]:
    """Sub-sampled camera pixels: the projector coordinates that they see, and radiosity for white there.

    Some rows at a time, on two threads.
    """
    grid = pixel_grid(camera.shape, room.settings.pixel_samples)
    strips = [grid[first : first + _STRIP_ROWS] for first in range(0, len(grid), _STRIP_ROWS)]
    path = partial(_direct_strip, room=room, camera=camera, projector=projector, flux=flux)
    with ThreadPoolExecutor(2) as executor:
        parts = list(executor.map(path, strips))
    map_x, map_y, gain = (np.concatenate(part) for part in zip(*parts, strict=True))
    return (map_x, map_y), gain


def _direct_strip(
    grid: FloatArray, *, room: SimulatedRoom, camera: SimulatedOptics, projector: SimulatedOptics, flux: float
) -> tuple[Float32Array, Float32Array, Float32Array]:
    surface = trace(room, camera.position_m, directions(camera, grid))
    pixels = pixels_of(projector, surface.points_m)
    height, width = projector.shape
    with np.errstate(invalid="ignore"):
        inside = np.asarray((pixels > -0.5).all(axis=-1) & (pixels < (width - 0.5, height - 0.5)).all(axis=-1))
    to_projector = projector.position_m - surface.points_m[inside]
    axes = np.array([wall.axis for wall in room.walls])[surface.wall[inside]]
    cosine = np.abs(np.take_along_axis(to_projector, axes[:, None], axis=1)[:, 0])
    cosine /= np.linalg.norm(to_projector, axis=1)
    gain = np.zeros(inside.shape, dtype=np.float32)
    gain[inside] = (
        flux_density(projector, surface.points_m[inside], cosine)
        * (flux / (height * width))
        * relative_illumination(projector, pixels[inside])
        * _point_reflectance(room, surface)[inside]
    )
    pixels = np.where(inside[..., None], np.clip(pixels, 0, (width - 1, height - 1)), -10.0).astype(np.float32)
    return np.asarray(pixels[..., 0]), np.asarray(pixels[..., 1]), gain


def _point_reflectance(room: SimulatedRoom, surface: SurfacePoints) -> FloatArray:
    """Reflectance where rays land; 0 where they escape."""
    values = np.zeros(surface.wall.shape)
    for k in range(len(room.walls)):
        on = surface.wall == k
        values[on] = reflectance_at(room, k, surface.points_m[on])
    return values
