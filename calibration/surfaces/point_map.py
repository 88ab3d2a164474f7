"""Points that a camera sees of a projector's light, one a pixel, each with how uncertain it is along its ray."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.arrays import BoolArray, FloatArray
from calibration.geometry.pinhole import PinholeModel, project, world_rays
from calibration.geometry.triangulation import triangulate
from calibration.structured_light.correspondence import ROUNDING_PX, Correspondence

_STEP = 1e-4
"""Share of a distance over which a projector pixel's way along a ray is taken: some 1e-3 px of it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PointMap:
    """What each camera pixel sees: a distance along its ray, with a standard deviation."""

    origin_m: FloatArray
    """(3,) the camera's centre of projection in the world. [m]"""
    rays: FloatArray
    """(H, W, 3) unit directions of the pixels in the world."""
    distance_m: FloatArray
    """(H, W) along the ray; NaN where nothing was measured or chosen. [m]"""
    sigma_m: FloatArray
    """(H, W) standard deviation of the distance, of the correspondence alone: lenses and poses are not in it. [m]"""

    @property
    def known(self) -> BoolArray:
        """(H, W) pixels that have a point."""
        return np.isfinite(self.distance_m)

    @property
    def metres_per_px(self) -> float:
        """Median length that a camera pixel covers across its ray, at the distance of 1 m."""
        turn = np.linalg.norm(np.diff(self.rays, axis=1), axis=-1)
        return float(np.median(turn))


def point_map(
    correspondence: Correspondence, camera: PinholeModel, projector: PinholeModel, chosen: BoolArray | None = None
) -> PointMap:
    """Triangulate what camera pixels see.

    Parameters
    ----------
    correspondence : Correspondence
        Of both devices.
    camera, projector : PinholeModel
        Lenses and poses in one world.
    chosen : (H, W) bool, optional
        Pixels that are wanted; default: all valid ones.

    Returns
    -------
    PointMap

    Raises
    ------
    CalibrationError
        If both devices are in one place.
    """
    shape = correspondence.reason.shape
    rays = camera_rays(camera)
    rows, columns = np.nonzero(correspondence.valid if chosen is None else correspondence.valid & chosen)
    seen_px = correspondence.projector_xy_px[rows, columns].astype(np.float64)
    here_px = np.stack([columns, rows], axis=1).astype(np.float64)
    found = triangulate(here_px, seen_px, camera, projector, on_camera_rays=True)
    along = ((found.points_m - camera.position_m) * rays[rows, columns]).sum(axis=1)
    distance_m, sigma_m = np.full(shape, np.nan), np.full(shape, np.nan)
    distance_m[rows, columns] = along
    slope = px_per_metre(camera, projector, rays[rows, columns], along)
    sigma_m[rows, columns] = _sigma_px(correspondence)[rows, columns] / np.maximum(slope, 1e-12)
    return PointMap(origin_m=camera.position_m, rays=rays, distance_m=distance_m, sigma_m=sigma_m)


def camera_rays(camera: PinholeModel) -> FloatArray:
    """Return (H, W, 3) unit directions of a camera's pixels in the world."""
    columns, rows = np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px))
    xy = np.stack([columns.ravel(), rows.ravel()], axis=1).astype(np.float64)
    return world_rays(camera, xy).reshape(camera.height_px, camera.width_px, 3)


def px_per_metre(camera: PinholeModel, projector: PinholeModel, rays: FloatArray, distance_m: FloatArray) -> FloatArray:
    """Return (N,) projector pixels by which the light on camera rays (N, 3) moves for a metre along them."""
    here, ahead = (camera.position_m + (distance_m * (1 + step))[:, None] * rays for step in (0.0, _STEP))
    moved = np.linalg.norm(project(projector, ahead) - project(projector, here), axis=1)
    return np.asarray(moved / (distance_m * _STEP))


def at_least_usual(sigma: FloatArray, usual_of: FloatArray) -> FloatArray:
    """Return standard deviations, none below the usual one: codes are rounded alike along a stripe, so less is luck.

    Parameters
    ----------
    sigma : (...)
        NaN where there is no point.
    usual_of : (N,)
        Those whose median is the usual one.

    Returns
    -------
    (...)
    """
    return np.maximum(sigma, np.nanmedian(usual_of) if usual_of.size else 0.0)


def _sigma_px(correspondence: Correspondence) -> FloatArray:
    """(H, W) standard deviation of a projector pixel in one direction."""
    if correspondence.sigma_px is None:
        return np.full(correspondence.reason.shape, ROUNDING_PX)
    return np.asarray(np.sqrt((correspondence.sigma_px.astype(np.float64) ** 2).mean(axis=-1)))
