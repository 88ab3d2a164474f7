"""A point map as the projector has it: how far away what each of its pixels lights is.

A projector's pixel lights one place, whichever camera looks: in its picture, surfaces seen from several positions are
compared without asking what hides what.
"""

from __future__ import annotations

import cv2
import numpy as np

from calibration.arrays import BoolArray, FloatArray
from calibration.geometry.pinhole import PinholeModel, pixels_in, project
from calibration.surfaces.point_map import PointMap, camera_rays

_SIDES_PX = (3, 5, 7)
"""Of the window of projector pixels in which a plane is fitted, for cameras that are finer and coarser than it."""
_MOSTLY = 0.8
"""Of the pixels that have a point, those whose window holds a plane: with fewer the camera is too coarse for it."""
_OFF_MIDDLE = 0.1
"""Of a window's side, by which its points' mean may lie off its middle: nothing is carried on across an edge."""
_LEAST_POINTS, _LEAST_CELLS = 5, 5
"""Of a window: points, and pixels that have one."""
_SPREAD_PX2 = 0.02
"""Least variance of a window's points in any direction: nearly on a line, they hold no plane."""
_MISFIT = 3.0
"""Standard deviations, root mean square, by which a window's points may miss their plane: beyond, an edge is in it."""
_FACTOR = 5.0
"""Most by which a standard deviation along a projector's ray may differ from that along a camera's."""


def lit_map(points: PointMap, projector: PinholeModel) -> PointMap:
    """Return where a projector's own rays meet what a camera saw.

    In a window of 3 x 3 projector pixels 1 / distance is fitted as a plane, each point weighing what its standard
    deviation allows; where an edge runs through the window there is nothing. Where a camera's pixels are too coarse for
    that the window is wider, up to 7 x 7.

    Parameters
    ----------
    points : PointMap
        Of a camera.
    projector : PinholeModel
        In the same world.

    Returns
    -------
    PointMap
        Of the projector's pixels.
    """
    places = (points.origin_m + points.distance_m[..., None] * points.rays)[points.known]
    xy_px, length_m = project(projector, places), np.linalg.norm(places - projector.position_m, axis=1)
    sums = _pixel_sums(xy_px, 1 / length_m, length_m**2 / points.sigma_m[points.known], projector)
    inverse, slopes, sigma = _planes(sums)
    rays = camera_rays(projector)
    with np.errstate(invalid="ignore", divide="ignore"):
        distance_m = np.where(inverse > 0, 1 / inverse, np.nan)
        seen = projector.position_m + distance_m[..., None] * rays - points.origin_m
    factor = _slant_factor(rays, inverse, slopes, seen)
    return PointMap(
        origin_m=projector.position_m, rays=rays, distance_m=distance_m, sigma_m=sigma * distance_m**2 * factor
    )


def covered(points: PointMap, chosen: BoolArray, projector: PinholeModel) -> BoolArray:
    """Return (height, width) projector pixels whose light, or a neighbour's, chosen pixels of a camera see.

    Parameters
    ----------
    points : PointMap
        Of the camera.
    chosen : (H, W) bool
        Of its pixels.
    projector : PinholeModel
        In the same world.

    Returns
    -------
    (height, width) bool
    """
    mask: BoolArray = np.asarray(chosen & points.known)
    places = points.origin_m + points.distance_m[mask][:, None] * points.rays[mask]
    found = np.zeros((projector.height_px, projector.width_px), np.uint8)
    found[pixels_in(project(projector, places), found.shape)[1]] = 1
    return np.asarray(cv2.dilate(found, np.ones((3, 3), np.uint8)) > 0)


def read_at(image: FloatArray, xy_px: FloatArray) -> FloatArray:
    """Return (N,) values between the pixels of an image; NaN outside, and where one of the four pixels has none."""
    height, width = image.shape
    known: BoolArray = np.asarray(np.isfinite(xy_px).all(axis=1))
    xy = np.where(known[:, None], xy_px, -1.0)
    inside = known & (xy >= 0).all(axis=1) & (xy <= (width - 1, height - 1)).all(axis=1)
    column, row = np.clip(np.floor(xy), 0, (width - 2, height - 2)).astype(np.intp).T
    fx, fy = xy[:, 0] - column, xy[:, 1] - row
    upper = (1 - fx) * image[row, column] + fx * image[row, column + 1]
    lower = (1 - fx) * image[row + 1, column] + fx * image[row + 1, column + 1]
    return np.where(inside, (1 - fy) * upper + fy * lower, np.nan)


