"""Where camera pixels land in the projector, and the derivative: the definition of the kernel's landings."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from calibration.arrays import FloatArray
from calibration.geometry.bundle_residual import LandingError, landed, rays_of
from calibration.geometry.bundle_unknowns import (
    CAMERA,
    PROJECTOR,
    ROTATION,
    TRANSLATION,
    TURN,
    devices_of,
    own_slopes_of,
    planes_of,
    turn_slopes_of,
)
from calibration.geometry.pinhole import PinholeModel, direction_slopes, distort, lens_slope_units, rotation_slopes

_FAR_PX = 1e4


def landing_errors(error: LandingError, z: FloatArray) -> FloatArray:
    """(N, 2) predicted minus measured projector pixel, weighted. [px]."""
    camera, projector = devices_of(z, error.nominal)
    rays = rays_of(camera, error.x1)
    along = (rays * planes_of(z, error.axes)[error.label]).sum(1)
    return np.asarray(error.weight * np.clip(landed(projector, rays, along) - error.x2, -_FAR_PX, _FAR_PX))


def landing_slopes(error: LandingError, z: FloatArray) -> FloatArray:
    """(n, N, 2) derivative of the weighted residuals by each unknown."""
    camera, projector = devices_of(z, error.nominal)
    rays = rays_of(camera, error.x1)
    planes = planes_of(z, error.axes)[error.label]
    along = (rays * planes).sum(1)
    along = np.where(np.abs(along) > 1e-9, along, 1e-9)[:, None]
    points = rays / along
    result = np.zeros((len(z), len(rays), 2))
    by_local = _by_projector(z, projector, points, result)
    by_point = by_local @ projector.rotation
    # A plane or a ray that turns meets the other nearer or further away: the landing moves along the ray's image.
    outwards = _applied(by_point, points)[:, :, None]
    _by_planes(error, z, -outwards * points[:, None, :], result)
    by_ray = (by_point - outwards * planes[:, None, :]) / along[:, :, None]
    slopes = bearing_slopes(error.x1, rays, camera, lens_slope_units(camera, z[CAMERA.start]))
    result[CAMERA] = (by_ray[None, :, :, :2] * slopes[:, :, None, :]).sum(-1)
    return np.asarray(result * error.weight)


def bearing_slopes(seen: FloatArray, rays: FloatArray, camera: PinholeModel, units: FloatArray) -> FloatArray:
    """(8, N, 2) derivative of undistorted pixels by the unknowns of their lens."""
    by_plane, by_terms = distortion_slopes(rays[:, :2], camera.distortion)
    focal = np.array(camera.focal_px)
    back = _by_lens((seen - camera.principal_point_px) / focal, by_terms, focal, units)
    return np.asarray(-np.linalg.solve(by_plane[None], (back / focal)[..., None])[..., 0])


def _by_projector(z: FloatArray, projector: PinholeModel, points: FloatArray, result: FloatArray) -> FloatArray:
    """Fill in lens and pose of the projector; returns (N, 2, 3), derivative by the point in its frame."""
    local = points @ projector.rotation.T + projector.translation_m
    depth = np.where(np.abs(local[:, 2:]) > 1e-9, local[:, 2:], 1e-9)
    plane = local[:, :2] / depth
    by_plane, by_terms = distortion_slopes(plane, projector.distortion)
    focal, units = np.array(projector.focal_px), lens_slope_units(projector, z[PROJECTOR.start])
    result[PROJECTOR] = _by_lens(distort(plane, projector.distortion), by_terms, focal, units)
    by_local = np.empty((len(points), 2, 3))
    by_local[:, :, :2] = focal[:, None] * by_plane / depth[:, :, None]
    by_local[:, :, 2] = -_applied(by_local[:, :, :2], plane)
    for k, slope in enumerate(rotation_slopes(z[ROTATION])):
        result[ROTATION][k] = _applied(by_local, points @ slope.T)
    result[TRANSLATION] = (by_local @ direction_slopes(z[TRANSLATION])).transpose(2, 0, 1)
    return by_local


def _by_planes(error: LandingError, z: FloatArray, by_plane: FloatArray, result: FloatArray) -> None:
    for result_k, slope in zip(result[TURN], turn_slopes_of(z, error.axes), strict=True):
        result_k[:] = _applied(by_plane, slope[error.label])
    for k, (at, slopes) in enumerate(own_slopes_of(z, error.axes)):
        on = np.flatnonzero(error.label == k)
        result[at, on] = (by_plane[on] @ slopes.T).transpose(2, 0, 1)


def _applied(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    """(N, 2) of (N, 2, k) and (N, k)."""
    return np.asarray((matrices @ vectors[:, :, None])[:, :, 0])


def _by_lens(real: FloatArray, by_terms: FloatArray, focal: FloatArray, units: FloatArray) -> FloatArray:
    """(8, N, 2) derivative of a pixel by the lens unknowns."""
    result = np.zeros((len(units), *real.shape))
    result[0], result[1, :, 0], result[2, :, 1], result[3:] = focal * real, 1, 1, focal * by_terms
    return np.asarray(units[:, None, None] * result)


def distortion_slopes(plane: FloatArray, distortion: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """(N, 2, 2) derivative of a distorted point by its coordinates, and (5, N, 2) by the terms."""
    k1, k2, p1, p2, k3 = np.asarray(distortion, dtype=np.float64)
    x, y = plane[:, 0], plane[:, 1]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    rise = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3))
    across = x * y * rise + 2 * (p1 * x + p2 * y)
    by_place = np.empty((len(plane), 2, 2))
    by_place[:, 0, 0] = radial + x * x * rise + 2 * p1 * y + 6 * p2 * x
    by_place[:, 1, 1] = radial + y * y * rise + 6 * p1 * y + 2 * p2 * x
    by_place[:, 0, 1] = by_place[:, 1, 0] = across
    by_terms = np.empty((5, len(plane), 2))
    by_terms[0] = plane * r2[:, None]
    by_terms[1] = by_terms[0] * r2[:, None]
    by_terms[4] = by_terms[1] * r2[:, None]
    by_terms[2, :, 0] = by_terms[3, :, 1] = 2 * x * y
    by_terms[2, :, 1] = r2 + 2 * y * y
    by_terms[3, :, 0] = r2 + 2 * x * x
    return by_place, by_terms
