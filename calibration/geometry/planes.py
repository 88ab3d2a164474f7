"""Flat walls in a point cloud: found by what they do to the picture, so that every limit is in pixels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from calibration.records import BoolArray, FloatArray

IntArray = NDArray[np.int64]
Transfer = Callable[[FloatArray, FloatArray], FloatArray]
"""(camera rays (N, 3), plane (3,)) → projector pixels (N, 2) if the points lay on the plane n · x = 1."""

_INLIER_PX = 1.5
_TRIALS = 400
_NEIGHBOURHOOD_PX = 150.0
_LEAST_SHARE = 0.02
_MOST_PLANES = 8
_MOST_GUESSED = 2
_NEVER_DEG = 70.0
"""A plane whose normal is so far from an axis is not perpendicular to it, however wrong the lenses are."""


@dataclass(frozen=True, eq=False)
class Axes:
    """The directions of a box-like room, and which of them each plane is perpendicular to."""

    directions: FloatArray
    """(3, 3) orthonormal rows."""
    of_plane: NDArray[np.int64]
    """(K,) 0, 1, 2, or -1 for a plane that fits none."""


def segment_planes(
    points: FloatArray, transfer: Transfer, x2: FloatArray, x1: FloatArray, rays: FloatArray, usable: BoolArray
) -> FloatArray:
    """(K, 3) planes as normal / offset, the one with most points first; sequential RANSAC with a fixed seed.

    Neighbouring points (in the camera's picture) make a plane; its points are those whose correspondence it
    predicts to within 1.5 px. Planes with less than 2 % of the points are left out.
    """
    random = np.random.default_rng(1)
    left = np.flatnonzero(usable)
    planes: list[FloatArray] = []
    total = len(left)
    while len(planes) < _MOST_PLANES and len(left) >= max(_LEAST_SHARE * total, 30):
        best = _best_plane(points[left], transfer, x2[left], x1[left], rays[left], random)
        if best is None:
            break
        error = np.linalg.norm(transfer(rays[left], best) - x2[left], axis=1)
        inside = error < _INLIER_PX
        if inside.sum() < max(_LEAST_SHARE * total, 30):
            break
        planes.append(best)
        # What lies close to the plane, too, so that its rim is not found again as another plane.
        left = left[error > 3 * _INLIER_PX]
    return np.array(planes).reshape(-1, 3)


def _best_plane(
    points: FloatArray,
    transfer: Transfer,
    x2: FloatArray,
    x1: FloatArray,
    rays: FloatArray,
    random: np.random.Generator,
) -> FloatArray | None:
    best, best_count = None, 0
    test = random.permutation(len(points))[:800]
    test_rays, test_x2 = rays[test], x2[test]
    for _ in range(_TRIALS):
        first = int(random.integers(len(points)))
        near = np.flatnonzero((np.abs(x1 - x1[first]) < _NEIGHBOURHOOD_PX).all(axis=1))
        if len(near) < 3:
            continue
        plane = _plane_through(points[random.choice(near, size=min(12, len(near)), replace=False)])
        if plane is None:
            continue
        count = int((np.linalg.norm(transfer(test_rays, plane) - test_x2, axis=1) < _INLIER_PX).sum())
        if count > best_count:
            best, best_count = plane, count
    if best is None:
        return None
    for _ in range(4):
        inside = np.linalg.norm(transfer(rays, best) - x2, axis=1) < _INLIER_PX
        refined = _plane_through(points[inside]) if inside.sum() >= 3 else None
        if refined is None:
            break
        best = refined
    return best


def _plane_through(points: FloatArray) -> FloatArray | None:
    """Least squares of n · x = 1, each point weighted by 1 / distance² (its depth error grows so)."""
    weight = 1 / np.maximum((points**2).sum(axis=1), 1e-12)
    plane, _, rank, _ = np.linalg.lstsq(points * weight[:, None], weight, rcond=None)
    return np.asarray(plane) if rank == 3 else None


def assign_planes(
    transfer: Transfer,
    rays: FloatArray,
    x2: FloatArray,
    planes: FloatArray,
    limit_px: float,
    margin_px: float = 0.0,
) -> IntArray:
    """(N,) plane that predicts each correspondence best, -1 beyond the limit.

    Also -1 where another plane predicts it within the margin: near an edge of the room blur mixes both walls.
    """
    errors = np.stack([np.linalg.norm(transfer(rays, plane) - x2, axis=1) for plane in planes])
    good = errors.min(axis=0) <= limit_px
    if len(planes) > 1:
        good &= np.partition(errors, 1, axis=0)[1] > margin_px
    return np.where(good, errors.argmin(axis=0), -1).astype(np.int64)


def axis_hypotheses(planes: FloatArray, axes: Axes) -> list[Axes]:
    """The axes as they are, and with up to two planes that fit none given to each axis they may belong to.

    Before the lenses are known, walls of a small or narrow view may stand tens of degrees off.
    """
    normals = planes / np.linalg.norm(planes, axis=1, keepdims=True)
    angle_deg = np.degrees(np.arccos(np.minimum(np.abs(normals @ axes.directions.T), 1.0)))
    unknown = np.flatnonzero(axes.of_plane < 0)[:_MOST_GUESSED]
    options = [(-1, *np.flatnonzero(angle_deg[plane] < _NEVER_DEG)) for plane in unknown]
    found = []
    for choice in product(*options):
        of_plane = axes.of_plane.copy()
        of_plane[unknown] = choice
        found.append(Axes(axes.directions, of_plane))
    return found


def orthogonal_axes(planes: FloatArray, limit_deg: float = 25.0) -> Axes:
    """Fit an orthogonal frame to the planes' normals; planes further than the limit from all axes get -1.

    The limit is wide: before the lenses are known the angles between walls are off by up to ten degrees.
    """
    normals = planes / np.linalg.norm(planes, axis=1, keepdims=True)
    first = normals[0]
    cosine = np.abs(normals @ first)
    others = np.flatnonzero(cosine < np.sin(np.radians(limit_deg)))
    second = normals[others[0]] if len(others) else np.linalg.svd(first[None])[2][1]
    third = np.cross(first, second)
    rest = [n for n in normals[others[1:]] if abs(n @ second) < 0.6] if len(others) > 1 else []
    if rest:
        third = rest[0] * np.sign(rest[0] @ third)
    u, _, vt = np.linalg.svd(np.stack([first, second, third / np.linalg.norm(third)]))
    frame = u @ vt
    if np.linalg.det(frame) < 0:
        frame[2] = -frame[2]
    alignment = np.abs(normals @ frame.T)
    nearest = alignment.argmax(axis=1)
    fits = alignment.max(axis=1) > np.cos(np.radians(limit_deg))
    return Axes(frame, np.where(fits, nearest, -1).astype(np.int64))
