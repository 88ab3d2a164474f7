"""A wall of which two walls' pictures show a strip: too few points for the search, which knows no axis.

Two walls at right angles leave focal lengths and distances in a bent valley, and the floor unknown. The third direction
is theirs; a strip of a wall across it has one unknown, so that a few hundred pixels tell it, and it closes the valley.

Where all three are known, a plane that others reach beyond is no wall of the room, but a partition in it: then the wall
is looked for behind it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from calibration.arrays import FloatArray, IntArray
from calibration.errors import CalibrationError
from calibration.geometry.bundle_residual import rays_of
from calibration.geometry.bundle_unknowns import PlanarScene
from calibration.geometry.contradictions import hold_against_all
from calibration.geometry.known.nominal import NominalIntrinsics
from calibration.geometry.plane_bundle import BundleSolution, Rounds, adjust, transfer_of
from calibration.geometry.support import explained_within_px, plane_errors_px, side_by_side
from calibration.geometry.triangulation import triangulate

_REACHED = 4.0
"""Times the limit within which a wall explains a point: before the valley is closed, the third direction is off by up
to a degree or two, and a strip is short."""
_LEAST_POINTS, _LEAST_SHARE = 100, 0.0003
"""Side by side in the picture, and of the points: a strip of one pixel along a third of the picture."""
_MOST_OF_STRIP = 0.7
"""Of the strip's points: what fewer of them lie on in the end is no wall."""
_CANDIDATES = 60
"""Offsets that are tried: the strip's own points, evenly."""
_MOST_BEYOND = 0.01
"""Share of the walls' points that may lie beyond a wall that closes the room: wrong codes."""
_MOST_TAKEN, _LEAST_TAKEN = 100, 30
"""Points of the strip beside the ten thousand of all, and on it in the end: in a strip the errors of all points go
together, so that more would only count for more."""
_BEYOND = 1.02
"""Of the wall's distance: while it is tilted, what lies beyond it by less is its own edge."""
_ITERATIONS = 12
_EDGE_PX = 6.0
"""Camera pixels from an edge of the room, nearer than which windows of 9 px and blur mix two walls."""
_NO_MARGIN = 0.0
"""Edges are left out by where they are: with a short baseline two walls predict a whole strip within four pixels."""


@dataclass(frozen=True, eq=False)
class WeighedPoints:
    """Correspondences in an order drawn by chance."""

    camera_xy_px: FloatArray
    """(N, 2) [px]"""
    projector_xy_px: FloatArray
    """(N, 2) [px]"""
    weight: FloatArray
    """(N, 2) by which each coordinate of the projector counts."""

    def chosen(self, rows: IntArray | slice) -> WeighedPoints:
        """Return some of the points."""
        return WeighedPoints(self.camera_xy_px[rows], self.projector_xy_px[rows], self.weight[rows])


def weights_of(sigma_px: FloatArray | None, order: IntArray, *, usual_of: int) -> FloatArray:
    """Return (N, 2) by which residuals count, so that uncertain ones come to the scatter of those of the better half.

    Where a stripe's edge falls on the same place of many neighbouring camera pixels, their codes are rounded alike, and
    no window averages that out: a tenth of a picture may be off by five times the noise of the rest, in waves.

    Parameters
    ----------
    sigma_px : (M, 2), optional
        Standard deviations of all coordinates; None: all count alike. [px]
    order : (N,)
        Rows that are wanted.
    usual_of : int
        So many of the first tell what is usual.
    """
    if sigma_px is None:
        return np.ones((len(order), 2))
    usual = float(np.nanmedian(sigma_px[order[:usual_of]].min(axis=1)))
    return np.asarray(usual / np.fmax(sigma_px[order], usual))


@dataclass(frozen=True, eq=False)
class RestingOn:
    """A fit, and the points that it is of, as flat walls would have them."""

    solution: BundleSolution
    points: WeighedPoints


