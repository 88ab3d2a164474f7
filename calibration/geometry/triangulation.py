"""Points from pixels of a calibrated camera and the projector pixels that they see."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.arrays import BoolArray, Float32Array, FloatArray
from calibration.errors import CalibrationError
from calibration.geometry.pinhole import PinholeModel, project, world_rays
from calibration.structured_light.correspondence import Correspondence

_LEAST_BASELINE_M = 1e-6
_LEAST_ANGLE_RAD = 1e-4
"""Between the two rays of a point: below, an error of a tenth of a pixel moves it by more than its distance."""
_UNDISTORTIONS = 40
"""Rounds of the inverse of distortion: twice what a strong lens (k3 = -1) needs for the last digit."""
_TORN, _TORN_PX2 = 9.0, 6.0
"""A projector pixel that no surface's end tears spreads over no more than three times the length of those around, and
two camera pixels. Of three drawn scenes no point is off any more, of 0.5 to 1 % before; a published scan loses 0.05 %
of its points with 6, 0.1 % with 3."""
_WHOLE = 0.25
"""Of a pixel: nearer than this to its middle is a code of it, a half lies between two."""
_CUT, _CUT_PIXELS = 0.8, 4
"""Camera pixels of a projector pixel of which nothing is hidden, beside those of the ones around; four come and go by
where their borders fall. In a drawn scene without the finest two bits (cells of 48 camera pixels) all below 0.7 are off
by more than 1 %, one in four up to 0.8, one in 500 above 0.9."""
_NEWTON_STEPS, _NEWTON_SHARE = 6, 1e-5
"""Of the search for a bent column along a ray, and the share of the distance over which its slope is taken: six steps
reach 1e-6 px behind a strong lens (k1 = -0.3)."""
_LINE_PX = 0.01
"""A search that ends further from its column has found nothing."""
_NEIGHBOURS_PX, _NEIGHBOURS_AGREE = 5, 0.01
"""On a surface that is not seen edge-on some of the 120 pixels around are decoded, at nearly the same distance.
On a published scan 3 px left out 0.2 % of its author's points, 5 px leave out next to none."""


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


@dataclass(frozen=True, slots=True)
class LinePoints:
    """Points on camera rays where the light of single projector columns, or rows, meets them."""

    points_m: FloatArray
    """(N, 3) in the world; NaN where there is none in front of both devices, within the projector's picture. [m]"""
    metres_per_px: FloatArray
    """(N,) by how much a point moves along its ray for one projector pixel: times that pixel's standard deviation, the
    point's. Large where the baseline is nearly along the stripes."""
    across: FloatArray
    """(N,) share of a point's parallax that is across the stripes: 0 where the baseline is along them."""