def _pixel_sums(xy_px: FloatArray, value: FloatArray, weight: FloatArray, projector: PinholeModel) -> FloatArray:
    """(12, h, w) of a pixel's points: weighted sums of 1, x, y, x², xy, y², v, xv, yv, v²; number; whether any."""
    height, width = projector.height_px, projector.width_px
    inside, (row, column) = pixels_in(xy_px, (height, width))
    index = row * width + column
    x, y, v, w = xy_px[inside, 0], xy_px[inside, 1], value[inside], weight[inside] ** 2
    terms = (w, w * x, w * y, w * x * x, w * x * y, w * y * y, w * v, w * x * v, w * y * v, w * v * v, np.ones_like(w))
    sums = [np.bincount(index, each, height * width).reshape(height, width) for each in terms]
    return np.stack([*sums, sums[-1] > 0]).astype(np.float64)


def _planes(sums: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(h, w) value in the middle of each window, (h, w, 2) its slopes and (h, w) its sigma; NaN where none is held."""
    shape = sums.shape[1:]
    value, slopes, sigma = np.full(shape, np.nan), np.full((*shape, 2), np.nan), np.full(shape, np.nan)
    settled = np.zeros(shape, dtype=bool)
    for side in _SIDES_PX:
        normal, right, more = _about_middles(sums, side)
        usable = ~settled & _holds_plane(normal, more, side)
        settled |= usable
        inverse = np.linalg.inv(normal[usable])
        found = (inverse @ right[usable][..., None])[..., 0]
        left = more[usable][:, 0] - (found * right[usable]).sum(axis=1)
        fits = left <= _MISFIT**2 * more[usable][:, 1]
        value[usable] = np.where(fits, found[:, 0], np.nan)
        slopes[usable], sigma[usable] = found[:, 1:], np.sqrt(inverse[:, 0, 0])
    return value, slopes, sigma


def _about_middles(sums: FloatArray, side: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(h, w, 3, 3), (h, w, 3) normal equations of planes about windows' middles; (h, w, 3) v², points, pixels."""
    ones = np.ones(side)
    over = [cv2.sepFilter2D(one, -1, ones, ones, borderType=cv2.BORDER_CONSTANT) for one in sums]
    s, sx, sy, sxx, sxy, syy, sv, sxv, syv, *more = over
    x0, y0 = np.meshgrid(np.arange(s.shape[1], dtype=np.float64), np.arange(s.shape[0], dtype=np.float64))
    x, y = sx - x0 * s, sy - y0 * s
    xx, yy = sxx - 2 * x0 * sx + x0 * x0 * s, syy - 2 * y0 * sy + y0 * y0 * s
    xy = sxy - x0 * sy - y0 * sx + x0 * y0 * s
    normal = np.stack([s, x, y, x, xx, xy, y, xy, yy], axis=-1).reshape(*s.shape, 3, 3)
    return normal, np.stack([sv, sxv - x0 * sv, syv - y0 * sv], axis=-1), np.stack(more, axis=-1)


def _holds_plane(normal: FloatArray, more: FloatArray, side: int) -> BoolArray:
    """(h, w) windows whose points are enough, about their middle, and spread in both directions."""
    weight = np.maximum(normal[..., 0, 0], np.finfo(float).tiny)
    middle = normal[..., 0, 1:] / weight[..., None]
    spread = normal[..., 1:, 1:] / weight[..., None, None] - middle[..., None] * middle[..., None, :]
    enough = (more[..., 1] >= _LEAST_POINTS) & (more[..., 2] >= _LEAST_CELLS)
    enough &= np.abs(middle).max(axis=-1) <= _OFF_MIDDLE * side
    return np.asarray(enough & (np.linalg.eigvalsh(spread)[..., 0] > _SPREAD_PX2))


def _slant_factor(rays: FloatArray, inverse: FloatArray, slopes: FloatArray, seen: FloatArray) -> FloatArray:
    """(h, w) by how much a surface moves along the projector's ray while it moves by 1 along the camera's."""
    with np.errstate(invalid="ignore", divide="ignore"):
        here = rays / inverse[..., None]
        right = np.roll(rays, -1, axis=1) / (inverse + slopes[..., 0])[..., None] - here
        below = np.roll(rays, -1, axis=0) / (inverse + slopes[..., 1])[..., None] - here
        normal = np.cross(right, below)
        across = np.abs((seen * normal).sum(axis=-1)) / np.linalg.norm(seen, axis=-1)
        factor = across / np.abs((rays * normal).sum(axis=-1))
    return np.asarray(np.clip(factor, 1 / _FACTOR, _FACTOR))
