"""Where a known mesh stands: its distance to what a camera measured, made smallest from many starts.

Each point pulls along the shortest line to the mesh, which within a face is the face's normal (point to plane) and
beyond its rim leads to the rim. Points far off count less and less (Tukey 1977), the further the fit has come.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from calibration.arrays import BoolArray, FloatArray
from calibration.geometry.pinhole import PinholeModel, values_seen
from calibration.surfaces.known.nearest import SampledMesh
from calibration.surfaces.point_map import PointMap

_COARSE, _FINE = 400, 4000
"""Points of a start, and of the last fits."""
_COARSE_STEPS, _FINE_STEPS = 14, 30
_REFINED = 5
"""Starts that are followed to the end: the best by what they leave and by what stands where the camera sees through."""
_FIRST_SPREAD, _LAST_SPREAD = 0.15, 2e-4
"""Of the mesh's size: how far off a point may be and still count, at first and in the end."""
_TUKEY = 4.685
"""Standard deviations beyond which a point does not count: 95 % efficient where errors are Gaussian."""
_JUDGED = 0.02
"""Of the mesh's size: what is further off tells nothing more of which start is better."""
_ANOTHER = 0.05
"""Of the mesh's size, by which its corners stand elsewhere in another place."""
_TURNS = 24
"""Starts about the upright axis, 15 degrees apart: fits find what is within about 20."""
_SEE_THROUGH = 0.02
"""Of the distance, by which the camera sees something behind the mesh before it is said to see through it."""
_SAMPLES_SEEN = 2000
_AS_GOOD = 0.005
"""By which what two places leave may differ, of 2 % of the mesh's size, and both explain the points."""
_NEAR = 0.1
"""Of the first spread, for a fit that begins near its end."""
_GROWTH, _MOST_SCALE = 0.05, 1.25
"""Of the size: in a step, and in all; a mesh of no size fits one point."""
_LEAST_TURN = 1e-9


@dataclass(frozen=True, eq=False, kw_only=True)
class MeshPose:
    """A place of a mesh, x_world = scale R x_mesh + t."""

    rotation: FloatArray
    """(3, 3) world_from_mesh."""
    translation_m: FloatArray
    """(3,)"""
    scale: float = 1.0

    def to_world(self, points_m: FloatArray) -> FloatArray:
        """Return points (…, 3) of the mesh in the world."""
        return np.asarray(self.scale * points_m @ self.rotation.T + self.translation_m)

    def to_mesh(self, points_m: FloatArray) -> FloatArray:
        """Return points (…, 3) of the world in the mesh's frame."""
        return np.asarray((points_m - self.translation_m) @ self.rotation / self.scale)


@dataclass(frozen=True, eq=False, kw_only=True)
class Registration:
    """A mesh that was found, and how well."""

    pose: MeshPose
    misfit_m: FloatArray
    """(N,) of each chosen pixel in order of rows: how far its point lies before the mesh; negative behind it."""
    see_through: float
    """Share of the mesh, where it looks at the camera, behind which the camera sees something else."""
    loosest_m: float
    """How far the loosest of all motions may move a corner of the mesh: a standard deviation."""
    loosest: str
    """That motion, in words."""
    also: MeshPose | None
    """Another place that explains the points as well; None: there is none."""


@dataclass(frozen=True, eq=False, kw_only=True)
class _MeasuredPoints:
    """What the camera measured of the mesh."""

    points_m: FloatArray
    rays: FloatArray
    sigma_m: FloatArray


@dataclass(frozen=True, eq=False)
class _Fit:
    pose: MeshPose
    information: FloatArray
    """(6, 6) of turns about the mesh's middle, times its size, and of moves; in the mesh's frame. [1/m²]"""
    cost: float


