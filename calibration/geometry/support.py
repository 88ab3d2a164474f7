"""Which points stand behind each plane: alone, together in the picture, and without a bend."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from calibration.arrays import BoolArray, FloatArray, IntArray
from calibration.geometry.bundle_residual import rays_of
from calibration.geometry.bundle_unknowns import PlanarScene
from calibration.geometry.plane_bundle import BundleSolution, transfer_of

_LIMIT_SCALES, _LEAST_LIMIT_PX, _LARGEST_LIMIT_PX = 4.0, 0.3, 1.5
"""A plane explains a point within four times the median error, which four in a hundred good points exceed."""
_APART = 3.0
"""No other plane explains it: none comes nearer than so many of these limits."""
_LEAST_SHARE, _LEAST_POINTS = 0.02, 30
"""Of the points, and points, that only this plane explains, side by side; less is furniture, noise, or a phantom."""
_WIDER, _MOST_GROWTH = 3.0, 1.35
"""Times the limit, and the points that a wall may explain more then: 1.2 at most of those of simulated rooms."""
LEAST_BEHIND = 0.02
"""Share of the points behind a plane from which on it is no wall: as many as make a wall themselves."""
_BEYOND = 0.05
"""Of the distance to a plane: what is seen so much further away is behind it, whatever a bent lens makes of edges."""
_POINTS_A_CELL = 4.0
_LEAST_KNOWN = 0.2
"""Of the points: where fewer belong to one plane only, planes say nothing of what lies among what."""
_CELLS = 8
"""Squares along the picture's longer side in which a bend is looked for."""
_LEAST_IN_CELL = 12
_STRAY_MEDIANS, _LEAST_BOWED, _QUADRATIC = 4.0, 60, 3
"""Of a bow: points further off than so many medians are strays; ten points a term; x², xy and y²."""


def plane_errors_px(scene: PlanarScene, x1: FloatArray, x2: FloatArray) -> FloatArray:
    """(K, N) distance of each point's projector pixel from where each plane would have it. [px]."""
    rays, transfer = rays_of(scene.camera, x1), transfer_of(scene.projector)
    return np.stack([np.linalg.norm(transfer(rays, plane) - x2, axis=1) for plane in scene.planes])


def standing_planes(scene: PlanarScene, x1: FloatArray, x2: FloatArray) -> BoolArray:
    """Find the planes that stand for points which no other plane explains, and which lie side by side.

    A wall that is found twice, or a plane between two walls, explains points; but others explain them, too, or they
    are scattered. Of several such the one with least goes first, so that of two alike one stays.

    Parameters
    ----------
    scene : PlanarScene
        With K planes.
    x1, x2 : (N, 2)
        Corresponding pixels. [px]

    Returns
    -------
    (K,) bool
        True for planes that stay.
    """
    errors = plane_errors_px(scene, x1, x2)
    standing = np.ones(len(errors), dtype=bool)
    enough = max(_LEAST_SHARE * len(x1), _LEAST_POINTS)
    while standing.any():
        kept = np.flatnonzero(standing)
        counts = [side_by_side(x1, own) for own in exclusive_points(errors[kept])]
        if min(counts) >= enough:
            break
        standing[kept[int(np.argmin(counts))]] = False
    return standing


def bending_planes(scene: PlanarScene, x1: FloatArray, x2: FloatArray) -> BoolArray:
    """Find the planes that touch a surface which goes on, bending: such that explain many more points if they may miss.

    Along a surface that bends evenly, three times the limit takes in 3^½ = 1.7 times as many; a wall ends at an edge.

    Parameters
    ----------
    scene : PlanarScene
        K planes.
    x1, x2 : (N, 2)
        Corresponding pixels of camera and projector. [px]

    Returns
    -------
    (K,) bool
    """
    errors = plane_errors_px(scene, x1, x2)
    return grows(errors, explained_within_px(errors.min(axis=0)))


