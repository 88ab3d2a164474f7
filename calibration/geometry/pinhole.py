"""A pinhole with Brown's distortion in OpenCV's order, as plain functions: pixels to bearings and back."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from calibration import _kernel
from calibration.arrays import BoolArray, Float32Array, FloatArray, IntArray
from calibration.lenses.lens import distorted, ideal_coordinates

_WIDEST = math.tan(math.radians(80))
"""From the axis, focal length 1: beyond, the polynomial of a usual lens folds back."""
_JUST_BEFORE, _NO_IMAGINARY = 1 - 1e-6, 1e-9
"""Of the squared distance of a fold, where a rational model may have a pole; of a root that is one."""
_NO_FOLD = 1e-12
"""Inverse of a squared distance that no ray has: rounding makes it of 0."""
_BROWN = 5
"""Terms of Brown's distortion; the rational model has eight."""
_UNDISTORTIONS = 8
"""Rounds of the inverse of distortion: 1e-4 px for k1 = 0.1 within a usual picture, enough while a fit goes on."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PinholeModel:
    """A camera, or a projector as an inverse camera: lens and pose, OpenCV's conventions."""

    width_px: int
    height_px: int
    focal_px: tuple[float, float]
    principal_point_px: tuple[float, float]
    """(x, y); pixel centres at integers; may lie outside the image (lens shift)."""
    distortion: tuple[float, float, float, float, float]
    """k1, k2, p1, p2, k3 (OpenCV's order); of a lens file's rational model also k4, k5, k6. [1]"""
    rotation: FloatArray
    """(3, 3) device_from_world."""
    translation_m: FloatArray
    """(3,) device_from_world, in metres."""

    @property
    def position_m(self) -> FloatArray:
        """(3,) centre of projection in the world, in metres."""
        return np.asarray(-self.rotation.T @ self.translation_m)

    @property
    def optics(self) -> FloatArray:
        """(9,) focal lengths, principal point and Brown's terms, as the kernel takes them."""
        return np.array([*self.focal_px, *self.principal_point_px, *self.distortion[:_BROWN]])


def _lens(terms: FloatArray) -> FloatArray:
    return np.concatenate([[1.0, 1.0, 0.0, 0.0], terms])


def distort(plane: FloatArray, distortion: ArrayLike) -> FloatArray:
    """(N, 2) real image coordinates of ideal ones, focal length 1."""
    terms = np.asarray(distortion, dtype=np.float64)
    if len(terms) > _BROWN:
        return distorted(_lens(terms), plane)
    k1, k2, p1, p2, k3 = terms
    x, y = plane[:, 0], plane[:, 1]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    real = np.empty_like(plane)
    real[:, 0] = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    real[:, 1] = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return real


def undistort(plane: FloatArray, distortion: ArrayLike, iterations: int = _UNDISTORTIONS) -> FloatArray:
    """(N, 2) ideal image coordinates of real ones: :func:`distort` inverted by fixed-point iteration.

    Coordinates are kept within 80 degrees of the axis.
    """
    terms = np.asarray(distortion, dtype=np.float64)
    if len(terms) > _BROWN:  # of wide lenses: a fixed point would not be reached
        return np.asarray(np.clip(ideal_coordinates(_lens(terms), plane)[0], -_WIDEST, _WIDEST))
    real = np.ascontiguousarray(plane, dtype=np.float64)
    ideal = np.empty_like(real)
    _kernel.undistort(real, terms, limit=_WIDEST, rounds=iterations, ideal=ideal)
    return ideal


def bearings(
    xy_px: FloatArray,
    focal_px: ArrayLike,
    principal_point_px: ArrayLike,
    distortion: ArrayLike,
    *,
    iterations: int = _UNDISTORTIONS,
) -> FloatArray:
    """(N, 3) directions (x, y, 1) of pixels in the device's frame."""
    plane = undistort((xy_px - np.asarray(principal_point_px)) / np.asarray(focal_px), distortion, iterations)
    rays = np.ones((len(plane), 3))
    rays[:, :2] = plane
    return rays


def lens_slope_units(device: PinholeModel, focal_share: float) -> FloatArray:
    """(8,) what one of each unknown of a lens is: of the focal length as a share of what it is now, else in px or 1."""
    return np.array([1 / focal_share, device.width_px, device.height_px, *[1.0] * _BROWN])


