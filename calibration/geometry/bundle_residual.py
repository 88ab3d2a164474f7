"""Where camera pixels land in the projector if their points lie on given walls, and the derivative of that."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calibration.arrays import FloatArray, IntArray
from calibration.geometry.bundle_unknowns import (
    CAMERA,
    PROJECTOR,
    ROTATION,
    TRANSLATION,
    TURN,
    aspects_of,
    devices_of,
    own_slopes_of,
    planes_of,
)
from calibration.geometry.epipolar import NominalIntrinsics
from calibration.geometry.pinhole import PinholeModel, bearings, distort, distortion_slopes, project, rotation_of
from calibration.geometry.planes import Axes

_STEP = 1e-6
"""Of the differences that stand for the derivatives of a rotation and of the planes: half of float64's digits."""
_FAR_PX = 1e4


@dataclass(frozen=True, eq=False, kw_only=True)
class LandingError:
    """Residuals (N, 2) of points on walls, a function of the unknowns, with its derivative."""

    x1: FloatArray
    """(N, 2) camera pixels. [px]"""
    x2: FloatArray
    """(N, 2) projector pixels. [px]"""
    label: IntArray
    """(N,) wall of each point."""
    axes: Axes
    nominal: NominalIntrinsics
    weight: FloatArray | float = 1.0
    """(N, 2) by which a residual counts: 1, and less where a coordinate is less certain than usual."""

    @cached_property
    def _kept(self) -> dict[bytes, FloatArray]:
        """Rays of the last lens: a step that is tried and then taken needs them twice."""
        return {}

    def __call__(self, z: FloatArray) -> FloatArray:
        """(N, 2) predicted minus measured projector pixel, weighted. [px]."""
        camera, projector = devices_of(z, self.nominal)
        rays = self._rays(camera, z)
        along = (rays * planes_of(z, self.axes)[self.label]).sum(1)
        return np.asarray(self.weight * np.clip(landed(projector, rays, along) - self.x2, -_FAR_PX, _FAR_PX))

    def _rays(self, camera: PinholeModel, z: FloatArray) -> FloatArray:
        key = z[CAMERA].tobytes()
        if key not in self._kept:
            self._kept.clear()
            self._kept[key] = rays_of(camera, self.x1)
        return self._kept[key]

    def jacobian(self, z: FloatArray) -> FloatArray:
        """(n, N, 2) derivative of the weighted residuals by each unknown."""
        camera, projector = devices_of(z, self.nominal)
        rays = self._rays(camera, z)
        planes = planes_of(z, self.axes)[self.label]
        along = (rays * planes).sum(1)
        along = np.where(np.abs(along) > 1e-9, along, 1e-9)[:, None]
        points = rays / along
        result = np.zeros((len(z), len(rays), 2))
        by_local = self._by_projector(z, projector, points, result)
        by_point = by_local @ projector.rotation
        # A plane or a ray that turns meets the other nearer or further away: the landing moves along the ray's image.
        outwards = _applied(by_point, points)[:, :, None]
        self._by_planes(z, -outwards * points[:, None, :], result)
        by_ray = (by_point - outwards * planes[:, None, :]) / along[:, :, None]
        self._by_camera(camera, rays, by_ray[:, :, :2], result)
        return result * self.weight

    def _by_projector(
        self, z: FloatArray, projector: PinholeModel, points: FloatArray, result: FloatArray
    ) -> FloatArray:
        """Fill in lens and pose of the projector; returns (N, 2, 3), derivative by the point in its frame."""
        local = points @ projector.rotation.T + projector.translation_m
        depth = np.where(np.abs(local[:, 2:]) > 1e-9, local[:, 2:], 1e-9)
        plane = local[:, :2] / depth
        by_plane, by_terms = distortion_slopes(plane, projector.distortion)
        focal = np.array(projector.focal_px)
        real = distort(plane, projector.distortion)
        _fill_lens(result[PROJECTOR], real, focal * by_terms, self.nominal_of("projector"))
        by_local = np.empty((len(points), 2, 3))
        by_local[:, :, :2] = focal[:, None] * by_plane / depth[:, :, None]
        by_local[:, :, 2] = -_applied(by_local[:, :, :2], plane)
        for k in range(3):
            moved = z[ROTATION].copy()
            moved[k] += _STEP
            turned = points @ ((rotation_of(moved) - projector.rotation) / _STEP).T
            result[ROTATION][k] = _applied(by_local, turned)
        t = projector.translation_m
        across = (np.eye(3) - np.outer(t, t)) / np.linalg.norm(z[TRANSLATION])
        result[TRANSLATION] = (by_local @ across).transpose(2, 0, 1)
        return by_local

    def _by_planes(self, z: FloatArray, by_plane: FloatArray, result: FloatArray) -> None:
        planes = planes_of(z, self.axes)
        for k in range(TURN.start, TURN.stop):
            moved = z.copy()
            moved[k] += _STEP
            slope = (planes_of(moved, self.axes) - planes) / _STEP
            result[k] = _applied(by_plane, slope[self.label])
        for on, (at, slopes) in zip(self._rows, own_slopes_of(z, self.axes), strict=True):
            result[at, on] = (by_plane[on] @ slopes.T).transpose(2, 0, 1)

    @cached_property
    def _rows(self) -> list[IntArray]:
        """Of each plane, the points on it."""
        return [np.flatnonzero(self.label == k) for k in range(len(self.axes.of_plane))]

    def _by_camera(self, camera: PinholeModel, rays: FloatArray, by_ray: FloatArray, result: FloatArray) -> None:
        by_plane, by_terms = distortion_slopes(rays[:, :2], camera.distortion)
        inverse = _inverse(by_plane)
        back = [_applied(by_ray, inverse[:, :, k]) for k in range(2)]
        focal = np.array(camera.focal_px)
        real = (self.x1 - camera.principal_point_px) / focal
        slopes = np.empty((CAMERA.stop, len(rays), 2))
        _fill_lens(slopes, real, focal * by_terms, self.nominal_of("camera"))
        slopes /= -focal
        result[CAMERA] = back[0] * slopes[:, :, :1] + back[1] * slopes[:, :, 1:]

    def nominal_of(self, device: str) -> tuple[FloatArray, tuple[int, int]]:
        """Nominal focal lengths (2,) and (height, width) of a device."""
        first, second = aspects_of(self.nominal)
        if device == "camera":
            return self.nominal.camera_focal_px * np.array([1.0, first]), self.nominal.camera_shape
        return self.nominal.projector_focal_px * np.array([1.0, second]), self.nominal.projector_shape


