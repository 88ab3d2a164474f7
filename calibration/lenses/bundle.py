"""Bundle adjustment of a camera, a projector, board poses and the boards' shape: exact derivatives, poses eliminated.

The unknowns that all views share are at most 34 (S in shapes); each view adds six, which couple with the shared ones
only. The normal equations are therefore reduced to the shared unknowns (Schur complement), and the cost of a step grows
with the number of corners, not with its cube: B. Triggs et al., Bundle adjustment - a modern synthesis, 1999.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np

from calibration.arrays import BoolArray, FloatArray, IntArray
from calibration.lenses.board_shape import board_points
from calibration.lenses.lens import N, project_points, projection
from calibration.lenses.records import FLEX, POSE, BoardSightings, RigState

SHARED = 2 * N + POSE + FLEX + 1
"""Unknowns that all views share: S in the shapes of arrays."""
CAMERA, PROJECTOR = slice(0, N), slice(N, 2 * N)
RELATIVE, BOARD = slice(2 * N, 2 * N + POSE), slice(2 * N + POSE, SHARED)
BEND, STRETCH = slice(BOARD.start, SHARED - 1), slice(SHARED - 1, SHARED)
"""Parts of the board's: its bend, and by what share its squares are longer down than across."""
_LARGEST_DAMPING = 1e12
"""Beyond, a step no longer changes anything."""
_EMPTY = 1e-30
"""Added to the diagonal of a pose: of a view without any row, which then stays where it is."""
LEAST_GAIN = 1e-13
"""Of the cost: a step that gains less ends the fit; so small that all starts end in one place to 1e-4 px."""


@dataclass(frozen=True, eq=False)
class Linearised:
    """Residuals of all rows and how they move; four numbers a row, or two without a projector."""

    residual: FloatArray
    """(N, d) modelled minus seen. [px]"""
    by_shared: FloatArray
    """(N, d, S)"""
    by_pose: FloatArray
    """(N, d, 6)"""


def cross_matrices(vectors: FloatArray) -> FloatArray:
    """(N, 3, 3) with cross_matrices(v) @ w = v × w."""
    matrix = np.zeros((len(vectors), 3, 3))
    x, y, z = vectors.T
    matrix[:, 0, 1], matrix[:, 0, 2], matrix[:, 1, 2] = -z, y, -x
    matrix[:, 1, 0], matrix[:, 2, 0], matrix[:, 2, 1] = z, -y, x
    return matrix


def camera_points(sightings: BoardSightings, state: RigState) -> FloatArray:
    """(N, 3) corners in the camera's frame."""
    points, _ = board_points(sightings, state)
    return np.asarray(
        np.einsum("nij,nj->ni", state.rotations[sightings.view], points) + state.translations_m[sightings.view]
    )


def projector_points(points_m: FloatArray, state: RigState) -> FloatArray:
    """(N, 3) points of the camera's frame in the projector's."""
    return np.asarray(points_m @ state.projector_rotation.T + state.projector_translation_m)


def linearise(sightings: BoardSightings, state: RigState) -> Linearised:
    """Residuals of all rows with their exact derivatives.

    A projector's pixel was read at the place where the camera saw the corner. What the camera's detection is off by
    moves it too, so it is compared at the place where the camera should have seen the corner.
    """
    points, by_board = board_points(sightings, state)
    rotation = state.rotations[sightings.view]
    turned = np.einsum("nij,nj->ni", rotation, points)
    seen = turned + state.translations_m[sightings.view]
    by_pose = np.concatenate([-cross_matrices(turned), np.broadcast_to(np.eye(3), (len(points), 3, 3))], axis=2)
    by_board = rotation @ by_board
    camera = projection(state.camera, seen)
    shared = np.zeros((len(points), 2, SHARED))
    shared[..., CAMERA] = camera.by_lens
    shared[..., BOARD] = camera.by_point @ by_board
    first = Linearised(camera.xy_px - sightings.camera_xy_px, shared, camera.by_point @ by_pose)
    if not sightings.has_projector:
        return first
    second = _projector_rows(sightings, state, seen, first=first, moves=(by_pose, by_board))
    return Linearised(
        np.concatenate([first.residual, second.residual], axis=1),
        np.concatenate([first.by_shared, second.by_shared], axis=1),
        np.concatenate([first.by_pose, second.by_pose], axis=1),
    )