def lens_slopes(device: PinholeModel, xy_px: FloatArray, rays: FloatArray, units: FloatArray) -> FloatArray:
    """(8, N, 2) derivative of pixels' bearings by focal length, principal point and Brown's terms, in units (8,).

    The unit of the focal length is a share of it.
    """
    slopes = np.empty((len(units), len(rays), 2))
    seen = np.ascontiguousarray(xy_px, dtype=np.float64)
    _kernel.slope_bearings(seen=seen, bearings=rays, optics=device.optics, units=units, slopes=slopes)
    return slopes


def image_of(
    points: FloatArray, focal_px: ArrayLike, principal_point_px: ArrayLike, distortion: ArrayLike
) -> FloatArray:
    """(N, 2) pixels of points in the device's frame.

    What is so far from the axis that the distortion folds back lies straight on outwards from there: outside of every
    picture, where the polynomial would have it in the midst of one.
    """
    terms = np.asarray(distortion, dtype=np.float64)
    if len(terms) > _BROWN:
        return defined_image(points, focal_px, principal_point_px, terms)
    optics = np.empty(4 + _BROWN)
    optics[:2], optics[2:4], optics[4:] = focal_px, principal_point_px, terms
    pixels = np.empty((len(points), 2))
    points = np.ascontiguousarray(points, dtype=np.float64)
    _kernel.take_images(points=points, optics=optics, fold=fold_squared(terms), pixels=pixels)
    return pixels


def defined_image(
    points: FloatArray, focal_px: ArrayLike, principal_point_px: ArrayLike, distortion: ArrayLike
) -> FloatArray:
    """(N, 2) pixels by numpy: those of rational lenses, and the definition of what the kernel does for others."""
    depth = np.where(np.abs(points[:, 2:]) > 1e-9, points[:, 2:], 1e-9)
    plane = points[:, :2] / depth
    within = _before_fold(plane, fold_squared(distortion))
    real = distort(within, distortion) + (plane - within)
    return np.asarray(real * np.asarray(focal_px) + np.asarray(principal_point_px))


def _before_fold(plane: FloatArray, fold: float) -> FloatArray:
    """Coordinates, brought inwards to where they do not fold."""
    squared = (plane**2).sum(axis=1, keepdims=True)
    if not (squared >= fold).any():
        return plane
    return np.asarray(plane * np.sqrt(np.minimum(fold * _JUST_BEFORE / np.maximum(squared, _JUST_BEFORE * fold), 1)))


def fold_squared(distortion: ArrayLike) -> float:
    """Squared distance from the axis, on the plane z = 1, at which radial distortion folds back; infinity if never."""
    return _fold_squared(tuple(np.asarray(distortion, dtype=np.float64).tolist()))


@lru_cache(maxsize=64)
def _fold_squared(terms: tuple[float, ...]) -> float:
    if not all(map(math.isfinite, terms)):  # of a fit that went astray
        return math.inf
    # r N(s) / D(s), s = r², stops rising where (N + 2 s N') D = 2 s N D', and has a pole where D is 0
    upper, rise = np.array([1.0, terms[0], terms[1], terms[4]]), (1.0, 3 * terms[0], 5 * terms[1], 7 * terms[4])
    if len(terms) == _BROWN:
        inverse = _largest_root(*rise[1:])
        return 1 / inverse if inverse > _NO_FOLD else math.inf
    lower = np.array([1.0, *terms[_BROWN:]])
    slope = np.convolve(rise, lower) - np.convolve(upper, 2 * lower * np.arange(len(lower)))
    return min(_least_positive_root(slope), _least_positive_root(lower))


def _largest_root(a: float, b: float, c: float) -> float:
    """Largest real root of t³ + a t² + b t + c, in closed form: a fit asks for it at each of its steps."""
    p, q = b - a * a / 3, (2 * a * a * a - 9 * a * b) / 27 + c
    if (q / 2) ** 2 + (p / 3) ** 3 > 0:
        u = -math.copysign(math.cbrt(abs(q) / 2 + math.sqrt((q / 2) ** 2 + (p / 3) ** 3)), q)
        return u - p / (3 * u) - a / 3
    width = 2 * math.sqrt(max(-p / 3, 0.0))
    angle = math.acos(max(-1.0, min(1.0, 3 * q / (p * width)))) if p * width else 0.0
    return width * math.cos(angle / 3) - a / 3