def grows(errors_px: FloatArray, limit_px: float) -> BoolArray:
    """(K,) whether many more of the errors (K, N) lie within three times the limit than within it."""
    close, near = ((errors_px < times * limit_px).sum(axis=1) for times in (1, _WIDER))
    return np.asarray(near > _MOST_GROWTH * close)


def shares_behind_planes(scene: PlanarScene, x1: FloatArray, x2: FloatArray) -> FloatArray:
    """Tell how much of what only one plane explains is seen behind each of the others, past its edge.

    Behind the wall of a box there is nothing. Lenses that are wrong bend a scene nearly as a projective map does, which
    keeps points on their side of a plane.

    Parameters
    ----------
    scene : PlanarScene
        K planes.
    x1, x2 : (N, 2)
        Corresponding pixels of camera and projector. [px]

    Returns
    -------
    (K,)
        From :data:`LEAST_BEHIND` on a plane stands in the room.
    """
    plane, point = np.nonzero(exclusive_points(plane_errors_px(scene, x1, x2)))
    rays = rays_of(scene.camera, x1[point])
    points = rays / (rays * scene.planes[plane]).sum(axis=1, keepdims=True)
    return shares_behind(scene.planes, points, plane)


def shares_behind(planes: FloatArray, points: FloatArray, plane_of: IntArray) -> FloatArray:
    """(K,) share of the points (N, 3) clearly behind each plane (K, 3) that lie on others, as plane_of (N,) says."""
    beyond = points @ planes.T > 1 + _BEYOND
    beyond &= plane_of[:, None] != np.arange(len(planes))
    return np.asarray(beyond.sum(axis=0) / max(len(points), 1))


def explained_within_px(best_px: FloatArray) -> float:
    """Return the distance within which a plane explains a point, of all points' distances from their nearest (N,)."""
    median_px = float(np.median(best_px)) if len(best_px) else np.inf
    return float(np.clip(_LIMIT_SCALES * median_px, _LEAST_LIMIT_PX, _LARGEST_LIMIT_PX))


def exclusive_points(errors_px: FloatArray) -> BoolArray:
    """(K, N) points that a plane explains and no other comes near to, of errors (K, N)."""
    best = errors_px.min(axis=0)
    limit = explained_within_px(best)
    if len(errors_px) == 1:
        return errors_px <= limit
    second = np.partition(errors_px, 1, axis=0)[1]
    nearest = errors_px.argmin(axis=0)
    alone = (best <= limit) & (second > _APART * limit)
    return np.asarray((nearest[None] == np.arange(len(errors_px))[:, None]) & alone)