def with_third_wall(
    fit: BundleSolution, points: WeighedPoints, nominal: NominalIntrinsics, *, n_fitted: int
) -> RestingOn:
    """Add the wall that a strip of points lies on: across a third direction, or behind a plane that does not close.

    Parameters
    ----------
    fit : BundleSolution
        To the first `n_fitted` points.
    points : WeighedPoints
        All that there are.
    nominal : NominalIntrinsics
        Of both lenses.
    n_fitted : int
        Points that a fit rests on, the strip's beside them.

    Returns
    -------
    RestingOn
        The fit that was given, where there is no such strip or its wall contradicts something.
    """
    points = replace(points, projector_xy_px=fit.straightened(points.camera_xy_px, points.projector_xy_px))
    fitted = points.chosen(slice(0, n_fitted))
    found = _strip(fit, points)
    if found is None:
        return RestingOn(fit, fitted)
    rows, start, limit_px = found.rows, found.scene, found.limit_px
    more = rows[rows >= n_fitted][:_MOST_TAKEN]
    together = np.random.default_rng(0).permutation(np.concatenate([np.arange(len(fitted.weight)), more]))
    chosen = points.chosen(together)
    a, b, weight = chosen.camera_xy_px, chosen.projector_xy_px, chosen.weight
    rounds = Rounds(limits_px=(_REACHED * limit_px, 1.5), iterations=_ITERATIONS, margin_share=_NO_MARGIN)
    rough = adjust(a, b, start, nominal, rounds=rounds, weight=weight)
    if rough is None:
        return RestingOn(fit, fitted)
    away = _away_from_edges(rough, a) if found.closes_box else _away_from_others(rough, points, a, limit_px)
    a, b, weight = a[away], b[away], weight[away]
    try:
        closed = hold_against_all(a, b, rough, nominal, weight=weight, margin_share=_NO_MARGIN)
    except CalibrationError:
        return RestingOn(fit, fitted)
    on_it = (closed.label == len(fit.planes))[np.isin(together[away], rows)]
    if on_it.size < _LEAST_TAKEN or on_it.mean() < _MOST_OF_STRIP:
        return RestingOn(fit, fitted)
    # The points are straight already: what their walls bow by, they no longer tell.
    return RestingOn(replace(closed, bows=fit.bows or closed.bows), chosen.chosen(away))


def _away_from_edges(scene: PlanarScene, camera_xy_px: FloatArray) -> IntArray:
    """Rows of the points of which no second wall is near in the camera's picture."""
    rays, focal_px = rays_of(scene.camera, camera_xy_px), scene.camera.focal_px[0]
    own = scene.planes[(rays @ scene.planes.T).argmax(axis=1)]
    far = np.ones(len(rays), dtype=bool)
    for other in scene.planes:
        between = own - other
        slope = np.linalg.norm(between[:, :2], axis=1)
        far &= (slope == 0) | (focal_px * np.abs((rays * between).sum(axis=1)) > _EDGE_PX * slope)
    return np.flatnonzero(far)


def _away_from_others(scene: PlanarScene, points: WeighedPoints, camera_xy_px: FloatArray, limit_px: float) -> IntArray:
    """Rows of the points around which all lie on their plane: the first plane on a ray need not be the one seen."""
    errors = plane_errors_px(scene, points.camera_xy_px, points.projector_xy_px)
    name = np.where(errors.min(axis=0) < _REACHED * limit_px, errors.argmin(axis=0) + 1, len(errors) + 1)
    column, row = np.rint(points.camera_xy_px).astype(np.int64).T
    lowest, highest = (np.full((row.max() + 1, column.max() + 1), value, np.uint8) for value in (255, 0))
    lowest[row, column] = highest[row, column] = name
    window = np.ones((2 * int(_EDGE_PX) + 1,) * 2, np.uint8)
    alike = cv2.erode(lowest, window) == cv2.dilate(highest, window)
    column, row = np.rint(camera_xy_px).astype(np.int64).T
    return np.flatnonzero(alike[row, column])


@dataclass(frozen=True, eq=False)
class _WallStrip:
    """Points that no wall explains, and a wall that does."""

    rows: IntArray
    scene: PlanarScene
    """With its wall, the last."""
    limit_px: float
    """Within which a wall explains a point."""
    closes_box: bool
    """All walls bound one box, so that the first on a ray is the one seen."""