def _least_positive_root(coefficients: ArrayLike) -> float:
    """Smallest real root above 0 of 1 + a s + b s² ...; infinity where there is none.

    The largest 1 / s of a polynomial that begins with 1: terms that are nearly 0 do it no harm.
    """
    inverse = np.asarray(np.roots(np.asarray(coefficients, dtype=np.float64)), dtype=np.complex128)
    largest = float(inverse.real[np.abs(inverse.imag) < _NO_IMAGINARY].max(initial=0.0))
    return 1 / largest if largest > 0 else math.inf


def world_rays(model: PinholeModel, xy_px: FloatArray | Float32Array, iterations: int = _UNDISTORTIONS) -> FloatArray:
    """(N, 3) unit directions of pixels in the world."""
    xy = np.asarray(xy_px, dtype=np.float64)
    local = bearings(xy, model.focal_px, model.principal_point_px, model.distortion, iterations=iterations)
    rays = local @ model.rotation
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


def points_on_planes(model: PinholeModel, xy_px: FloatArray | Float32Array, planes: FloatArray) -> FloatArray:
    """(N, 3) where the rays of pixels meet planes n . x = 1, (N, 3) one each; NaN for a ray that does not."""
    origin, rays = model.position_m, world_rays(model, xy_px)
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (1 - planes @ origin) / (rays * planes).sum(axis=1)
        met = np.isfinite(along) & (along > 0)
        return np.asarray(np.where(met[:, None], origin + along[:, None] * rays, np.nan))


def project(model: PinholeModel, points_m: FloatArray) -> FloatArray:
    """(N, 2) pixels of world points."""
    local = points_m @ model.rotation.T + model.translation_m
    return image_of(local, model.focal_px, model.principal_point_px, model.distortion)


def pixels_in(xy_px: FloatArray, shape: tuple[int, ...]) -> tuple[BoolArray, tuple[IntArray, IntArray]]:
    """(N,) places in a picture, and rows and columns of these; one far from the axis may have any number, or none."""
    nearest = np.rint(xy_px)
    inside: BoolArray = np.asarray(((nearest >= 0) & (nearest < (shape[1], shape[0]))).all(axis=1))
    column, row = nearest[inside].astype(np.int64).T
    return inside, (row, column)


def pixels_seen(
    model: PinholeModel, points_m: FloatArray, shape: tuple[int, ...]
) -> tuple[BoolArray, tuple[IntArray, IntArray]]:
    """(N,) world points before a device and in its picture, and rows and columns of these."""
    ahead = (points_m @ model.rotation.T + model.translation_m)[:, 2] > 0
    xy_px = project(model, np.where(ahead[:, None], points_m, model.position_m + model.rotation[2]))
    return pixels_in(np.where(ahead[:, None], xy_px, -1.0), shape)


def values_seen(image: FloatArray, model: PinholeModel, points_m: FloatArray) -> FloatArray:
    """(N,) values of an image at the pixels in which a device has world points; NaN outside of it and behind."""
    inside, at = pixels_seen(model, points_m, image.shape)
    values = np.full(len(points_m), np.nan)
    values[inside] = image[at]
    return values


def rotation_of(vector: ArrayLike) -> FloatArray:
    """(3, 3) rotation of a Rodrigues vector in radians."""
    return np.asarray(cv2.Rodrigues(np.asarray(vector, dtype=np.float64).reshape(3, 1))[0])


def rotation_slopes(vector: FloatArray) -> FloatArray:
    """(3, 3, 3) derivative of a rotation by its Rodrigues vector in radians."""
    return np.asarray(np.asarray(cv2.Rodrigues(vector.reshape(3, 1))[1], dtype=np.float64).reshape(3, 3, 3))


def direction_slopes(vector: FloatArray) -> FloatArray:
    """(3, 3) derivative of a vector's direction by the vector."""
    length = np.linalg.norm(vector)
    return np.asarray((np.eye(3) - np.outer(vector, vector) / length**2) / length)


def vector_of(rotation: FloatArray) -> FloatArray:
    """(3,) Rodrigues vector of a rotation, in radians; tiny turns too, which cv2.Rodrigues takes for none."""
    return np.asarray(Rotation.from_matrix(rotation).as_rotvec(), dtype=np.float64)
