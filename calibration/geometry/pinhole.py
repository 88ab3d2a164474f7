"""A pinhole with Brown's distortion in OpenCV's order, as plain functions: pixels to bearings and back."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike

from calibration.records import FloatArray, PinholeModel


def distort(plane: FloatArray, distortion: ArrayLike) -> FloatArray:
    """(N, 2) real image coordinates of ideal ones, focal length 1."""
    k1, k2, p1, p2, k3 = np.asarray(distortion, dtype=np.float64)
    x, y = plane[:, 0], plane[:, 1]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    real = np.empty_like(plane)
    real[:, 0] = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    real[:, 1] = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return real


def undistort(plane: FloatArray, distortion: ArrayLike, iterations: int = 8) -> FloatArray:
    """Inverse of :func:`distort` by fixed-point iteration; coordinates are kept within 80 degrees of the axis."""
    limit = np.tan(np.radians(80))
    ideal = np.clip(plane, -limit, limit)
    for _ in range(iterations):
        ideal = np.clip(ideal + plane - distort(ideal, distortion), -limit, limit)
    return ideal


def bearings(
    xy_px: FloatArray, focal_px: ArrayLike, principal_point_px: ArrayLike, distortion: ArrayLike
) -> FloatArray:
    """(N, 3) directions (x, y, 1) of pixels in the device's frame."""
    plane = undistort((xy_px - np.asarray(principal_point_px)) / np.asarray(focal_px), distortion)
    return np.column_stack([plane, np.ones(len(plane))])


def image_of(
    points: FloatArray, focal_px: ArrayLike, principal_point_px: ArrayLike, distortion: ArrayLike
) -> FloatArray:
    """(N, 2) pixels of points in the device's frame."""
    depth = np.where(np.abs(points[:, 2:]) > 1e-9, points[:, 2:], 1e-9)
    return np.asarray(
        distort(points[:, :2] / depth, distortion) * np.asarray(focal_px) + np.asarray(principal_point_px)
    )


def world_rays(model: PinholeModel, xy_px: FloatArray) -> FloatArray:
    """(N, 3) unit directions of pixels in the world."""
    rays = bearings(xy_px, model.focal_px, model.principal_point_px, model.distortion) @ model.rotation
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


def project(model: PinholeModel, points_m: FloatArray) -> FloatArray:
    """(N, 2) pixels of world points."""
    local = points_m @ model.rotation.T + model.translation_m
    return image_of(local, model.focal_px, model.principal_point_px, model.distortion)


def rotation_of(vector: ArrayLike) -> FloatArray:
    """(3, 3) rotation of a Rodrigues vector in radians."""
    return np.asarray(cv2.Rodrigues(np.asarray(vector, dtype=np.float64).reshape(3, 1))[0])


def vector_of(rotation: FloatArray) -> FloatArray:
    """(3,) Rodrigues vector of a rotation, in radians."""
    return np.asarray(cv2.Rodrigues(rotation)[0], dtype=np.float64).ravel()