def _strip(fit: BundleSolution, points: WeighedPoints) -> _WallStrip | None:
    """The strip with the wall that is missing; None if there is none."""
    wanted = _wanted_wall(fit, points)
    if wanted is None:
        return None
    axis, before = wanted
    x1, x2 = points.camera_xy_px, points.projector_xy_px
    best = plane_errors_px(fit, x1, x2).min(axis=0)
    limit_px = explained_within_px(best)
    rows = np.flatnonzero(best > limit_px)
    left, enough = points.chosen(rows), max(_LEAST_POINTS, _LEAST_SHARE * len(best))
    plane = _likeliest(fit, left, axis, _REACHED * limit_px, before=before) if len(rows) >= enough else None
    if plane is None:
        return None
    own = np.zeros(len(best), dtype=bool)
    own[rows] = _errors_px(fit, left, plane) < _REACHED * limit_px
    if side_by_side(x1, own) < enough or not _closes(fit, points.chosen(np.flatnonzero(best <= limit_px)), plane):
        return None
    axes = replace(fit.axes, of_plane=np.append(fit.axes.of_plane, axis))
    scene = fit.with_planes(np.vstack([fit.planes, plane]), axes)
    return _WallStrip(np.flatnonzero(own), scene, limit_px, closes_box=before is None)


def _errors_px(fit: BundleSolution, points: WeighedPoints, plane: FloatArray) -> FloatArray:
    there = transfer_of(fit.projector)(rays_of(fit.camera, points.camera_xy_px), plane)
    return np.asarray(np.linalg.norm(there - points.projector_xy_px, axis=1))


def _wanted_wall(fit: BundleSolution, points: WeighedPoints) -> tuple[int, FloatArray | None] | None:
    """The axis across which a wall is missing, and the plane behind which it stands, if any; None where none is.

    Of several planes that others reach beyond it is the first, which has most points.
    """
    known = set(fit.axes.of_plane.tolist()) - {-1}
    if len(known) == 2:
        return next(iter({0, 1, 2} - known)), None
    if len(known) < 2:
        return None
    on_walls = points.chosen(slice(0, len(fit.label)))
    for plane, axis in zip(fit.planes, fit.axes.of_plane, strict=True):
        if axis >= 0 and not _closes(fit, on_walls, plane) and not _is_behind_one(fit, plane, int(axis)):
            return int(axis), plane
    return None


def _is_behind_one(fit: BundleSolution, plane: FloatArray, axis: int) -> bool:
    """Tell whether another plane across the same axis stands further away on the same side."""
    others = fit.planes[(fit.axes.of_plane == axis) & (fit.planes @ plane > 0)]
    return bool((np.linalg.norm(others, axis=1) < np.linalg.norm(plane) / _BEYOND).any())


def _likeliest(
    fit: BundleSolution, left: WeighedPoints, axis: int, reached_px: float, *, before: FloatArray | None
) -> FloatArray | None:
    """(3,) the plane across an axis that explains most of some points, behind one or anywhere, as normal / offset."""
    seen = triangulate(left.camera_xy_px, left.projector_xy_px, *fit.devices)
    there = seen.in_front if before is None else seen.in_front & (seen.points_m @ before > _BEYOND)
    if not there.any():
        return None
    direction = fit.axes.directions[axis]
    offsets = np.quantile(seen.points_m[there] @ direction, np.linspace(0, 1, _CANDIDATES))
    planes = [direction / offset for offset in offsets if offset]
    return max(planes, key=lambda plane: int((_errors_px(fit, left, plane) < reached_px).sum()), default=None)


def _closes(fit: BundleSolution, on_walls: WeighedPoints, plane: FloatArray) -> bool:
    """Tell whether all that is known of the walls lies before a plane, as before a floor, and unlike before a table."""
    some = on_walls.chosen(slice(0, len(fit.label)))
    seen = triangulate(some.camera_xy_px, some.projector_xy_px, *fit.devices)
    beyond = seen.points_m[seen.in_front] @ plane > _BEYOND
    return bool(beyond.sum() < _MOST_BEYOND * len(beyond)) and bool(fit.projector.position_m @ plane < 1)
