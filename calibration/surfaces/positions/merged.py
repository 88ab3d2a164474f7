"""Points of one camera merged with what another position saw of the same surface, or held against it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from calibration.arrays import BoolArray, FloatArray
from calibration.geometry.pinhole import PinholeModel, project
from calibration.surfaces.before_walls import opened
from calibration.surfaces.pieces import largest_first
from calibration.surfaces.point_map import PointMap
from calibration.surfaces.positions.lit_map import read_at

MOST_APART = 1.5e-3
"""Of the distance, by which half of what two positions measure may differ: what a measured surface may be off by."""
_APART, _APART_SIGMAS = 3 * MOST_APART, 5.0
"""Of the distance, and standard deviations, beyond both of which two points are of different surfaces."""
_EDGE_PX = 5
"""Window, all of which has to be apart: at edges codes mix, and two positions differ in what they mix."""
_LEAST_PIXELS = 40
"""Of something that stands elsewhere; fewer are chance."""
_STEP = 1e-3
"""Share of a distance over which it is taken how fast a ray nears a surface."""
_ROUNDS = 3
"""Of the search for where a ray meets a surface."""
_LEAST_SLOPE = 0.05
"""Of a ray's nearing a surface over its length: at a flatter angle the surface tells nothing of the distance."""
_FARTHER = 0.01
"""Of the distance, from which on what a pixel sees lies behind a point: so much less is an error of either."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Agreement:
    """How what one position saw fits what another did."""

    compared: int
    """Pixels of the first that see what the other saw, too."""
    share_of_seen: float
    """Of the first's pixels."""
    median: float
    """Of the absolute differences, over the distance."""
    sigmas: float
    """Root mean square of the differences within five standard deviations, in these: 1 where they are right."""
    elsewhere: BoolArray
    """(H, W) pixels that differ by more than noise and lenses allow, all about them too: something stands elsewhere."""
    elsewhere_m: float
    """Median by which the largest such surface is further away for the other; 0 for none. [m]"""

    @property
    def share_elsewhere(self) -> float:
        """Of the compared pixels."""
        return float(self.elsewhere.sum()) / max(self.compared, 1)


