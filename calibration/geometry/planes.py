"""Flat walls in a point cloud: found by what they do to the picture, so that every limit is in pixels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, product

import numpy as np

from calibration.arrays import BoolArray, FloatArray, IntArray

Transfer = Callable[[FloatArray, FloatArray], FloatArray]
"""(camera rays (N, 3), plane (3,) or (N, 3)) → projector pixels (N, 2) if the points lay on the plane n · x = 1."""

INLIER_PX = 1.5
"""Three times the half pixel by which whole codes are off."""
_TRIALS = 400
"""Of RANSAC: a wall with 5 % of the points is drawn twenty times."""
_SAMPLE = 12
"""Points of a trial: a plane through twelve neighbours is steady against their noise."""
_TESTED = 800
"""Points that a trial is counted on: enough to tell 2 % from nothing."""
_AT_ONCE = 40
"""Trials that are counted together: their arrays stay within a processor's second cache."""
_NEIGHBOURHOODS = (0.125, 0.5)
"""Half sides of the camera's windows that trials draw from in turn, as shares of the points' longer extent. An eighth
is mostly one wall: from windows of half a picture, of which columns stood before two walls, twelve points on one wall
were hardly ever drawn, and planes across columns and walls won. Half a picture steadies planes against noise."""
_LEAST_SHARE, _LEAST_POINTS = 0.02, 30
"""Of the points, and points, that make a wall; less is furniture or noise."""
USUAL_ASKEW_DEG = 0.3
"""By which walls of houses stand off square, one standard deviation: 5 mm in a metre, where DIN 18202 allows 8 mm
in one to three."""
_MOST_PLANES = 8
"""A box has six; two more for a step or a cupboard."""
_REFINEMENTS = 4
"""Rounds of least squares over the inliers; they no longer change after three."""
_MOST_GUESSED = 2
"""Walls that are tried on every axis: each multiplies the fits by four."""
_ASKEW_DEG = 10.0
"""Between two planes on one axis: in random world 7702, with lenses by data sheets, floor and ceiling were 2.6 apart,
a wall and a panel before it 28."""
_PARALLEL = 0.6
"""Cosine from which on a normal is taken to be another face of the second axis."""
_NEVER_DEG = 70.0
"""A plane whose normal is so far from an axis with planes is not one of them, however wrong the lenses are."""
_FACING = np.cos(np.radians(8.0))
"""Cosine to which two planes may also be the walls of a corner: lenses as held at first showed one at 156 degrees."""


@dataclass(frozen=True, eq=False)
class Axes:
    """The directions of a box-like room, and which of them each plane is perpendicular to."""

    directions: FloatArray
    """(3, 3) orthonormal rows."""
    of_plane: IntArray
    """(K,) 0, 1, 2, or -1 for a plane that fits none."""
    askew_rad: float = 0.0
    """By which planes on an axis stand off square, one standard deviation of each of a plane's two tilts; 0: by
    nothing."""

    @cached_property
    def turns_freely(self) -> BoolArray:
        """(K,) planes that are not exactly perpendicular to an axis."""
        return np.asarray((self.of_plane < 0) | (self.askew_rad > 0))


@dataclass(frozen=True, eq=False)
class ViewedPoints:
    """Triangulated points with what they were seen by, one row each."""

    points: FloatArray
    """(N, 3) in the camera's frame; the unit is the baseline."""
    rays: FloatArray
    """(N, 3) directions of the camera's pixels."""
    camera_xy_px: FloatArray
    """(N, 2) [px]"""
    projector_xy_px: FloatArray
    """(N, 2) [px]"""

    def chosen(self, rows: IntArray) -> ViewedPoints:
        """Return some of the points."""
        return ViewedPoints(self.points[rows], self.rays[rows], self.camera_xy_px[rows], self.projector_xy_px[rows])

    def error_px(self, transfer: Transfer, plane: FloatArray) -> FloatArray:
        """(N,) distance of each point's projector pixel from where the plane would have it. [px]."""
        return np.asarray(np.linalg.norm(transfer(self.rays, plane) - self.projector_xy_px, axis=1))


def segment_planes(
    seen: ViewedPoints, transfer: Transfer, usable: BoolArray, limit_px: float = INLIER_PX
) -> FloatArray:
    """Find flat walls one after the other, by sequential RANSAC with a fixed seed.

    Neighbouring points (in the camera's picture) make a plane; its points are those whose correspondence it
    predicts to within the limit. Planes with less than 2 % of the points are left out.

    Parameters
    ----------
    seen : ViewedPoints
        N points.
    transfer : Transfer
        From the camera's rays to the projector by a plane.
    usable : (N,) bool
        Points that lie in front of both devices.
    limit_px : float
        1.5 px, or less where lenses and noise are known better.

    Returns
    -------
    (K, 3)
        Planes as normal / offset, the one with most points first.

    References
    ----------
    M. A. Fischler and R. C. Bolles, Random sample consensus, Commun. ACM 24(6), 1981.
    """
    random = np.random.default_rng(1)
    left = np.flatnonzero(usable)
    planes: list[FloatArray] = []
    enough = max(_LEAST_SHARE * len(left), _LEAST_POINTS)
    while len(planes) < _MOST_PLANES and len(left) >= enough:
        here = seen.chosen(left)
        best = _best_plane(here, transfer, random, limit_px)
        if best is None:
            break
        error = here.error_px(transfer, best)
        if (error < limit_px).sum() < enough:
            break
        planes.append(best)
        # What lies close to the plane, too, so that its rim is not found again as another plane.
        left = left[error > 3 * limit_px]
    return np.array(planes).reshape(-1, 3)