def _projector_rows(
    sightings: BoardSightings,
    state: RigState,
    seen: FloatArray,
    *,
    first: Linearised,
    moves: tuple[FloatArray, FloatArray],
) -> Linearised:
    turned = seen @ state.projector_rotation.T
    lit = projection(state.projector, turned + state.projector_translation_m)
    by_seen = lit.by_point @ state.projector_rotation
    by_pose, by_board = moves
    shared = np.zeros((len(seen), 2, SHARED))
    shared[..., PROJECTOR] = lit.by_lens
    shared[..., RELATIVE][..., :3] = -lit.by_point @ cross_matrices(turned)
    shared[..., RELATIVE][..., 3:] = lit.by_point
    shared[..., BOARD] = by_seen @ by_board
    read = sightings.projector_by_camera
    residual = lit.xy_px - sightings.projector_xy_px - np.einsum("nij,nj->ni", read, first.residual)
    return Linearised(residual, shared - read @ first.by_shared, by_seen @ by_pose - read @ first.by_pose)


def residuals(sightings: BoardSightings, state: RigState) -> FloatArray:
    """Return modelled minus seen, (N, 2) or (N, 4), in pixels, as :func:`linearise` gives them."""
    seen = camera_points(sightings, state)
    camera = projection_only(state.camera, seen) - sightings.camera_xy_px
    if not sightings.has_projector:
        return camera
    lit = projection_only(state.projector, projector_points(seen, state)) - sightings.projector_xy_px
    lit -= np.einsum("nij,nj->ni", sightings.projector_by_camera, camera)
    return np.concatenate([camera, lit], axis=1)


def projection_only(vector: FloatArray, points: FloatArray) -> FloatArray:
    """(N, 2) pixels of points, which are infinitely far from any picture when they lie behind the device."""
    behind = points[:, 2] <= 0
    xy = project_points(vector, np.where(behind[:, None], 1.0, points))
    xy[behind] = 1e6
    return xy


def weights_of(sightings: BoardSightings) -> FloatArray:
    """(N, 1) or (N, 2) weight of each row's residuals by device: the square of what the sightings give."""
    columns = [sightings.camera_weight]
    if sightings.has_projector:
        columns.append(sightings.projector_weight)
    return np.asarray(np.column_stack(columns) ** 2)


def by_device(values: FloatArray) -> FloatArray:
    """(N, devices, 2) residuals of (N, 2 devices)."""
    return values.reshape(len(values), -1, 2)


def row_slices(view: IntArray, views: int) -> Iterator[tuple[int, slice]]:
    """Yield each view with its rows; rows are in the order of their views."""
    edges = np.searchsorted(view, np.arange(views + 1))
    for k in range(views):
        yield k, slice(int(edges[k]), int(edges[k + 1]))