def seen_along(points: PointMap, lit: PointMap, projector: PinholeModel) -> tuple[FloatArray, FloatArray]:
    """Return where rays of a camera's pixels meet the surface that a projector lights.

    Parameters
    ----------
    points : PointMap
        Of the camera; the search begins at its points.
    lit : PointMap
        Of the projector's pixels, measured from elsewhere.
    projector : PinholeModel
        In the same world.

    Returns
    -------
    distance_m, sigma_m : (H, W)
        NaN where the camera has no point, or the surface none there. [m]
    """
    known = points.known
    rays, along = points.rays[known], points.distance_m[known].copy()

    def beyond(distance_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """By how much places on the rays lie behind the surface, seen from the projector, and its sigma."""
        places = points.origin_m + distance_m[:, None] * rays
        xy_px = project(projector, places)
        there_m = 1 / read_at(1 / lit.distance_m, xy_px)
        return np.linalg.norm(places - projector.position_m, axis=1) - there_m, read_at(lit.sigma_m, xy_px)

    for _ in range(_ROUNDS):
        off_m, sigma_m = beyond(along)
        slope = (beyond(along * (1 + _STEP))[0] - off_m) / (along * _STEP)
        slope = np.where(np.abs(slope) > _LEAST_SLOPE, slope, np.nan)
        along = along - off_m / slope
    distance_m, sigma = np.full(known.shape, np.nan), np.full(known.shape, np.nan)
    distance_m[known], sigma[known] = along, sigma_m / np.abs(slope)
    return distance_m, sigma


def agreement_of(points: PointMap, there_m: FloatArray, sigma_m: FloatArray) -> Agreement:
    """Hold a camera's points against what another position saw along the same rays.

    Parameters
    ----------
    points : PointMap
        Of the camera.
    there_m, sigma_m : (H, W)
        Of :func:`seen_along`. [m]

    Returns
    -------
    Agreement
    """
    both = points.known & np.isfinite(there_m)
    off_m = np.where(both, there_m - points.distance_m, 0.0)
    sigma = np.where(both, np.hypot(points.sigma_m, sigma_m), 1.0)
    distance = np.where(both, points.distance_m, 1.0)
    far = both & (np.abs(off_m) > np.maximum(_APART * distance, _APART_SIGMAS * sigma))
    elsewhere, largest = _areas(far)
    near = both & (np.abs(off_m) <= _APART_SIGMAS * sigma)
    compared = int(both.sum())
    return Agreement(
        compared=compared,
        share_of_seen=compared / max(int(points.known.sum()), 1),
        median=float(np.median(np.abs(off_m / distance)[both])) if compared else np.inf,
        sigmas=float(np.sqrt(np.mean((off_m / sigma)[near] ** 2))) if near.any() else np.inf,
        elsewhere=elsewhere,
        elsewhere_m=float(np.median(off_m[largest])) if largest.any() else 0.0,
    )


def merged(points: PointMap, there_m: FloatArray, sigma_m: FloatArray) -> PointMap:
    """Return a camera's points, each the mean of both where another position saw it, too, by their variances.

    Points that differ by more than both standard deviations allow, at edges, stay the camera's own. All keep their own
    standard deviations: the mean's noise is less, but neighbours share it, and where one position's view ends there is
    a step of what lenses and poses leave, which would cut flat parts in two.

    Parameters
    ----------
    points : PointMap
        Of the camera.
    there_m, sigma_m : (H, W)
        Of :func:`seen_along`. [m]

    Returns
    -------
    PointMap
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        off_m = there_m - points.distance_m
        same = np.abs(off_m) <= _APART_SIGMAS * np.hypot(points.sigma_m, sigma_m)
        share = points.sigma_m**2 / (points.sigma_m**2 + sigma_m**2)
        distance_m = np.where(same, points.distance_m + share * off_m, points.distance_m)
    return replace(points, distance_m=distance_m)


def looked_through(points: PointMap, camera: PinholeModel, others: PointMap) -> BoolArray:
    """Return (H, W) pixels of another camera whose points a camera looks through at something behind.

    Parameters
    ----------
    points : PointMap
        Of the camera that may look through.
    camera : PinholeModel
        Whose points these are.
    others : PointMap
        Of the other camera, in the same world.

    Returns
    -------
    (H, W) bool
        Along edges there are strips though nothing moved; :func:`~calibration.surfaces.before_walls.opened` takes them
        away.
    """
    places = others.origin_m + others.distance_m[others.known][:, None] * others.rays[others.known]
    through = np.zeros(others.known.shape, dtype=bool)
    through[others.known] = _seen_over_distance(points, camera, places) > 1 + _FARTHER
    return through


def looked_at(points: PointMap, camera: PinholeModel, places_m: FloatArray) -> BoolArray:
    """Return (N,) places that a camera sees, or looks through: of what is there it needs no guess.

    Parameters
    ----------
    points : PointMap
        Of the camera.
    camera : PinholeModel
        Whose points these are.
    places_m : (N, 3)
        In the same world. [m]

    Returns
    -------
    (N,) bool
    """
    return np.asarray(_seen_over_distance(points, camera, places_m) > 1 - _FARTHER)


def _seen_over_distance(points: PointMap, camera: PinholeModel, places_m: FloatArray) -> FloatArray:
    """(N,) how far a camera sees where it has places in its picture, over how far they are; 0 where it sees nothing."""
    local = places_m @ camera.rotation.T + camera.translation_m
    ahead = local[:, 2] > 0
    somewhere = np.where(ahead[:, None], places_m, camera.position_m + camera.rotation[2])
    xy_px = np.where(ahead[:, None], project(camera, somewhere), np.nan)
    seen_m = 1 / read_at(1 / points.distance_m, xy_px)
    return np.asarray(np.nan_to_num(seen_m / np.linalg.norm(local, axis=1)))


def _areas(mask: BoolArray) -> tuple[BoolArray, BoolArray]:
    """Areas of a mask that are no thin edges and no chance, and the largest of them."""
    number = cv2.connectedComponents(opened(mask, _EDGE_PX).astype(np.uint8), connectivity=4)[1].astype(np.int64)
    label = largest_first(number - 1, _LEAST_PIXELS)
    return np.asarray(label >= 0), np.asarray(label == 0)