def _best_plane(
    seen: ViewedPoints, transfer: Transfer, random: np.random.Generator, limit_px: float
) -> FloatArray | None:
    test = seen.chosen(random.permutation(len(seen.points))[:_TESTED])
    trials = _trial_planes(seen, random)
    counts = _explained_counts(test, transfer, trials, limit_px)
    if not counts.any():
        return None
    best: FloatArray = trials[int(counts.argmax())]
    for _ in range(_REFINEMENTS):
        inside = seen.error_px(transfer, best) < limit_px
        refined = _plane_through(seen.points[inside]) if inside.sum() >= 3 else None
        if refined is None:
            break
        best = refined
    return np.asarray(best)


def _explained_counts(test: ViewedPoints, transfer: Transfer, planes: FloatArray, limit_px: float) -> IntArray:
    """(K,) how many of the points each plane explains."""
    counts = np.zeros(len(planes), dtype=np.int64)
    for first in range(0, len(planes), _AT_ONCE):
        some = planes[first : first + _AT_ONCE]
        landed = transfer(np.tile(test.rays, (len(some), 1)), np.repeat(some, len(test.rays), axis=0))
        error = landed.reshape(len(some), -1, 2) - test.projector_xy_px
        counts[first : first + _AT_ONCE] = (np.linalg.norm(error, axis=2) < limit_px).sum(axis=1)
    return counts


def _trial_planes(seen: ViewedPoints, random: np.random.Generator) -> FloatArray:
    """(K, 3) planes, each through some points around one that is drawn; none where too few lie around it."""
    x, y = np.ascontiguousarray(seen.camera_xy_px.T)
    reaches_px = np.multiply(_NEIGHBOURHOODS, max(np.ptp(x), np.ptp(y)))
    rows, weight = np.zeros((_TRIALS, _SAMPLE), dtype=np.int64), np.zeros((_TRIALS, _SAMPLE))
    for k in range(_TRIALS):
        first, reach_px = int(random.integers(len(x))), reaches_px[k % len(reaches_px)]
        near = np.flatnonzero((np.abs(x - x[first]) < reach_px) & (np.abs(y - y[first]) < reach_px))
        if len(near) >= 3:
            count = min(_SAMPLE, len(near))
            rows[k, :count], weight[k, :count] = random.choice(near, size=count, replace=False), 1.0
    return _planes_through(seen.points[rows], weight)


def _planes_through(points: FloatArray, weight: FloatArray) -> FloatArray:
    """(K, 3) least squares of n · x = 1 by points (M, S, 3), each weighted by 1 / distance² (its depth error grows so).

    Points that do not span a plane make none.
    """
    weight = weight / np.maximum((points**2).sum(axis=2), 1e-12)
    u, s, vt = np.linalg.svd(points * weight[..., None], full_matrices=False)
    spans = s[:, -1] > np.finfo(np.float64).eps * points.shape[1] * s[:, 0]
    u, s, vt, weight = u[spans], s[spans], vt[spans], weight[spans]
    along = (weight[:, None, :] @ u)[:, 0] / s
    return np.asarray((along[:, None, :] @ vt)[:, 0])


def _plane_through(points: FloatArray) -> FloatArray | None:
    """(3,) the plane of some points; None where they span none."""
    found = _planes_through(points[None], np.ones((1, len(points))))
    return np.asarray(found[0]) if len(found) else None


def assign_planes(
    transfer: Transfer,
    rays: FloatArray,
    x2: FloatArray,
    planes: FloatArray,
    *,
    limit_px: float,
    margin_px: float = 0.0,
) -> IntArray:
    """Assign each correspondence to the plane that predicts it best.

    Parameters
    ----------
    transfer : Transfer
        From the camera's rays to the projector by a plane.
    rays : (N, 3)
        Directions of the camera's pixels.
    x2 : (N, 2)
        Projector pixels. [px]
    planes : (K, 3)
        As normal / offset.
    limit_px : float
        Largest distance from where the plane would have the pixel. [px]
    margin_px : float
        Points that a second plane predicts within it belong to none: near an edge of the room blur mixes both walls.

    Returns
    -------
    (N,) int
        Index of the plane, -1 for none.
    """
    errors = np.stack([np.linalg.norm(transfer(rays, plane) - x2, axis=1) for plane in planes])
    good = errors.min(axis=0) <= limit_px
    if len(planes) > 1:
        good &= np.partition(errors, 1, axis=0)[1] > margin_px
    return np.where(good, errors.argmin(axis=0), -1).astype(np.int64)


