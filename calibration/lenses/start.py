"""Where a bundle adjustment begins: lenses guessed, poses from homographies, a projector from points in space."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.linalg import rq

from calibration.arrays import FloatArray, IntArray
from calibration.errors import CalibrationError
from calibration.lenses.bundle import camera_points, row_slices
from calibration.lenses.lens import N, ideal_coordinates, project_points
from calibration.lenses.records import FLEX, BoardSightings, RigState

_FOCAL_SHARES = (0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 3.0, 4.5)
"""Of the picture's longer side: fields of view from 127 to 13 degrees, a step apart that any fit bridges."""
_STEEPEST = 4.0
"""Tangent from the axis up to which the equidistant guess is fitted: 76 degrees."""
_LEAST_CORNERS = 6
"""Of a view: its pose and a residual to judge it by."""
_UNLIKE = 0.1
"""Of the extent of all corners in the projector's picture: a lens without distortion misses those of one with it by
0.03."""
_PAIRS = 60
"""Of views that are tried where some do not belong: with a third of them wrong one in two is right."""
_FLAT = 1e-3
"""Of points in space: their thinnest extent against their widest, below which they are one plane to a projector."""


@dataclass(frozen=True, eq=False)
class Guess:
    """A guessed camera lens, the poses that follow, and how badly they fit."""

    lens: FloatArray
    """(12,)"""
    state: RigState
    miss_px: float
    """Median over views of the RMS residual."""


def _equidistant_terms() -> FloatArray:
    """(8,) terms of the rational model that imitate a lens whose picture grows with the angle."""
    r = np.linspace(0.01, _STEEPEST, 400)
    ratio, r2 = np.arctan(r) / r, r * r
    columns = [r2, r2**2, r2**3, -ratio * r2, -ratio * r2**2, -ratio * r2**3]
    solved = np.linalg.lstsq(np.column_stack(columns), ratio - 1, rcond=None)[0]
    return np.array([solved[0], solved[1], 0.0, 0.0, solved[2], *solved[3:]])


def camera_guesses(sightings: BoardSightings, size_px: tuple[int, int], *, wide: bool) -> list[Guess]:
    """Lenses of all usual fields of view with the poses that follow, the best first.

    Parameters
    ----------
    sightings : BoardSightings
        Of the camera; rows in the order of their views.
    size_px : (width, height)
        Of the picture.
    wide : bool
        Also lenses whose picture grows with the angle from the axis, not with its tangent.

    Returns
    -------
    list of Guess
    """
    bends = [np.zeros(8), _equidistant_terms()] if wide else [np.zeros(8)]
    lenses = [_lens_of(share * max(size_px), size_px, bend) for bend in bends for share in _FOCAL_SHARES]
    return sorted((guess_poses(sightings, lens) for lens in lenses), key=lambda guess: guess.miss_px)


def _lens_of(focal_px: float, size_px: tuple[int, int], bend: FloatArray) -> FloatArray:
    middle = (np.array(size_px) - 1) / 2
    return np.concatenate([[focal_px, focal_px], middle, bend])


def guess_poses(sightings: BoardSightings, lens: FloatArray) -> Guess:
    """Pose of every view for a given lens, from the homography between the board and ideal coordinates.

    Raises
    ------
    CalibrationError
        A view has too few corners.
    """
    ideal, there = ideal_coordinates(lens, sightings.camera_xy_px)
    there &= (sightings.camera_weight > 0) & np.isfinite(ideal).all(axis=1)
    rotations, translations, misses = [], [], []
    for _, rows in row_slices(sightings.view, sightings.views):
        good = np.flatnonzero(there[rows]) + rows.start
        rotation, translation = _pose(sightings.board_m[good], ideal[good])
        seen = sightings.board_m[good] @ rotation[:, :2].T + translation
        apart = project_points(lens, seen) - sightings.camera_xy_px[good]
        lost = (rows.stop - rows.start) / max(len(good), 1)
        rotations.append(rotation)
        translations.append(translation)
        misses.append(lost * float(np.sqrt((apart**2).sum(axis=1).mean())) if len(good) else np.inf)
    return Guess(lens, _alone(lens, np.stack(rotations), np.stack(translations)), float(np.median(misses)))


