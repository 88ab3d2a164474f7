"""A lens with up to eight terms of distortion: points to pixels with exact derivatives, and back by Newton's method.

The terms and their order are OpenCV's: k1, k2, p1, p2, k3, k4, k5, k6; k4 … k6 stand in the denominator of the
rational model.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from calibration.arrays import BoolArray, FloatArray

PARAMETERS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
"""Of a lens, in the order of every vector and covariance."""
N = len(PARAMETERS)
TERMS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "none": (),
        "k1": ("k1",),
        "k1k2p1p2": ("k1", "k2", "p1", "p2"),
        "k1k2p1p2k3": ("k1", "k2", "p1", "p2", "k3"),
        "rational": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    }
)
"""Distortion models by name, each with the terms that it fits; from lean to rich."""
_NEWTON_STEPS = 30
_NEAR = 1e-9
"""Of the camera's axis units: an ideal coordinate that moves by less is found."""
_LEAST_DEPTH = 1e-9
"""A point at or behind the centre of projection is put here, so that its residual is huge and its step refused."""


@dataclass(frozen=True, eq=False, kw_only=True)
class FittedLens:
    """Focal lengths, principal point and distortion of a camera or projector of a given size."""

    width_px: int
    height_px: int
    vector: FloatArray
    """(12,) in the order of ``PARAMETERS``. [px and 1]"""
    model: str = "rational"
    """Name of the distortion model in ``TERMS`` that was fitted."""

    @property
    def focal_px(self) -> tuple[float, float]:
        """Focal lengths in x and y."""
        return float(self.vector[0]), float(self.vector[1])

    @property
    def principal_point_px(self) -> tuple[float, float]:
        """Where the optical axis meets the picture, (x, y); may lie outside of it."""
        return float(self.vector[2]), float(self.vector[3])

    @property
    def distortion(self) -> tuple[float, ...]:
        """Eight terms, k1 k2 p1 p2 k3 k4 k5 k6; only five when the last three are zero."""
        terms = tuple(float(term) for term in self.vector[4:])
        return terms if any(terms[5:]) else terms[:5]


def free_parameters(model: str) -> BoolArray:
    """(12,) which parameters of a lens a distortion model fits; focal lengths and principal point always.

    Parameters
    ----------
    model : str
        A name of ``TERMS``.
    """
    return np.array([name in TERMS[model] or k < 4 for k, name in enumerate(PARAMETERS)])


@dataclass(frozen=True, eq=False)
class ProjectedPoints:
    """Pixels of points, and how they move with the points and with the lens."""

    xy_px: FloatArray
    """(N, 2)"""
    by_point: FloatArray
    """(N, 2, 3) px per unit of length of the points in the device's frame."""
    by_lens: FloatArray
    """(N, 2, 12) px per unit of each parameter."""


def project_points(vector: FloatArray, points: FloatArray) -> FloatArray:
    """(N, 2) pixels of points in the device's frame.

    Parameters
    ----------
    vector : (12,)
        Of the lens.
    points : (N, 3)
        z forward, any unit of length.
    """
    depth = np.maximum(points[:, 2], _LEAST_DEPTH)
    return distorted(vector, points[:, :2] / depth[:, None]) * vector[:2] + vector[2:4]


def distorted(vector: FloatArray, plane: FloatArray) -> FloatArray:
    """(N, 2) real coordinates at focal length 1 of ideal ones (N, 2)."""
    p1, p2 = vector[6:8]
    x, y = plane[:, 0], plane[:, 1]
    r2 = x * x + y * y
    ratio = _upper(vector, r2) / _lower(vector, r2)
    real_x = x * ratio + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    return np.column_stack([real_x, y * ratio + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y])


def _upper(vector: FloatArray, r2: FloatArray) -> FloatArray:
    return np.asarray(1 + r2 * (vector[4] + r2 * (vector[5] + r2 * vector[8])))


def _lower(vector: FloatArray, r2: FloatArray) -> FloatArray:
    return np.asarray(1 + r2 * (vector[9] + r2 * (vector[10] + r2 * vector[11])))


