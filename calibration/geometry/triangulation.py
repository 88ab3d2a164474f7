"""Points from pixels of a calibrated camera and the projector pixels that they see."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.geometry.pinhole import undistort
from calibration.records import (
    BoolArray,
    CalibrationError,
    Correspondence,
    Float32Array,
    FloatArray,
    PinholeModel,
)

_LEAST_BASELINE_M = 1e-6
_LEAST_ANGLE_RAD = 1e-4
_ITERATIONS = 40
_NEIGHBOURS_PX = 3
_NEIGHBOURS_AGREE = 0.01


@dataclass(frozen=True, slots=True)
class PixelPairs:
    """Camera and projector pixels that look at the same spots, one row each."""

    camera_xy_px: FloatArray
    """(N, 2) mean of the camera pixels of each projector pixel. [px]"""
    projector_xy_px: FloatArray
    """(N, 2) [px]"""
    n_pixels: NDArray[np.int64]
    """(N,) camera pixels that were averaged."""


@dataclass(frozen=True, slots=True)
class Triangulation:
    """Points, and how well the two rays of each meet."""

    points_m: FloatArray
    """(N, 3) in the world; NaN where the rays are parallel or meet behind a device. [m]"""
    epipolar_px: FloatArray
    """(N,) distance of the projector pixel, without distortion, from its epipolar line. [px]"""


def average_by_projector_pixel(correspondence: Correspondence) -> PixelPairs:
    """One pair for each projector pixel that is seen: the mean of the camera pixels that see it.

    The mean has the sub-pixel accuracy that the whole codes lack. For unrefined maps: a camera pixel on the
    border of two codes, whose position is a half, belongs to neither and is left out.
    """
    height, width = correspondence.projector_shape
    xy = correspondence.projector_xy_px
    with np.errstate(invalid="ignore"):
        whole = (np.abs(xy - np.rint(xy)) < 0.25).all(axis=-1)
    rows, columns = np.nonzero(correspondence.valid & whole)
    code = np.rint(xy[rows, columns]).astype(np.int64)
    index = code[:, 1] * width + code[:, 0]
    count = np.bincount(index, minlength=height * width)
    seen = np.flatnonzero(count)
    sums = [np.bincount(index, coordinate, height * width)[seen] for coordinate in (columns, rows)]
    projector_xy = np.column_stack([seen % width, seen // width]).astype(np.float64)
    return PixelPairs(np.column_stack(sums) / count[seen, None], projector_xy, count[seen])


def triangulate(
    camera_xy_px: FloatArray | Float32Array,
    projector_xy_px: FloatArray | Float32Array,
    camera: PinholeModel,
    projector: PinholeModel,
) -> Triangulation:
    """Middle of the shortest segment between the rays of each pair of pixels.

    Parameters
    ----------
    camera_xy_px, projector_xy_px : (N, 2)
        Pixels as photographed and as shown, with lens distortion.
    camera, projector : PinholeModel
        Poses in one world.

    Raises
    ------
    CalibrationError
        If both centres of projection coincide, so that no depth is determined.
    """
    baseline = projector.position_m - camera.position_m
    length_m = float(np.linalg.norm(baseline))
    if length_m < _LEAST_BASELINE_M:
        raise CalibrationError(
            f"camera and projector are {length_m:.2g} m apart, at least {_LEAST_BASELINE_M:g} m are needed: "
            "no depth can be triangulated; check the translation between them"
        )
    a, b = _rays(camera, camera_xy_px), _rays(projector, projector_xy_px)
    cosine = (a * b).sum(axis=1)
    along_a, along_b = a @ baseline, b @ baseline
    sine2 = 1 - cosine**2
    meets = sine2 > _LEAST_ANGLE_RAD**2
    safe = np.where(meets, sine2, 1.0)
    s, t = (along_a - cosine * along_b) / safe, (cosine * along_a - along_b) / safe
    points = camera.position_m + (s[:, None] * a + baseline + t[:, None] * b) / 2
    points[~(meets & (s > 0) & (t > 0))] = np.nan
    return Triangulation(points, _epipolar_px(a, b, baseline, projector))


def _rays(model: PinholeModel, xy_px: FloatArray | Float32Array) -> FloatArray:
    """(N, 3) unit directions in the world."""
    xy = np.asarray(xy_px, dtype=np.float64)
    plane = undistort(
        (xy - np.array(model.principal_point_px)) / np.array(model.focal_px), model.distortion, _ITERATIONS
    )
    local = np.column_stack([plane, np.ones(len(plane))])
    rays = local @ model.rotation
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


def _epipolar_px(a: FloatArray, b: FloatArray, baseline: FloatArray, projector: PinholeModel) -> FloatArray:
    """Distance of projector points from the lines where the camera rays' planes cut the projector's image."""
    normals = np.cross(baseline, a) @ projector.rotation.T
    local = b @ projector.rotation.T
    plane = local / local[:, 2:]
    slope = np.hypot(normals[:, 0] / projector.focal_px[0], normals[:, 1] / projector.focal_px[1])
    return np.asarray(np.abs((plane * normals).sum(axis=1)) / np.maximum(slope, 1e-15))


def stands_alone(projector_xy_px: FloatArray, distance_m: FloatArray, projector_shape: tuple[int, int]) -> BoolArray:
    """(N,) points without any neighbour within 3 projector pixels whose distance agrees within 1 %.

    Parameters
    ----------
    projector_xy_px : (N, 2)
        Whole projector pixels, each at most once.
    distance_m : (N,)
        From any of the two devices.
    """
    reach = _NEIGHBOURS_PX
    height, width = projector_shape
    grid = np.full((height + 2 * reach, width + 2 * reach), np.nan)
    column, row = np.rint(projector_xy_px).astype(np.int64).T + reach
    grid[row, column] = distance_m
    alone = np.ones(len(distance_m), dtype=bool)
    for down in range(-reach, reach + 1):
        for right in range(-reach, reach + 1):
            if (down, right) != (0, 0):
                neighbour = grid[row + down, column + right]
                alone &= ~(np.abs(neighbour - distance_m) < _NEIGHBOURS_AGREE * distance_m)
    return alone