def _alone(lens: FloatArray, rotations: FloatArray, translations: FloatArray) -> RigState:
    return RigState(
        camera=lens,
        projector=_lens_of(1.0, (1, 1), np.zeros(N - 4)),
        projector_rotation=np.eye(3),
        projector_translation_m=np.zeros(3),
        flex_m=np.zeros(FLEX),
        rotations=rotations,
        translations_m=translations,
    )


def _pose(board_m: FloatArray, ideal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotation and translation camera_from_board; one metre before the camera when there are too few corners."""
    if len(board_m) < 4:
        return np.eye(3), np.array([0.0, 0.0, 1.0])
    h = homography(board_m, ideal)
    first, second, third = h.T
    scale = 2 / max(float(np.linalg.norm(first) + np.linalg.norm(second)), 1e-12)
    middle = board_m.mean(axis=0)
    sign = 1.0 if (h @ np.array([*middle, 1.0]))[2] > 0 else -1.0
    a, b = sign * scale * first, sign * scale * second
    left, _, right = np.linalg.svd(np.column_stack([a, b, np.cross(a, b)]))
    rotation = left @ np.diag([1.0, 1.0, float(np.sign(np.linalg.det(left @ right)))]) @ right
    translation = sign * scale * third
    if translation[2] <= 0:
        translation[2] = abs(translation[2]) + 1e-3
    return rotation, translation


def homography(source: FloatArray, target: FloatArray) -> FloatArray:
    """(3, 3) homography that takes points (N, 2) to points (N, 2), N ≥ 4, in the least-squares sense.

    The direct linear transform on centred and scaled points: R. Hartley, In defense of the eight-point algorithm, 1997.
    """
    (a, ta), (b, tb) = _normalised(source), _normalised(target)
    ones, none = np.ones(len(a)), np.zeros((len(a), 3))
    points = np.column_stack([a, ones])
    rows = np.concatenate(
        [np.hstack([points, none, -b[:, :1] * points]), np.hstack([none, points, -b[:, 1:] * points])]
    )
    h = np.linalg.svd(rows, full_matrices=False)[2][-1].reshape(3, 3)
    return np.asarray(np.linalg.inv(tb) @ h @ ta)


def _normalised(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points moved to mean 0 and spread 1, and the (d + 1, d + 1) transform that does it."""
    d = points.shape[1]
    middle = points.mean(axis=0)
    spread = max(float(np.sqrt(((points - middle) ** 2).mean())), 1e-12)
    transform = np.eye(d + 1) / spread
    transform[:d, d] = -middle / spread
    transform[d, d] = 1
    return (points - middle) / spread, transform


def with_projector(sightings: BoardSightings, state: RigState) -> RigState:
    """Return the state with a projector found from corners in space: any principal point, no start needed.

    The direct linear transform of the corners in the camera's frame to the projector's pixels, taken apart into
    lens and pose: R. Hartley and A. Zisserman, Multiple View Geometry, 2nd edition, chapter 7. Where some views do not
    belong to the others it is that of the two views that most others agree with, and of these.

    Raises
    ------
    CalibrationError
        The corners lie in one plane: a single view, or one pose of the board again and again. Or fewer than half of the
        views agree on any projector.
    """
    lit = _Lit.of(sightings, state)
    _refuse_flat(lit.points_m)
    p = _projector_matrix(lit)
    if not _lights(p, lit):
        p = _of_most_views(lit)
    return _taken_apart(p, state)


@dataclass(frozen=True, eq=False)
class _Lit:
    """Corners that the projector lights: of which view, where in the camera's frame, at which of its pixels."""

    view: IntArray
    points_m: FloatArray
    xy_px: FloatArray

    @classmethod
    def of(cls, sightings: BoardSightings, state: RigState) -> _Lit:
        lit = sightings.projector_weight > 0
        return cls(sightings.view[lit], camera_points(sightings, state)[lit], sightings.projector_xy_px[lit])

    def of_views(self, views: IntArray) -> _Lit:
        these = np.isin(self.view, views)
        return _Lit(self.view[these], self.points_m[these], self.xy_px[these])

    @property
    def extent_px(self) -> float:
        return float(np.sqrt(((self.xy_px - self.xy_px.mean(axis=0)) ** 2).sum(axis=1).mean()))


def _projector_matrix(lit: _Lit) -> FloatArray:
    """(3, 4) matrix that takes points to pixels, up to a factor."""
    (a, ta), (b, tb) = _normalised(lit.points_m), _normalised(lit.xy_px)
    rows = np.column_stack([a, np.ones(len(a))])
    none = np.zeros_like(rows)
    system = np.concatenate([np.hstack([rows, none, -b[:, :1] * rows]), np.hstack([none, rows, -b[:, 1:] * rows])])
    return np.asarray(np.linalg.inv(tb) @ np.linalg.svd(system, full_matrices=False)[2][-1].reshape(3, 4) @ ta)


def _misses_px(p: FloatArray, lit: _Lit) -> FloatArray:
    """(n,) distance of each pixel from where the matrix has it, infinite behind the projector."""
    there = lit.points_m @ p[:, :3].T + p[:, 3]
    ahead = there[:, 2] * float(np.sign(np.linalg.det(p[:, :3]))) > 0
    depth = np.where(ahead, there[:, 2], 1.0)
    return np.where(ahead, np.linalg.norm(there[:, :2] / depth[:, None] - lit.xy_px, axis=1), np.inf)


def _lights(p: FloatArray, lit: _Lit) -> bool:
    return bool(np.median(_misses_px(p, lit)) <= _UNLIKE * lit.extent_px)


def _of_most_views(lit: _Lit) -> FloatArray:
    """Matrix of the views that agree best on one."""
    views = np.unique(lit.view)
    pairs = np.array(list(combinations(views, 2)))
    if len(pairs) > _PAIRS:
        pairs = np.random.default_rng(0).permutation(pairs)[:_PAIRS]

    def agreeing(pair: IntArray) -> IntArray:
        misses = _misses_px(_projector_matrix(lit.of_views(pair)), lit)
        medians = [float(np.median(misses[lit.view == view])) for view in views]
        return np.asarray(views[np.array(medians) <= _UNLIKE * lit.extent_px])

    best = max((agreeing(pair) for pair in pairs), key=len)
    p = _projector_matrix(lit.of_views(best if len(best) > 1 else views))
    if len(best) <= max(len(views) / 2, 2) or not _lights(p, lit.of_views(best)):
        raise CalibrationError(
            f"no projector lights the boards so: the best one explains {len(best)} of {len(views)} views, more than "
            "half and at least three are needed. The projector's pixels of some views belong to other views, or camera "
            "or projector was moved between them; mend the list, or take the views again with both standing still"
        )
    return p


def _taken_apart(p: FloatArray, state: RigState) -> RigState:
    p = p * float(np.sign(np.linalg.det(p[:, :3])))
    k, rotation = rq(p[:, :3])
    signs = np.diag(np.sign(np.diag(k)))
    k, rotation = k @ signs, signs @ rotation
    translation = np.linalg.solve(k, p[:, 3])
    k = k / k[2, 2]
    lens = np.concatenate([[k[0, 0], k[1, 1], k[0, 2], k[1, 2]], np.zeros(N - 4)])
    return replace(state, projector=lens, projector_rotation=rotation, projector_translation_m=translation)


def _refuse_flat(points: FloatArray) -> None:
    extent = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if extent[2] < _FLAT * extent[0]:
        raise CalibrationError(
            f"all corners that the projector lights lie in one plane (thickness {extent[2] / extent[0]:.1e} of the "
            f"width, at least {_FLAT:g} is needed): its lens is not determined; add poses of the board that are "
            "tilted and nearer or farther"
        )


def moved_projector(state: RigState, shift_px: tuple[float, float], focal_factor: float) -> RigState:
    """Return another start: principal point and focal length of the projector changed, its axis turned to fit."""
    lens = state.projector.copy()
    old = np.array([[lens[0], 0, lens[2]], [0, lens[1], lens[3]], [0, 0, 1]])
    lens[:2] *= focal_factor
    lens[2:4] += shift_px
    lens[4:] = 0
    new = np.array([[lens[0], 0, lens[2]], [0, lens[1], lens[3]], [0, 0, 1]])
    left, _, right = np.linalg.svd(np.linalg.solve(new, old) @ state.projector_rotation)
    rotation = left @ np.diag([1.0, 1.0, float(np.sign(np.linalg.det(left @ right)))]) @ right
    turn = rotation @ state.projector_rotation.T
    translation = turn @ state.projector_translation_m
    return replace(state, projector=lens, projector_rotation=rotation, projector_translation_m=translation)
