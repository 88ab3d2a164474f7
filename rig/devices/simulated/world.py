"""The simulated room of flat walls that camera and projector share: what light a picture makes, and what is true."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from rig.devices.simulated.defocus import DiscLevels, circle_px, looked_up
from rig.devices.simulated.optics import (
    SimulatedOptics,
    blurred,
    directions,
    flux_density,
    haloed,
    pixels_of,
    relative_illumination,
)
from rig.devices.simulated.pair import Light, SeenSurface, SimulatedPair, pixel_grid
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
from rig.devices.simulated.settings import BANDS, SimulationSettings

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]

_STRIP_ROWS = 16
"""Rows of sub-sampled pixels that are computed together: what they need stays in the cache."""


class SimulatedWorld(SimulatedPair):
    """A room of flat matte walls, with the optics and response of a simulated rig.

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
        self.room: SimulatedRoom = make_room(settings) if room is None else room
        super().__init__(settings, camera_shape, projector_shape, self.room.band)
        self.emission, self._pixel_flux = _splat(self.room, self.projector, settings.projector.flux)
        self._map, self._direct_gain, self._discs = _direct_path(
            self.room, self.camera, self.projector, settings.projector.flux
        )
        surface = trace(self.room, self.camera.position_m, directions(self.camera, pixel_grid(camera_shape)))
        self._view = interpolation(self.room, surface)
        reflectance = _point_reflectance(self.room, surface)
        self._reflectance = reflectance.astype(np.float32)
        self._surface = SeenSurface(
            points_m=surface.points_m, normals=_wall_normals(self.room, surface), reflectance=reflectance
        )
        self._ambient = self._ambient_radiosity()

    def light_of(self, linear: Float32Array) -> Light:
        """Radiosity for a picture in linear light, (H, W), 1 = white."""
        linear = haloed(self.projector, linear)
        emission = self.emission @ linear.ravel()
        irradiance = (self._view @ self.room.indirect_irradiance(emission).astype(np.float32)).astype(np.float32)
        global_ = self._reflectance * irradiance.reshape(self.camera.shape)
        return Light(self._direct(linear), global_, self._ambient)

    @property
    def ambient(self) -> Float32Array:
        """(H, W) radiosity of the room light alone, its mean over time."""
        return self._ambient

    @property
    def surface(self) -> SeenSurface:
        """What the camera's pixels look at."""
        return self._surface

    def _direct(self, linear: Float32Array) -> Float32Array:
        picture = blurred(self.projector, linear)
        fine = looked_up(picture, self._map, self._discs)
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
) -> tuple[tuple[Float32Array, Float32Array], Float32Array, DiscLevels]:
    """Sub-sampled camera pixels: the projector coordinates that they see, radiosity for white there, and the defocus.

    Some rows at a time, on two threads.
    """
    grid = pixel_grid(camera.shape, room.settings.pixel_samples)
    strips = [grid[first : first + _STRIP_ROWS] for first in range(0, len(grid), _STRIP_ROWS)]
    path = partial(_direct_strip, room=room, camera=camera, projector=projector, flux=flux)
    with ThreadPoolExecutor(2) as executor:
        parts = list(executor.map(path, strips))
    map_x, map_y, gain, circle = (np.concatenate(part) for part in zip(*parts, strict=True))
    return (map_x, map_y), gain, DiscLevels.of(circle)


def _direct_strip(
    grid: FloatArray, *, room: SimulatedRoom, camera: SimulatedOptics, projector: SimulatedOptics, flux: float
) -> tuple[Float32Array, Float32Array, Float32Array, Float32Array]:
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
    circle = circle_px(projector, projector.depth_m(surface.points_m)).astype(np.float32)
    return np.asarray(pixels[..., 0]), np.asarray(pixels[..., 1]), gain, np.where(inside, circle, 0)


def _point_reflectance(room: SimulatedRoom, surface: SurfacePoints) -> FloatArray:
    """Reflectance where rays land; 0 where they escape."""
    values = np.zeros(surface.wall.shape)
    for k in range(len(room.walls)):
        on = surface.wall == k
        values[on] = reflectance_at(room, k, surface.points_m[on])
    return values


def _wall_normals(room: SimulatedRoom, surface: SurfacePoints) -> FloatArray:
    """(..., 3) unit vectors into the room; NaN where rays escape."""
    inwards = np.zeros((len(room.walls) + 1, 3))
    for k, wall in enumerate(room.walls):
        inwards[k, wall.axis] = 1.0 if wall.position_m == 0 else -1.0
    inwards[-1] = np.nan
    return inwards[surface.wall]