def side_by_side(x1: FloatArray, own: BoolArray) -> int:
    """How many of a plane's points lie in one connected piece of the camera's picture."""
    low, high = x1.min(axis=0), x1.max(axis=0)
    side = float(np.sqrt(np.prod(high - low + 1) * _POINTS_A_CELL / len(x1)))
    cell = ((x1 - low) // side).astype(np.int64)
    columns, rows = cell.max(axis=0) + 1
    index = cell[:, 1] * columns + cell[:, 0]
    all_, mine = (np.bincount(index[which], minlength=rows * columns) for which in (slice(None), own))
    filled = ((mine * 2 > all_) & (all_ > 0)).astype(np.uint8).reshape(rows, columns)
    _, piece = cv2.connectedComponents(filled, connectivity=8)
    of_point = np.asarray(piece).ravel()[index[own]]
    return int(np.bincount(of_point[of_point > 0], minlength=1).max())


@dataclass(frozen=True, eq=False, kw_only=True)
class Bends:
    """By how much the points of each plane leave it together, over areas far larger than a point's noise reaches."""

    bend_px: FloatArray
    """(K,) root mean square over the areas. [px]"""
    bow_px: FloatArray
    """(K,) root mean square of the parabola through the points' errors, what chance explains taken off. [px]"""
    noise_px: FloatArray
    """(K,) of single points. [px]"""


def bends_of(solution: BundleSolution, x1: FloatArray) -> Bends:
    """Take the mean residual of each plane over squares of an eighth of the picture, and the parabola through it."""
    residual, label = solution.fit.residual, solution.fit_label
    place = x1[solution.used]
    side = max(solution.camera.width_px, solution.camera.height_px) / _CELLS
    cell = (place // side).astype(np.int64)
    bends, noises = [], []
    bows = [_bow_px(place[label == plane], residual[label == plane]) for plane in range(len(solution.planes))]
    for plane in range(len(solution.planes)):
        on = label == plane
        if not on.any():
            bends.append(0.0)
            noises.append(0.0)
            continue
        _, index = np.unique(cell[on, 0] * 1000 + cell[on, 1], return_inverse=True)
        index = index.ravel()
        count = np.bincount(index)
        means = np.stack([np.bincount(index, r) / count for r in residual[on].T], axis=1)
        noise = residual[on] - means[index]
        variance = float((noise**2).sum(1).mean())
        many = count >= _LEAST_IN_CELL
        square = (means[many] ** 2).sum(axis=1)
        bends.append(float(np.sqrt(np.average(square, weights=count[many])) if many.any() else 0.0))
        noises.append(float(np.sqrt(variance)))
    return Bends(bend_px=np.array(bends), bow_px=np.array(bows), noise_px=np.array(noises))


def _bow_px(place: FloatArray, residual: FloatArray, stray_medians: float = _STRAY_MEDIANS) -> float:
    """Root mean square of the quadratic part of residuals (N, 2) over places (N, 2), strays left out."""
    size = np.linalg.norm(residual, axis=1)
    near = size < stray_medians * np.median(size) if len(size) else np.zeros(0, dtype=bool)
    if near.sum() < _LEAST_BOWED:
        return 0.0
    x, y = ((place[near] - place[near].mean(axis=0)) / np.maximum(place[near].std(axis=0), 1e-9)).T
    basis, _ = np.linalg.qr(np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y]))
    parts = basis.T @ residual[near]
    by_chance = ((residual[near] - basis @ parts) ** 2).sum() / near.sum() * _QUADRATIC
    bow = float((parts[-_QUADRATIC:] ** 2).sum()) - float(by_chance)
    return float(np.sqrt(max(bow, 0.0) / near.sum()))


def bows_to_the_edges_px(solution: BundleSolution, x1: FloatArray, x2: FloatArray) -> FloatArray:
    """(K,) the bow of all points that lie on each plane: of those near an edge, too, which a fit does not use.

    Facets that stand for a curved surface meet at shallow angles, so that most of their points count as near an edge,
    and those that bend away from them are among these. None is a stray: what lies on no plane is left out.
    """
    on = np.flatnonzero(solution.label >= 0)
    label = solution.label[on]
    there = transfer_of(solution.projector)(rays_of(solution.camera, x1[on]), solution.planes[label])
    off = there - x2[on]
    return np.array([_bow_px(x1[on][label == k], off[label == k], np.inf) for k in range(len(solution.planes))])


def mixed_share(x1: FloatArray, own: BoolArray) -> float:
    """Share of the exclusively explained points (K, N) whose neighbours in the picture mostly lie on other planes."""
    rows = np.flatnonzero(own.any(axis=0))
    if len(rows) < _LEAST_KNOWN * len(x1):
        return 0.0
    label = own[:, rows].argmax(axis=0)
    low = x1.min(axis=0)
    side = float(np.sqrt(np.prod(np.ptp(x1, axis=0) + 1) * 3 * _POINTS_A_CELL / len(x1)))
    cell = ((x1[rows] - low) // side).astype(np.int64)
    _, index = np.unique(cell[:, 0] * 100_000 + cell[:, 1], return_inverse=True)
    counts = np.zeros((int(index.max(initial=0)) + 1, len(own)), dtype=np.int64)
    np.add.at(counts, (index.ravel(), label), 1)
    return float(1 - counts.max(axis=1).sum() / max(len(rows), 1))
