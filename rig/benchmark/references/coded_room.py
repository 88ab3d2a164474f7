"""Photographs of structured-light codes in a closed, bright, simulated room, whose truth is known."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from calibration import Correspondence, Pattern, StructuredLightCode, flat, refine_subpixel
from calibration.structured_light.fewer_lights import filled_in, lights_for, with_lights
from calibration.structured_light.frames import NOISE_SIGMAS
from rig.devices.simulated.optics import directions, pixels_of
from rig.devices.simulated.pair import SeenLight, pixel_grid
from rig.devices.simulated.room import trace
from rig.devices.simulated.settings import (
    FaceName,
    SimulatedCameraSettings,
    SimulatedProjectorSettings,
    SimulationSettings,
)
from rig.devices.simulated.world import SimulatedWorld

FloatArray = NDArray[np.float64]
Frames = dict[str, NDArray[np.uint16]]

FACES: tuple[FaceName, ...] = ("floor", "ceiling", "x0", "x1", "y0", "y1")
FULL_SCALE_DN, BLACK_DN = 4095, 64
FULL_WELL_E, READ_NOISE_E = 32000.0, 6.0
EXPOSED = 0.8
"""Of full scale: where the brightest thousandth of white is."""
SATURATION_DN = 0.95 * FULL_SCALE_DN
WRONG_PX = 2.0


def room_settings(reflectance: float, camera_width_px: int, projector_width_px: int) -> SimulationSettings:
    """Return the closed room of ``sim-room`` with one reflectance, its devices 4:3 and as wide as wanted."""
    camera, projector = camera_width_px / 1280, projector_width_px / 1024
    return SimulationSettings.model_validate(
        {
            "seed": 3,
            "size_m": (4.8, 4.8, 2.4),
            "reflectance": dict.fromkeys(FACES, (reflectance,)),
            "texture": 0.03,
            "cell_size_m": 0.2,
            "camera": (
                SimulatedCameraSettings(
                    name="camera",
                    position_m=(0.60, 1.42, 1.38),
                    look_at_m=(4.60, 4.55, 1.12),
                    roll_deg=1.3,
                    focal_px=531.7 * camera,
                    principal_point_px=(642.9 * camera, 471.2 * camera),
                    distortion=(-0.021, 0.0025, 0.0004, -0.0003, -0.0002),
                    vignetting=(-0.22, 0.03),
                    blur_px=0.5,
                    sensitivity_e_per_s=1.0,
                ),
            ),
            "projector": (
                SimulatedProjectorSettings(
                    name="projector",
                    position_m=(1.0, 1.0, 1.2),
                    look_at_m=(4.8, 4.72, 1.2),
                    roll_deg=-0.6,
                    focal_px=431.2 * projector,
                    principal_point_px=(507.2 * projector, 400.8 * projector),
                    distortion=(0.008, -0.001, 0.0, 0.0003, 0.0001),
                    vignetting=(-0.15, 0.0),
                    blur_px=0.6,
                ),
            ),
        }
    )


@dataclass(frozen=True, kw_only=True)
class Reading:
    """How well a code was read."""

    valid_share: float
    """Of the pixels that look at what the projector lights."""
    median_px: float
    """Of the coordinates' errors where valid, refined to sub-pixels. [projector px]"""
    p95_px: float
    wrong_share: float
    """Of the valid ones: further than 2 px from the truth."""
    sigmas: float
    """Spread of the errors in units of their stated standard deviations: 1 where these are true."""


