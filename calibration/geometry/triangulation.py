"""Points from pixels of a calibrated camera and the projector pixels that they see."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.arrays import BoolArray, Float32Array, FloatArray
from calibration.errors import CalibrationError
from calibration.geometry.pinhole import PinholeModel, world_rays
from calibration.structured_light.correspondence import Correspondence

_LEAST_BASELINE_M = 1e-6
_LEAST_ANGLE_RAD = 1e-4
"""Between the two rays of a point: below, an error of a tenth of a pixel moves it by more than its distance."""
_UNDISTORTIONS = 40
"""Rounds of the inverse of distortion: twice what a strong lens (k3 = -1) needs for the last digit."""
_NEIGHBOURS_PX, _NEIGHBOURS_AGREE = 3, 0.01
"""On a surface that is not seen edge-on some of the 48 pixels around are decoded, at nearly the same distance."""


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

    @property
    def in_front(self) -> BoolArray:
        """(N,) points that there are: in front of both devices."""
        return np.asarray(np.isfinite(self.points_m[:, 0]))


def average_by_projector_pixel(correspondence: Correspondence) -> PixelPairs:
    """Make one pair for each projector pixel that is seen: the mean of the camera pixels that see it.

    The mean has the sub-pixel accuracy that the whole codes lack. For unrefined maps: a camera pixel on the
    border of two codes, whose position is a half, belongs to neither and is left out.

    Parameters
    ----------
    correspondence : Correspondence
        With whole codes.

    Returns
    -------
    PixelPairs
        In the order of the projector's pixels, row by row.
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
    *,
    on_camera_rays: bool = False,
    undistortions: int = _UNDISTORTIONS,
) -> Triangulation:
    """Find the points at which the rays of corresponding pixels meet.

    Parameters
    ----------
    camera_xy_px, projector_xy_px : (N, 2)
        Pixels as photographed and as shown, with lens distortion. [px]
    camera, projector : PinholeModel
        Poses in one world.
    on_camera_rays : bool
        A point is the middle of the shortest segment between its two rays, the best estimate where both pixels are
        measured alike. True: its end on the camera's ray. A fit of planes takes this one: its residual is the
        distance in the projector of where the camera's ray lands, so a point must not leave its camera pixel.
    undistortions : int
        Rounds of the inverse of distortion; a fit that asks for points again and again takes fewer.

    Returns
    -------
    Triangulation
        A point for each pair.

    Raises
    ------
    CalibrationError
        If both centres of projection coincide, so that no depth is determined.

    References
    ----------
    R. Hartley and A. Zisserman, Multiple View Geometry, 2nd edition, Cambridge 2004, section 12.2 (the midpoint).
    """
    baseline = projector.position_m - camera.position_m
    length_m = float(np.linalg.norm(baseline))
    if length_m < _LEAST_BASELINE_M:
        raise CalibrationError(
            f"camera and projector are {length_m:.2g} m apart, at least {_LEAST_BASELINE_M:g} m are needed: "
            "no depth can be triangulated; check the translation between them"
        )
    a = world_rays(camera, camera_xy_px, undistortions)
    b = world_rays(projector, projector_xy_px, undistortions)
    s, t = _nearest(a, b, baseline)
    if on_camera_rays:
        points = camera.position_m + s[:, None] * a
    else:
        points = camera.position_m + (s[:, None] * a + baseline + t[:, None] * b) / 2
    points[~((s > 0) & (t > 0))] = np.nan
    return Triangulation(points, _epipolar_px(a, b, baseline, projector))


def _nearest(a: FloatArray, b: FloatArray, baseline: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(N,) distances along rays a, from 0, and b, from the baseline, to where they are nearest; NaN if parallel."""
    cosine = (a * b).sum(axis=1)
    along_a, along_b = a @ baseline, b @ baseline
    sine2 = 1 - cosine**2
    safe = np.where(sine2 > _LEAST_ANGLE_RAD**2, sine2, np.nan)
    return (along_a - cosine * along_b) / safe, (cosine * along_a - along_b) / safe


def _epipolar_px(a: FloatArray, b: FloatArray, baseline: FloatArray, projector: PinholeModel) -> FloatArray:
    """Distance of projector points from the lines where the camera rays' planes cut the projector's image."""
    normals = np.cross(baseline, a) @ projector.rotation.T
    local = b @ projector.rotation.T
    plane = local / local[:, 2:]
    slope = np.hypot(normals[:, 0] / projector.focal_px[0], normals[:, 1] / projector.focal_px[1])
    return np.asarray(np.abs((plane * normals).sum(axis=1)) / np.maximum(slope, 1e-15))


def stands_alone(projector_xy_px: FloatArray, distance_m: FloatArray, projector_shape: tuple[int, int]) -> BoolArray:
    """Find points without any neighbour within 3 projector pixels whose distance agrees within 1 %.

    Parameters
    ----------
    projector_xy_px : (N, 2)
        Whole projector pixels, each at most once. [px]
    distance_m : (N,)
        From any of the two devices. [m]
    projector_shape : (height, width)
        Of the projector. [px]

    Returns
    -------
    (N,) bool
        True for points that stand alone.
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