def is_whole(codes: NDArray[np.floating]) -> BoolArray:
    """Return which codes are of one pixel, not between two, whose position is a half; none where there is no code."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.abs(codes - np.rint(codes)) < _WHOLE)


def average_by_projector_pixel(correspondence: Correspondence) -> PixelPairs:
    """Make one pair for each projector pixel that is seen: the mean of the camera pixels that see it.

    The mean has the sub-pixel accuracy that the whole codes lack. For unrefined maps: a camera pixel on the
    border of two codes, whose position is a half, belongs to neither and is left out. So is a projector pixel that a
    surface's end tears: its camera pixels lie on both sides, and their mean on neither; or one of which a good part is
    hidden: the mean of what is seen is not its middle.

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
    rows, columns = np.nonzero(correspondence.valid & is_whole(xy).all(axis=-1))
    code = np.rint(xy[rows, columns]).astype(np.int64)
    index = code[:, 1] * width + code[:, 0]
    count = np.bincount(index, minlength=height * width)
    seen = np.flatnonzero(count)
    of = _Moments(index, height * width, count)
    mean = np.column_stack([of.mean(coordinate) for coordinate in (columns, rows)])
    spread = sum(of.mean(coordinate.astype(np.float64) ** 2) for coordinate in (columns, rows)) - (mean**2).sum(axis=1)
    n_pixels, grid = count[seen], count.reshape(height, width)
    torn = spread > _TORN * _around(np.asarray(spread), grid) + _TORN_PX2
    cut = n_pixels + _CUT_PIXELS < _CUT * _around(n_pixels, grid)
    whole_cells = ~(torn | cut)
    projector_xy = np.column_stack([seen % width, seen // width]).astype(np.float64)
    return PixelPairs(mean[whole_cells], projector_xy[whole_cells], n_pixels[whole_cells])


@dataclass(frozen=True, eq=False, slots=True)
class _Moments:
    """Means over the camera pixels of each projector pixel that is seen."""

    index: NDArray[np.int64]
    cells: int
    count: NDArray[np.int64]

    def mean(self, of_pixel: NDArray[np.int64] | FloatArray) -> FloatArray:
        seen = self.count > 0
        return np.asarray(np.bincount(self.index, of_pixel, self.cells)[seen] / self.count[seen])


def _around(values: FloatArray | NDArray[np.int64], count: NDArray[np.int64]) -> FloatArray:
    """(N,) median over the projector pixels around each one that is seen; beside others that are, the usual value."""
    filled = np.full(count.shape, np.median(values) if len(values) else 0.0, dtype=np.float32)
    filled[count > 0] = values
    return np.asarray(cv2.medianBlur(filled, 5)[count > 0], dtype=np.float64)


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
    baseline = _baseline(camera, projector)
    a = world_rays(camera, camera_xy_px, undistortions)
    b = world_rays(projector, projector_xy_px, undistortions)
    s, t = _nearest(a, b, baseline)
    if on_camera_rays:
        points = camera.position_m + s[:, None] * a
    else:
        points = camera.position_m + (s[:, None] * a + baseline + t[:, None] * b) / 2
    points[~((s > 0) & (t > 0))] = np.nan
    return Triangulation(points, _epipolar_px(a, b, baseline, projector))


def triangulate_lines(
    camera_xy_px: FloatArray | Float32Array,
    projector_px: FloatArray | Float32Array,
    camera: PinholeModel,
    projector: PinholeModel,
    *,
    axis: Literal["column", "row"] = "column",
) -> LinePoints:
    """Find the points at which rays of a camera meet the light of single columns, or rows, of a projector.

    With an undistorted lens a column's light is a plane; a lens bends it, so the plane is only where a search along
    the ray begins, by Newton's method. Rays that run nearly along the plane (as where the baseline is along the
    stripes) meet it nowhere in particular, and have no point.

    Parameters
    ----------
    camera_xy_px : (N, 2)
        Pixels as photographed, with lens distortion. [px]
    projector_px : (N,)
        Column, or row, that each of them sees, with lens distortion. [px]
    camera, projector : PinholeModel
        Poses in one world.
    axis : {"column", "row"}
        What `projector_px` counts.

    Returns
    -------
    LinePoints
        A point for each ray, or none, and how well the stripes tell it.

    Raises
    ------
    CalibrationError
        If both centres of projection coincide, so that no depth is determined.
    """
    baseline = _baseline(camera, projector)
    k = 0 if axis == "column" else 1
    wanted = np.asarray(projector_px, dtype=np.float64)
    rays = world_rays(camera, np.asarray(camera_xy_px, dtype=np.float64))
    distance_m = _to_planes(rays, baseline, projector, axis=axis, wanted=wanted)
    for _ in range(_NEWTON_STEPS):
        here, ahead = (_seen_by(projector, camera.position_m + d[:, None] * rays) for d in _near(distance_m))
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = (ahead[:, k] - here[:, k]) / (distance_m * _NEWTON_SHARE)
            distance_m = distance_m - np.where(np.abs(slope) > 0, (here[:, k] - wanted) / slope, np.nan)
        distance_m[~(distance_m > 0)] = np.nan
    points = camera.position_m + distance_m[:, None] * rays
    seen = _seen_by(projector, points)
    size = np.array([projector.width_px, projector.height_px])
    with np.errstate(invalid="ignore"):
        found = (np.abs(seen[:, k] - wanted) < _LINE_PX) & (seen > -1).all(axis=1) & (seen < size).all(axis=1)
    points[~found] = np.nan
    parallax = np.abs(parallax_px(points, camera, projector))
    with np.errstate(divide="ignore", invalid="ignore"):
        return LinePoints(points, distance_m / parallax[:, k], parallax[:, k] / np.hypot(*parallax.T))


def parallax_px(points_m: FloatArray, camera: PinholeModel, projector: PinholeModel) -> FloatArray:
    """Return by how much points move in the projector's picture as they move along their camera rays.

    The standard deviation of a projector pixel, divided by the length of this, is that of a point's distance, as a
    share of it.

    Parameters
    ----------
    points_m : (N, 3)
        In the world. [m]
    camera, projector : PinholeModel
        Poses in one world.

    Returns
    -------
    (N, 2)
        Columns and rows for each doubling of the distance from the camera, in the limit of small steps; NaN where
        there is no point. [px]
    """
    rays = points_m - camera.position_m
    here, ahead = (_seen_by(projector, camera.position_m + share * rays) for share in (1.0, 1.0 + _NEWTON_SHARE))
    return np.asarray((ahead - here) / _NEWTON_SHARE)


def _to_planes(
    rays: FloatArray,
    baseline: FloatArray,
    projector: PinholeModel,
    *,
    axis: Literal["column", "row"],
    wanted: FloatArray,
) -> FloatArray:
    """(N,) distances along the rays to the planes of a projector without distortion; NaN where they run along them."""
    k = 0 if axis == "column" else 1
    middle = np.full((len(wanted), 2), np.array([projector.width_px - 1, projector.height_px - 1]) / 2)
    middle[:, k] = wanted
    line = np.zeros(3)
    line[1 - k] = 1.0
    normals = np.cross(world_rays(projector, middle), line @ projector.rotation)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    along = (rays * normals).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        distance_m = np.where(np.abs(along) > _LEAST_ANGLE_RAD, normals @ baseline / along, np.nan)
    return np.asarray(np.where(distance_m > 0, distance_m, np.nan))


def _near(distance_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    return distance_m, distance_m * (1 + _NEWTON_SHARE)


def _seen_by(device: PinholeModel, points_m: FloatArray) -> FloatArray:
    """(N, 2) pixels of points; NaN behind the device."""
    pixels = np.full((len(points_m), 2), np.nan)
    local = points_m @ device.rotation.T + device.translation_m
    with np.errstate(invalid="ignore"):
        ahead = local[:, 2] > 0
    if ahead.any():
        pixels[ahead] = project(device, points_m[ahead])
    return pixels


def _baseline(camera: PinholeModel, projector: PinholeModel) -> FloatArray:
    """(3,) from the camera to the projector; refused where they coincide."""
    baseline = projector.position_m - camera.position_m
    length_m = float(np.linalg.norm(baseline))
    if length_m < _LEAST_BASELINE_M:
        raise CalibrationError(
            f"camera and projector are {length_m:.2g} m apart, at least {_LEAST_BASELINE_M:g} m are needed: "
            "no depth can be triangulated; check the translation between them"
        )
    return np.asarray(baseline)


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
    """Find points without any neighbour within 5 projector pixels whose distance agrees within 1 %.

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
