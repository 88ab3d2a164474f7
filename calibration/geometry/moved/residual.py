"""Where camera pixels land in the projector when both devices stand elsewhere, held against where they do land."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from calibration.arrays import FloatArray
from calibration.geometry.moved.records import ComparedPixels, SeenWalls
from calibration.geometry.pinhole import PinholeModel, bearings, project, rotation_of

Who = Literal["camera", "projector", "together", "both", "camera zoomed", "projector zoomed"]
"""What is taken to have changed."""
TURN_RAD, SHIFT_M = 0.01, 0.01
"""What an unknown of 1 is, so that unknowns are of order 1: about half a degree, and a centimetre."""
ZOOM = 0.01
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


def followed(projector: PinholeModel, camera: PinholeModel, camera_now: PinholeModel) -> PinholeModel:
    """Return a projector that stands to a moved camera as it stood to the camera before."""
    turn = camera_now.rotation.T @ camera.rotation
    position_m = camera_now.position_m + turn @ (projector.position_m - camera.position_m)
    rotation = projector.rotation @ turn.T
    return replace(projector, rotation=rotation, translation_m=-rotation @ position_m)


def zoomed(device: PinholeModel, z: FloatArray) -> PinholeModel:
    """Return a device whose lens was zoomed or focused: a focal length larger by a share (1,)."""
    factor = 1 + ZOOM * float(z[0])
    return replace(device, focal_px=(factor * device.focal_px[0], factor * device.focal_px[1]))


def points_on(walls: SeenWalls, camera: PinholeModel, local_rays: FloatArray) -> FloatArray:
    """Return (N, 3) where rays of the camera's frame (N, 3) meet the planes that they see; far away where behind."""
    rays, origin = local_rays @ camera.rotation, camera.position_m
    along = (walls.normal * rays).sum(axis=1)
    meets = np.abs(along) > _LEAST_ALONG
    distance = (walls.offset_m - walls.normal @ origin) / np.where(meets, along, 1.0)
    return np.asarray(origin + np.where(meets & (distance > 0), distance, _FAR_PX)[:, None] * rays)


def _rays(camera: PinholeModel, xy_px: FloatArray) -> FloatArray:
    return bearings(xy_px, camera.focal_px, camera.principal_point_px, camera.distortion)


@dataclass(frozen=True, eq=False, kw_only=True)
class MotionError:
    """Residuals (N, 2) of compared pixels, a function of what has changed. [px].

    One device's motion (6,), both devices' as one (6,), both (12,), or a zoom (1,).

    What the calibration itself leaves unexplained at a pixel stays there when a device moves a little: it is taken out
    of the residual, so that a pair at rest leaves noise alone.
    """

    camera: PinholeModel
    projector: PinholeModel
    pixels: ComparedPixels
    walls_before: SeenWalls
    walls_now: SeenWalls
    who: Who

    def __call__(self, z: FloatArray) -> FloatArray:
        """(N, 2) predicted minus measured projector pixel. [px]."""
        landed = self._landed(*self.devices(z), self.walls_now)
        return np.asarray(np.clip(landed + self._left_over - self.pixels.now_px, -_FAR_PX, _FAR_PX))

    def devices(self, z: FloatArray) -> tuple[PinholeModel, PinholeModel]:
        """Return camera and projector after a motion."""
        camera, projector = self.camera, self.projector
        if self.who == "camera zoomed":
            return zoomed(camera, z), projector
        if self.who == "projector zoomed":
            return camera, zoomed(projector, z)
        if self.who in ("camera", "both", "together"):
            camera = moved_device(camera, z[:UNKNOWNS])
        if self.who in ("projector", "both"):
            projector = moved_device(projector, z[-UNKNOWNS:])
        return camera, followed(projector, self.camera, camera) if self.who == "together" else projector

    @property
    def unknowns(self) -> int:
        """How many there are."""
        return {"both": 2 * UNKNOWNS, "camera zoomed": 1, "projector zoomed": 1}.get(self.who, UNKNOWNS)

    def rays(self, camera: PinholeModel) -> FloatArray:
        """(N, 3) of the pixels, in a camera's own frame."""
        if camera.focal_px == self.camera.focal_px:
            return self._rays_before
        return _rays(camera, self.pixels.camera_xy_px)

    @cached_property
    def _rays_before(self) -> FloatArray:
        return _rays(self.camera, self.pixels.camera_xy_px)

    @cached_property
    def points_before_m(self) -> FloatArray:
        """(N, 3) that the pixels saw when the room was calibrated."""
        return points_on(self.walls_before, self.camera, self._rays_before)

    @cached_property
    def _left_over(self) -> FloatArray:
        return self.pixels.before_px - self._landed(self.camera, self.projector, self.walls_before)

    def _landed(self, camera: PinholeModel, projector: PinholeModel, walls: SeenWalls) -> FloatArray:
        return project(projector, points_on(walls, camera, self.rays(camera)))