@dataclass(eq=False)
class CodedRoom:
    """A camera that photographs codes, and knows what it should read."""

    world: SimulatedWorld
    truth_px: FloatArray = field(init=False)
    """(H, W, 2) projector pixel that each camera pixel's centre sees."""
    white: NDArray[np.uint16] = field(init=False)
    black: NDArray[np.uint16] = field(init=False)

    def __post_init__(self) -> None:
        self._seen = SeenLight(self.world, 1)
        self._random = np.random.default_rng(7)
        self._electrons = 1.0
        shape = self.world.projector.shape
        bright = self._light(flat(shape, 255))
        self._electrons = EXPOSED * FULL_WELL_E / float(np.quantile(bright, 0.999))
        self.white, self.black = self.photograph(flat(shape, 255)), self.photograph(flat(shape, 0))
        grid = pixel_grid(self.world.camera.shape)
        surface = trace(self.world.room, self.world.camera.position_m, directions(self.world.camera, grid))
        self.truth_px = pixels_of(self.world.projector, surface.points_m)

    @property
    def projector_shape(self) -> tuple[int, int]:
        """(height, width)."""
        return self.world.projector.shape

    @property
    def noise_limit(self) -> FloatArray:
        """(H, W) two standard deviations of the difference of two half-lit frames, in digital numbers."""
        per_dn = FULL_WELL_E / (FULL_SCALE_DN - BLACK_DN)
        level = np.maximum((self.white.astype(float) + self.black) / 2 - BLACK_DN, 0)
        return NOISE_SIGMAS * np.sqrt(2 * (level / per_dn + (READ_NOISE_E / per_dn) ** 2 + 1 / 12))

    def photograph(self, pattern: Pattern) -> NDArray[np.uint16]:
        """Photograph a picture, with noise; its codes are linear light."""
        electrons = self._light(pattern) * self._electrons
        noise = np.sqrt(np.maximum(electrons, 0) + READ_NOISE_E**2) * self._random.standard_normal(electrons.shape)
        dn = BLACK_DN + (electrons + noise) * (FULL_SCALE_DN - BLACK_DN) / FULL_WELL_E
        return np.clip(np.rint(dn), 0, FULL_SCALE_DN).astype(np.uint16)

    def photographs(self, patterns: Iterable[Pattern]) -> Frames:
        """Photograph pictures, by name."""
        return {pattern.name: self.photograph(pattern) for pattern in patterns}

    def decode(
        self,
        code: StructuredLightCode,
        frames: Mapping[str, NDArray[np.uint16]],
        white: NDArray[np.uint16] | None = None,
    ) -> Correspondence:
        """Read the photographs of a code, to sub-pixels; `white` with the lights that were on, default: all."""
        found = code.decode(
            frames,
            self.projector_shape,
            white=self.white if white is None else white,
            black=self.black,
            noise_limit=self.noise_limit,
            saturation=SATURATION_DN,
        )
        return refine_subpixel(found)

    def filled_in(self, code: StructuredLightCode, found: Correspondence, parts: int) -> tuple[Correspondence, int]:
        """Photograph a code again with fewer lights on, in parts; what is known then, and by how many pictures."""
        pictures = 0
        white = flat(self.projector_shape, 255)
        for lights in lights_for(found, parts):
            frames = self.photographs(with_lights(code.patterns(self.projector_shape), lights))
            (lit,) = with_lights([white], lights)
            found = filled_in(found, self.decode(code, frames, self.photograph(lit)), lights)
            pictures += len(frames) + 1
        return found, pictures

    def judge(self, found: Correspondence) -> Reading:
        """Hold a reading against the truth."""
        height, width = self.projector_shape
        lit = ((self.truth_px > 0) & (self.truth_px < (width - 1, height - 1))).all(axis=-1)
        valid = found.valid & lit
        if not valid.any():
            return Reading(valid_share=0.0, median_px=np.nan, p95_px=np.nan, wrong_share=0.0, sigmas=np.nan)
        error = (found.projector_xy_px - self.truth_px)[valid]
        sigma = np.full_like(error, np.nan) if found.sigma_px is None else found.sigma_px[valid]
        size = np.abs(error).max(axis=1)
        return Reading(
            valid_share=float(valid.sum() / lit.sum()),
            median_px=float(np.median(np.abs(error))),
            p95_px=float(np.quantile(size, 0.95)),
            wrong_share=float(np.mean(size > WRONG_PX)),
            sigmas=float(1.4826 * np.median(np.abs(error / sigma))),
        )

    def _light(self, pattern: Pattern) -> FloatArray:
        """(H, W) light on the sensor; the projector's black is a little above none."""
        black = 1 / self.world.settings.projector.contrast
        linear = (black + (1 - black) * pattern.codes / 255.0).astype(np.float32)
        return np.asarray(self._seen.through_lens(self.world.light_of(linear).total), dtype=np.float64)