def _applied(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    """(N, 2) of (N, 2, k) and (N, k); of so many small ones numpy's matmul and einsum take several times as long."""
    result = matrices[:, :, 0] * vectors[:, :1]
    for k in range(1, vectors.shape[1]):
        result += matrices[:, :, k] * vectors[:, k, None]
    return np.asarray(result)


def _inverse(matrices: FloatArray) -> FloatArray:
    """(N, 2, 2) of as many."""
    (a, b), (c, d) = matrices.transpose(1, 2, 0)
    return np.asarray((np.array([[d, -b], [-c, a]]) / (a * d - b * c)).transpose(2, 0, 1))


def _fill_lens(
    result: FloatArray, real: FloatArray, by_terms: FloatArray, nominal: tuple[FloatArray, tuple[int, int]]
) -> None:
    """(terms, N, 2) derivative of a pixel by the lens unknowns."""
    focal_px, (height_px, width_px) = nominal
    result[0] = focal_px * real
    result[1], result[2] = (width_px, 0), (0, height_px)
    result[3:] = by_terms


def rays_of(camera: PinholeModel, x1: FloatArray) -> FloatArray:
    """(N, 3) directions of camera pixels."""
    return bearings(x1, camera.focal_px, camera.principal_point_px, camera.distortion)


def landed(projector: PinholeModel, rays: FloatArray, along: FloatArray) -> FloatArray:
    """(N, 2) projector pixels of points at 1 / along on rays."""
    return project(projector, rays / np.where(np.abs(along) > 1e-9, along, 1e-9)[:, None])