def _real_by_ideal(vector: FloatArray, plane: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Real coordinates (N, 2) of ideal ones, and (N, 2, 2) how they move with these."""
    p1, p2 = vector[6:8]
    x, y = plane[:, 0], plane[:, 1]
    r2 = x * x + y * y
    upper, lower = _upper(vector, r2), _lower(vector, r2)
    ratio = upper / lower
    upper_slope = vector[4] + r2 * (2 * vector[5] + 3 * r2 * vector[8])
    lower_slope = vector[9] + r2 * (2 * vector[10] + 3 * r2 * vector[11])
    slope = (upper_slope - ratio * lower_slope) / lower
    slopes = np.empty((len(plane), 2, 2))
    slopes[:, 0, 0] = ratio + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x
    slopes[:, 1, 1] = ratio + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x
    slopes[:, 0, 1] = slopes[:, 1, 0] = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
    real = np.column_stack(
        [x * ratio + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * ratio + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y]
    )
    return real, slopes


def projection(vector: FloatArray, points: FloatArray) -> ProjectedPoints:
    """Project points with exact derivatives.

    Parameters
    ----------
    vector : (12,)
        Of the lens.
    points : (N, 3)
        In the device's frame, z forward.

    Returns
    -------
    ProjectedPoints
    """
    depth = np.maximum(points[:, 2], _LEAST_DEPTH)
    plane = points[:, :2] / depth[:, None]
    real, by_ideal = _real_by_ideal(vector, plane)
    focal = vector[:2]
    by_point = np.empty((len(points), 2, 3))
    by_point[..., :2] = by_ideal * (focal[:, None] / depth[:, None, None])
    by_point[..., 2] = -np.einsum("nij,nj->ni", by_point[..., :2], plane)
    return ProjectedPoints(real * focal + vector[2:4], by_point, _by_lens(vector, plane, real))


def _by_lens(vector: FloatArray, plane: FloatArray, real: FloatArray) -> FloatArray:
    x, y = plane[:, 0], plane[:, 1]
    r2 = x * x + y * y
    lower = _lower(vector, r2)
    ratio = _upper(vector, r2) / lower
    slopes = np.zeros((len(plane), 2, N))
    for axis, mine, (p_same, p_cross) in ((0, x, (7, 6)), (1, y, (6, 7))):
        focal = vector[axis]
        slopes[:, axis, axis] = real[:, axis]
        slopes[:, axis, 2 + axis] = 1
        for term, power in ((4, 1), (5, 2), (8, 3)):
            slopes[:, axis, term] = focal * mine * r2**power / lower
        for term, power in ((9, 1), (10, 2), (11, 3)):
            slopes[:, axis, term] = -focal * mine * ratio * r2**power / lower
        slopes[:, axis, p_same] = focal * (r2 + 2 * mine * mine)
        slopes[:, axis, p_cross] = focal * 2 * x * y
    return slopes


def ideal_coordinates(vector: FloatArray, xy_px: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return the ideal coordinates (x / z, y / z) that pixels see, by Newton's method.

    Parameters
    ----------
    vector : (12,)
        Of the lens.
    xy_px : (N, 2)
        Pixels.

    Returns
    -------
    (N, 2), (N,) bool
        Coordinates, and where they were found: beyond the edge of a folding distortion there is no answer.
    """
    real = (xy_px - vector[2:4]) / vector[:2]
    ideal = real.copy()
    miss = np.full(len(real), np.inf)
    for _ in range(_NEWTON_STEPS):
        guess, slopes = _real_by_ideal(vector, ideal)
        gap = guess - real
        miss = np.abs(gap).max(axis=1)
        if not (miss > _NEAR).any():
            break
        determinant = slopes[:, 0, 0] * slopes[:, 1, 1] - slopes[:, 0, 1] ** 2
        safe = np.where(np.abs(determinant) > 1e-12, determinant, 1e-12)
        step_x = (slopes[:, 1, 1] * gap[:, 0] - slopes[:, 0, 1] * gap[:, 1]) / safe
        step_y = (slopes[:, 0, 0] * gap[:, 1] - slopes[:, 0, 1] * gap[:, 0]) / safe
        step = np.column_stack([step_x, step_y])
        size = np.maximum(np.abs(step).max(axis=1) / (0.3 + 0.5 * np.abs(ideal).max(axis=1)), 1)
        ideal = ideal - step / size[:, None]
    return ideal, (miss < 1e-6) & (pixel_area(vector, ideal) > 0)


def pixel_area(vector: FloatArray, plane: FloatArray) -> FloatArray:
    """(N,) how much the distortion enlarges an area at ideal coordinates; not above 0 where it folds."""
    slopes = _real_by_ideal(vector, plane)[1]
    return np.asarray(slopes[:, 0, 0] * slopes[:, 1, 1] - slopes[:, 0, 1] * slopes[:, 1, 0])