def register(
    points: PointMap,
    chosen: BoolArray,
    camera: PinholeModel,
    triangles_m: FloatArray,
    *,
    upright: bool = True,
) -> Registration:
    """Find a mesh in what a camera measured.

    Parameters
    ----------
    points : PointMap
        Of the chosen pixels, and of all others that see something: what is behind the mesh it does not hide.
    chosen : (H, W) bool
        Pixels that see the mesh.
    camera : PinholeModel
        Whose pixels these are.
    triangles_m : (T, 3, 3)
        Corners, counter-clockwise seen from the lit side; z up where `upright`. [m]
    upright : bool
        Whether the mesh stands as the room does at first; else every way up is tried.

    Returns
    -------
    Registration
        The best there is: whether it is good enough, its misfit tells.
    """
    mesh = SampledMesh(triangles_m)
    seen = _measured(points, chosen)
    behind = _nearest_about(points)
    coarse, fine = (_thinned(seen, count) for count in (_COARSE, _FINE))
    starts = [
        _fitted(mesh, coarse, start, _COARSE_STEPS) for start in _starts(mesh, seen, points.origin_m, upright=upright)
    ]
    ranked = sorted(starts, key=lambda fit: fit.cost + _see_through(mesh, fit.pose, behind, camera))
    ends = [_fitted(mesh, fine, fit.pose, _FINE_STEPS, first=_NEAR) for fit in _distinct(mesh, ranked)[:_REFINED]]
    ends.sort(key=lambda fit: fit.cost + _see_through(mesh, fit.pose, behind, camera))
    best = ends[0]
    loosest_m, loosest = _loosest(mesh, best)
    return Registration(
        pose=best.pose,
        misfit_m=_misfit(mesh, best.pose, seen),
        see_through=_see_through(mesh, best.pose, behind, camera),
        loosest_m=loosest_m,
        loosest=loosest,
        also=_as_good(mesh, ends, behind, camera),
    )


def better_size(points: PointMap, chosen: BoolArray, triangles_m: FloatArray, pose: MeshPose) -> tuple[float, float]:
    """Return how many times as large a mesh would fit best from a pose on, and the median misfit that it then leaves.

    Parameters
    ----------
    points, chosen, triangles_m
        As for :func:`register`.
    pose : MeshPose
        Where it found the mesh.

    Returns
    -------
    scale, misfit_m : float
        The size stays within a quarter of the mesh's own.
    """
    mesh, seen = SampledMesh(triangles_m), _measured(points, chosen)
    found = _fitted(mesh, _thinned(seen, _FINE), pose, _FINE_STEPS, fits_scale=True, first=_NEAR)
    return found.pose.scale, float(np.median(np.abs(_misfit(mesh, found.pose, seen))))


def _measured(points: PointMap, chosen: BoolArray) -> _MeasuredPoints:
    rows, columns = np.nonzero(chosen & points.known)
    return _MeasuredPoints(
        points_m=points.origin_m + points.distance_m[rows, columns, None] * points.rays[rows, columns],
        rays=points.rays[rows, columns],
        sigma_m=points.sigma_m[rows, columns],
    )


def _thinned(seen: _MeasuredPoints, count: int) -> _MeasuredPoints:
    chosen = np.random.default_rng(0).permutation(len(seen.points_m))[:count]
    return _MeasuredPoints(points_m=seen.points_m[chosen], rays=seen.rays[chosen], sigma_m=seen.sigma_m[chosen])


def _starts(mesh: SampledMesh, seen: _MeasuredPoints, origin_m: FloatArray, *, upright: bool) -> list[MeshPose]:
    """Places at which the middle of the side that would be seen stands in the middle of the points."""
    middle = np.median(seen.points_m, axis=0)
    ahead = (middle - origin_m) / np.linalg.norm(middle - origin_m)
    ways_up = [Rotation.identity()] if upright else _WAYS_UP
    turns = [Rotation.from_rotvec([0.0, 0.0, 2 * np.pi * k / _TURNS]) for k in range(_TURNS)]
    samples, triangle = mesh.samples
    poses = []
    for R in ((turn * way).as_matrix() for way in ways_up for turn in turns):
        facing = mesh.normals[triangle] @ R.T @ ahead < 0
        side = samples[facing] if facing.any() else samples
        poses.append(MeshPose(rotation=R, translation_m=middle - R @ np.median(side, axis=0)))
    return poses