@dataclass(frozen=True, eq=False, kw_only=True)
class NormalEquations:
    """Blocks of JᵀWJ and Jᵀ W r."""

    shared: FloatArray
    """(p, p)"""
    mixed: FloatArray
    """(V, p, 6)"""
    poses: FloatArray
    """(V, 6, 6)"""
    pose_slope: FloatArray
    """(V, 6)"""
    of_views: FloatArray
    """(V, p, p) what each view adds to ``shared``."""
    slope_of_views: FloatArray
    """(V, p)"""
    prior: FloatArray
    """(p,) inverse variances of the shared unknowns about zero, from before any view ..."""
    prior_slope: FloatArray
    """(p,) ... and what they add to the slope."""

    def reduced(self, damping: float = 0.0) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the (V, p, p) information and (V, p) slope of each view on the shared unknowns, and C⁻¹Bᵀ."""
        diagonal = np.einsum("vii->vi", self.poses)
        poses = self.poses.copy()
        np.einsum("vii->vi", poses)[...] += damping * diagonal + 1e-14 * diagonal.max(axis=1, keepdims=True) + _EMPTY
        back = np.linalg.solve(poses, np.swapaxes(self.mixed, 1, 2))
        lean = self.of_views - self.mixed @ back
        slope = self.slope_of_views - np.einsum("vki,vk->vi", back, self.pose_slope)
        return np.asarray(lean), np.asarray(slope), np.asarray(back)


def normal_equations(
    lines: Linearised,
    weight: FloatArray,
    view: IntArray,
    views: int,
    *,
    known: tuple[FloatArray, FloatArray] | None = None,
) -> NormalEquations:
    """Sum the rows of each view; `weight` is (N, devices).

    `known` is what was known before any view: (p,) inverse variances about zero, and (p,) the values now.
    """
    root = np.sqrt(np.repeat(weight, 2, axis=1))
    residual = lines.residual * root
    shared, pose = lines.by_shared * root[..., None], lines.by_pose * root[..., None]
    p = shared.shape[2]
    own, mixed = np.zeros((views, p, p)), np.zeros((views, p, POSE))
    poses, slope, pose_slope = np.zeros((views, POSE, POSE)), np.zeros((views, p)), np.zeros((views, POSE))
    for k, rows in row_slices(view, views):
        r = residual[rows].ravel()
        s, q = shared[rows].reshape(len(r), p), pose[rows].reshape(len(r), POSE)
        own[k], mixed[k], poses[k] = s.T @ s, s.T @ q, q.T @ q
        slope[k], pose_slope[k] = s.T @ r, q.T @ r
    prior, values = (np.zeros(p), np.zeros(p)) if known is None else known
    return NormalEquations(
        shared=own.sum(axis=0) + np.diag(prior),
        mixed=mixed,
        poses=poses,
        pose_slope=pose_slope,
        of_views=own,
        slope_of_views=slope,
        prior=prior,
        prior_slope=prior * values,
    )


def only(lines: Linearised, free: BoolArray) -> Linearised:
    """Return the same with the free shared unknowns only."""
    return replace(lines, by_shared=lines.by_shared[..., free])


def _step(equations: NormalEquations, damping: float) -> tuple[FloatArray, FloatArray]:
    """Damped Gauss-Newton step of the shared unknowns (p,) and the poses (V, 6)."""
    information, slope, back = equations.reduced(damping)
    diagonal = np.diag(equations.shared)
    total = information.sum(axis=0) + np.diag(equations.prior + damping * diagonal + 1e-30)
    scale = 1 / np.sqrt(np.maximum(diagonal, 1e-300))
    whole = total * np.outer(scale, scale)
    downhill = slope.sum(axis=0) + equations.prior_slope
    shared = scale * np.linalg.lstsq(whole, scale * downhill, rcond=1e-15)[0] if len(whole) else np.zeros(0)
    poses = _damped(equations, damping) - np.einsum("vki,i->vk", back, shared)
    return shared, poses


def _damped(equations: NormalEquations, damping: float) -> FloatArray:
    """(V, 6) step of the poses alone."""
    diagonal = np.einsum("vii->vi", equations.poses)
    poses = equations.poses.copy()
    np.einsum("vii->vi", poses)[...] += damping * diagonal + 1e-14 * diagonal.max(axis=1, keepdims=True) + _EMPTY
    return np.asarray(np.linalg.solve(poses, equations.pose_slope[..., None])[..., 0])


def shared_values(state: RigState) -> FloatArray:
    """(S,) the shared unknowns; 0 for the motion between the devices, which is counted from where it is."""
    return np.concatenate([state.camera, state.projector, np.zeros(POSE), state.flex_m, [state.stretch]])


def moved(state: RigState, shared: FloatArray, poses: FloatArray) -> RigState:
    """Return a state moved by (S,) and (V, 6): rotations turn on their left."""
    relative = shared[RELATIVE]
    return RigState(
        camera=state.camera + shared[CAMERA],
        projector=state.projector + shared[PROJECTOR],
        projector_rotation=_turn(relative[:3]) @ state.projector_rotation,
        projector_translation_m=state.projector_translation_m + relative[3:],
        flex_m=state.flex_m + shared[BEND],
        stretch=state.stretch + float(shared[STRETCH][0]),
        rotations=np.stack([_turn(pose[:3]) for pose in poses]) @ state.rotations,
        translations_m=state.translations_m + poses[:, 3:],
    )


def _turn(vector: FloatArray) -> FloatArray:
    return np.asarray(cv2.Rodrigues(vector.reshape(3, 1))[0])


@dataclass(frozen=True, eq=False, kw_only=True)
class Bundle:
    """Where a fit ended."""

    state: RigState
    residual: FloatArray
    """(N, d) modelled minus seen. [px]"""
    cost: float


@dataclass(frozen=True, eq=False, kw_only=True)
class _Loss:
    """What is made small: residuals, and how far unknowns are from what was known of them."""

    weight: FloatArray
    """(N, devices)"""
    scales_px: FloatArray | None
    prior: FloatArray
    """(S,)"""

    def at(self, sightings: BoardSightings, state: RigState) -> float:
        squares = self.weight * (by_device(residuals(sightings, state)) ** 2).sum(axis=2)
        if self.scales_px is not None:
            squares = self.scales_px**2 * np.log1p(squares / self.scales_px**2)
        return float(squares.sum()) + float((self.prior * shared_values(state) ** 2).sum())

    def weight_at(self, residual: FloatArray) -> FloatArray:
        """(N, devices) weights of squares whose sum has the slope of the loss."""
        if self.scales_px is None:
            return self.weight
        squares = self.weight * (by_device(residual) ** 2).sum(axis=2)
        return np.asarray(self.weight / (1 + squares / self.scales_px**2))


def adjust_bundle(
    sightings: BoardSightings,
    start: RigState,
    free: BoolArray,
    *,
    prior: FloatArray | None = None,
    scales_px: FloatArray | None = None,
    steps: int = 60,
    least_gain: float = LEAST_GAIN,
) -> Bundle:
    """Minimise the weighted residuals by Levenberg and Marquardt's method.

    Parameters
    ----------
    sightings : BoardSightings
        Rows in the order of their views.
    start : RigState
        All points in front of both devices.
    free : (S,) bool
        Shared unknowns that may move; poses always do.
    prior : (S,), optional
        Inverse variances of the shared unknowns about zero, in units of the noise; default: nothing is known of them.
    scales_px : (devices,), optional
        Cauchy's loss with these scales instead of squares: s² log(1 + r²/s²).
    steps : int
        At most.
    least_gain : float
        Share of the cost that a step has to gain, or it is the last.

    Returns
    -------
    Bundle
    """
    state, damping = start, 1e-4
    loss = _Loss(
        weight=weights_of(sightings), scales_px=scales_px, prior=np.zeros(SHARED) if prior is None else prior * free
    )
    cost = loss.at(sightings, state)
    for _ in range(steps):
        lines = only(linearise(sightings, state), free)
        known = loss.prior[free], shared_values(state)[free]
        weight = loss.weight_at(lines.residual)
        equations = normal_equations(lines, weight, sightings.view, sightings.views, known=known)
        state, damping, gain = _improved(sightings, state, equations, free=free, damping=damping, cost=cost, loss=loss)
        cost -= gain
        if gain <= least_gain * cost:
            break
    return Bundle(state=state, residual=residuals(sightings, state), cost=cost)


def _improved(
    sightings: BoardSightings,
    state: RigState,
    equations: NormalEquations,
    *,
    free: BoolArray,
    damping: float,
    cost: float,
    loss: _Loss,
) -> tuple[RigState, float, float]:
    """First damped step that lowers the cost: the state, the next damping, the gain; a gain of 0 when there is none."""
    while damping < _LARGEST_DAMPING:
        part, poses = _step(equations, damping)
        shared = np.zeros(SHARED)
        shared[free] = -part
        trial = moved(state, shared, -poses)
        gain = cost - loss.at(sightings, trial)
        if np.isfinite(gain) and gain > 0:
            return trial, max(damping / 10, 1e-12), gain
        damping *= 10
    return state, damping, 0.0
