"""Where camera pixels land in the projector when both devices stand elsewhere, held against where they do land."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calibration.arrays import FloatArray
from calibration.geometry.moved.records import ComparedPixels, SeenWalls
from calibration.geometry.pinhole import PinholeModel, bearings, project, rotation_of

TURN_RAD, SHIFT_M = 0.01, 0.01
"""What an unknown of 1 is, so that unknowns are of order 1: about half a degree, and a centimetre."""
UNKNOWNS = 6
"""Of one device: rotation about its axes, shift along the room's."""
_FAR_PX = 1e4
_LEAST_ALONG = 1e-6
"""Cosine between ray and wall, below which they do not meet."""


def moved_device(device: PinholeModel, z: FloatArray) -> PinholeModel:
    """Return a device after a motion (6,): rotation about its own axes, shift of its centre in the world."""
    rotation = rotation_of(TURN_RAD * z[:3]) @ device.rotation
    position_m = device.position_m + SHIFT_M * z[3:]
    return replace(device, rotation=rotation, translation_m=-rotation @ position_m)


def points_on(walls: SeenWalls, camera: PinholeModel, local_rays: FloatArray) -> FloatArray:
    """Return (N, 3) where rays of the camera's frame (N, 3) meet the planes that they see; far away where behind."""
    rays, origin = local_rays @ camera.rotation, camera.position_m
    along = (walls.normal * rays).sum(axis=1)
    meets = np.abs(along) > _LEAST_ALONG
    distance = (walls.offset_m - walls.normal @ origin) / np.where(meets, along, 1.0)
    return np.asarray(origin + np.where(meets & (distance > 0), distance, _FAR_PX)[:, None] * rays)


@dataclass(frozen=True, eq=False, kw_only=True)
class MotionError:
    """Residuals (N, 2) of compared pixels, a function of the motion (6,) of one device or (12,) of both. [px].

    What the calibration itself leaves unexplained at a pixel stays there when a device moves a little: it is taken out
    of the residual, so that a pair at rest leaves noise alone.
    """

    camera: PinholeModel
    projector: PinholeModel
    pixels: ComparedPixels
    walls_before: SeenWalls
    walls_now: SeenWalls
    camera_moves: bool
    projector_moves: bool

    def __call__(self, z: FloatArray) -> FloatArray:
        """(N, 2) predicted minus measured projector pixel. [px]."""
        landed = self._landed(*self.devices(z), self.walls_now)
        return np.asarray(np.clip(landed + self._left_over - self.pixels.now_px, -_FAR_PX, _FAR_PX))

    def devices(self, z: FloatArray) -> tuple[PinholeModel, PinholeModel]:
        """Return camera and projector after a motion."""
        camera = moved_device(self.camera, z[:UNKNOWNS]) if self.camera_moves else self.camera
        projector = moved_device(self.projector, z[-UNKNOWNS:]) if self.projector_moves else self.projector
        return camera, projector

    @property
    def unknowns(self) -> int:
        """How many there are."""
        return UNKNOWNS * (self.camera_moves + self.projector_moves)

    @cached_property
    def rays(self) -> FloatArray:
        """(N, 3) of the pixels, in the camera's own frame."""
        lens = self.camera
        return bearings(self.pixels.camera_xy_px, lens.focal_px, lens.principal_point_px, lens.distortion)

    @cached_property
    def points_before_m(self) -> FloatArray:
        """(N, 3) that the pixels saw when the room was calibrated."""
        return points_on(self.walls_before, self.camera, self.rays)

    @cached_property
    def _left_over(self) -> FloatArray:
        return self.pixels.before_px - self._landed(self.camera, self.projector, self.walls_before)

    def _landed(self, camera: PinholeModel, projector: PinholeModel, walls: SeenWalls) -> FloatArray:
        return project(projector, points_on(walls, camera, self.rays))