_WAYS_UP = [
    Rotation.identity(),
    *(Rotation.from_euler("x", angle, degrees=True) for angle in (90, 180, 270)),
    *(Rotation.from_euler("y", angle, degrees=True) for angle in (90, 270)),
]


def _fitted(
    mesh: SampledMesh,
    seen: _MeasuredPoints,
    start: MeshPose,
    steps: int,
    *,
    fits_scale: bool = False,
    first: float = 1.0,
) -> _Fit:
    """A pose after some steps of Gauss and Newton, points that are far off counting less with each."""
    spreads = np.geomspace(first * _FIRST_SPREAD, _LAST_SPREAD, steps) * mesh.size_m
    pose, information = start, np.eye(6)
    for spread in spreads:
        pose, information = _step(mesh, seen, pose, float(spread) * pose.scale, fits_scale=fits_scale)
    off = np.abs(_offsets(mesh, pose, seen)[0]) / (_JUDGED * mesh.size_m)
    return _Fit(pose, information, float(np.minimum(off, 1.0).mean()))


def _offsets(mesh: SampledMesh, pose: MeshPose, seen: _MeasuredPoints) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(N,) distances to the mesh, (N, 3) the directions along which they are, and the points in the mesh's frame.

    In metres of the mesh; before it they are positive.
    """
    points = pose.to_mesh(seen.points_m)
    found = mesh.nearest(points, seen.rays @ pose.rotation)
    away = points - found.place_m
    length = np.linalg.norm(away, axis=1)
    normal = mesh.normals[found.triangle]
    along = away / np.maximum(length, _LEAST_TURN)[:, None]
    side = np.where(np.einsum("nc,nc->n", along, normal) < 0, -1.0, 1.0)
    direction = np.where((length > 1e-6 * mesh.size_m)[:, None], along * side[:, None], normal)
    return side * length, direction, points


def _step(
    mesh: SampledMesh, seen: _MeasuredPoints, pose: MeshPose, spread_m: float, *, fits_scale: bool
) -> tuple[MeshPose, FloatArray]:
    off, direction, points = _offsets(mesh, pose, seen)
    leans = np.abs(np.einsum("nc,nc->n", direction, seen.rays @ pose.rotation))
    sigma = np.hypot(seen.sigma_m * leans, spread_m) / pose.scale
    inside = np.clip(1 - (off / (_TUKEY * sigma)) ** 2, 0.0, None) ** 2
    weight = inside / sigma**2
    middle = mesh.samples[0].mean(axis=0)
    lever = (points - middle) / mesh.size_m
    # A small turn of the points about the mesh's middle, a move of them, a growth.
    J = np.concatenate([np.cross(lever, direction), direction], axis=1)
    if fits_scale:
        J = np.concatenate([J, np.einsum("nc,nc->n", lever, direction)[:, None]], axis=1)
    normal_matrix = J.T @ (weight[:, None] * J)
    if not np.trace(normal_matrix) > 0:  # nothing is near: there is nowhere to go from here
        return pose, np.zeros((6, 6))
    damped = normal_matrix + 1e-6 * np.trace(normal_matrix) * np.eye(len(normal_matrix))
    by = -np.linalg.solve(damped, J.T @ (weight * off))
    turn = Rotation.from_rotvec(by[:3] / mesh.size_m).as_matrix()
    growth = float(np.clip(1 + by[6] / mesh.size_m, 1 - _GROWTH, 1 + _GROWTH)) if fits_scale else 1.0
    growth = pose.scale / float(np.clip(pose.scale / growth, 1 / _MOST_SCALE, _MOST_SCALE))
    # x_mesh' = g T (x_mesh - m) + m + v, solved for the pose that does the same.
    rotation = pose.rotation @ turn.T
    scale = pose.scale / growth
    shifted = middle + by[3:6] - growth * turn @ middle
    translation = pose.translation_m - scale * rotation @ shifted
    return MeshPose(rotation=rotation, translation_m=translation, scale=scale), normal_matrix[:6, :6]


def _distinct(mesh: SampledMesh, ranked: Sequence[_Fit]) -> list[_Fit]:
    """Each place once, the best fit of those that came to it: others would be followed in vain."""
    corners = mesh.triangles_m.reshape(-1, 3)
    ends = np.stack([corners.min(axis=0), corners.max(axis=0), corners[0], corners.mean(axis=0)])
    found: list[_Fit] = []
    for fit in ranked:
        there = fit.pose.to_world(ends)
        moved = (np.linalg.norm(there - one.pose.to_world(ends), axis=1).max() for one in found)
        if all(one > _ANOTHER * mesh.size_m for one in moved):
            found.append(fit)
    return found


def _nearest_about(points: PointMap) -> FloatArray:
    """(H, W) the nearest thing that a pixel or its neighbours see: at a rim the camera sees past it; NaN for none."""
    known = np.where(points.known, points.distance_m, np.inf)
    nearest = cv2.erode(known, np.ones((3, 3), np.uint8), borderValue=np.inf)
    return np.where(np.isfinite(nearest), nearest, np.nan)


def _see_through(mesh: SampledMesh, pose: MeshPose, behind: FloatArray, camera: PinholeModel) -> float:
    """Share of the samples that look at the camera behind which it sees something else."""
    samples, triangle = mesh.samples
    step = max(1, len(samples) // _SAMPLES_SEEN)
    world = pose.to_world(samples[::step])
    away = world - camera.position_m
    distance = np.linalg.norm(away, axis=1)
    facing = np.einsum("nc,nc->n", mesh.normals[triangle[::step]] @ pose.rotation.T, away) < 0
    measured = np.where(facing, values_seen(behind, camera, world), np.nan)
    known = np.isfinite(measured)
    through = measured[known] > distance[known] * (1 + _SEE_THROUGH)
    return float(through.mean()) if known.any() else 0.0


def _misfit(mesh: SampledMesh, pose: MeshPose, seen: _MeasuredPoints) -> FloatArray:
    return np.asarray(pose.scale * _offsets(mesh, pose, seen)[0])


def _loosest(mesh: SampledMesh, fit: _Fit) -> tuple[float, str]:
    """How far the loosest motion may move a corner of the mesh, and what kind of motion it is."""
    values, vectors = np.linalg.eigh(fit.information)
    sigma = 1 / np.sqrt(max(float(values[0]), np.finfo(float).tiny))
    turn, move = vectors[:3, 0], vectors[3:, 0]
    corners = mesh.triangles_m.reshape(-1, 3) - mesh.samples[0].mean(axis=0)
    moved = np.linalg.norm(np.cross(turn / mesh.size_m, corners) + move, axis=1).max()
    is_turn = bool(np.linalg.norm(turn) > np.linalg.norm(move))
    axis = "xyz"[int(np.abs(fit.pose.rotation @ (turn if is_turn else move)).argmax())]
    return float(
        min(sigma * moved, mesh.size_m)
    ), f"a turn about the room's {axis}" if is_turn else f"a move along the room's {axis}"


def _as_good(mesh: SampledMesh, ends: Sequence[_Fit], behind: FloatArray, camera: PinholeModel) -> MeshPose | None:
    """Another place of the mesh that explains the points as well, and is another one: not the same by symmetry."""
    best = ends[0]
    limit = best.cost + _see_through(mesh, best.pose, behind, camera) + _AS_GOOD
    samples, triangle = mesh.samples
    step = max(1, len(samples) // _SAMPLES_SEEN)
    for fit in ends[1:]:
        if fit.cost + _see_through(mesh, fit.pose, behind, camera) > limit:
            continue
        there = best.pose.to_mesh(fit.pose.to_world(samples[::step]))
        outwards = mesh.normals[triangle[::step]] @ (best.pose.rotation.T @ fit.pose.rotation).T
        off = np.linalg.norm(there - mesh.nearest(there, -outwards).place_m, axis=1)
        if np.quantile(off, 0.9) > _JUDGED * mesh.size_m:
            return fit.pose
    return None