def axis_hypotheses(planes: FloatArray, axes: Axes) -> list[Axes]:
    """List the axes as they are, and with up to two planes that fit none given to each axis they may belong to.

    Before the lenses are known, walls of a small or narrow view may stand tens of degrees off. On an axis that no other
    plane has, a plane may lie at any angle: a corner's third wall, flattened by rough lenses, stood 83 degrees off.
    """
    normals = planes / np.linalg.norm(planes, axis=1, keepdims=True)
    angle_deg = np.degrees(np.arccos(np.minimum(np.abs(normals @ axes.directions.T), 1.0)))
    unknown = np.flatnonzero(axes.of_plane < 0)[:_MOST_GUESSED]
    is_empty = ~np.isin(np.arange(3), axes.of_plane)
    options = [(-1, *np.flatnonzero((angle_deg[plane] < _NEVER_DEG) | is_empty)) for plane in unknown]
    found = []
    for choice in product(*options):
        of_plane = axes.of_plane.copy()
        of_plane[unknown] = choice
        found.append(replace(axes, of_plane=of_plane))
    return found


def askew_hypotheses(planes: FloatArray, axes: Axes, limit_deg: float = 25.0) -> list[Axes]:
    """List the axes that are left where one of two planes on one axis, which are not parallel, stands as it likes.

    A panel that is turned by less than the limit passes for a wall, and turns the frame half way to itself.
    """
    normals = planes / np.linalg.norm(planes, axis=1, keepdims=True)
    angle_deg = np.degrees(np.arccos(np.minimum(np.abs(normals @ normals.T), 1.0)))
    on_one_axis = (axes.of_plane[:, None] == axes.of_plane) & (axes.of_plane >= 0)
    found = []
    for k in np.flatnonzero((on_one_axis & (angle_deg > _ASKEW_DEG)).any(axis=1)):
        others = np.arange(len(planes)) != k
        square, of_plane = orthogonal_axes(planes[others], limit_deg), np.full(len(planes), -1)
        of_plane[others] = square.of_plane
        found.append(replace(square, of_plane=of_plane))
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
    rest = [n for n in normals[others[1:]] if abs(n @ second) < _PARALLEL] if len(others) > 1 else []
    if rest:
        third = rest[0] * np.sign(rest[0] @ third)
    u, _, vt = np.linalg.svd(np.stack([first, second, third / np.linalg.norm(third)]))
    frame = u @ vt
    if np.linalg.det(frame) < 0:
        frame[2] = -frame[2]
    return Axes(frame, nearest_axes(normals, frame, limit_deg))


def nearest_axes(normals: FloatArray, directions: FloatArray, limit_deg: float) -> IntArray:
    """(K,) which direction each unit normal is nearest to; -1 further than the limit from all."""
    along = np.abs(normals @ directions.T)
    return np.where(along.max(axis=1) > np.cos(np.radians(limit_deg)), along.argmax(axis=1), -1).astype(np.int64)


def corner_axes(planes: FloatArray, axes: Axes) -> list[Axes]:
    """List the axes in which two planes that face each other are the walls of a corner instead.

    With lenses that are some degrees off, a corner opens up to walls that face each other: with a floor in the same
    picture, a box's right angles then hold for both.

    Parameters
    ----------
    planes : (K, 3)
        As normal / offset, in the camera's frame.
    axes : Axes
        Of these planes, with both on one axis.

    Returns
    -------
    list of Axes
        One for each pair of them and each plane on another axis, which stays upright: the corner's edge runs along it,
        and lies straight ahead between both walls.
    """
    normals = planes / np.linalg.norm(planes, axis=1, keepdims=True)
    found = []
    for (i, j), k in product(combinations(range(len(planes)), 2), range(len(planes))):
        axis = axes.of_plane[i]
        pair = axis >= 0 and axis == axes.of_plane[j] and -_FACING < normals[i] @ normals[j] < 0.0
        if pair and axes.of_plane[k] not in (-1, axis):
            found.append(_corner(normals, axes, (i, j), k))
    return found


def _corner(normals: FloatArray, axes: Axes, walls: tuple[int, int], floor: int) -> Axes:
    """The frame in which two walls stand 45 degrees to both sides of straight ahead, and the floor's normal is up."""
    upright = normals[floor]
    between = normals[walls[0]] - normals[walls[1]]
    aside = between - (between @ upright) * upright
    aside /= np.linalg.norm(aside)
    ahead = np.cross(upright, aside)
    ahead *= np.sign(ahead[2]) or 1.0
    of_plane = np.where((axes.of_plane >= 0) & (axes.of_plane == axes.of_plane[floor]), 2, -1)
    of_plane[list(walls)] = 0, 1
    return Axes(np.stack([aside + ahead, ahead - aside, np.sqrt(2.0) * upright]) / np.sqrt(2.0), of_plane)
