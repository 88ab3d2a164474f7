"""Flat parts of things up to the walls that they touch, where light misses the wall by less than surely tells."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from calibration.arrays import BoolArray, FloatArray
from calibration.surfaces.before_walls import THIN_PX, opened
from calibration.surfaces.flat_parts import Parts
from calibration.surfaces.point_map import PointMap, at_least_usual

_SIGMAS = 3.0
"""By no more a point misses the plane that it lies on, and by more the wall that it does not lie on."""


def up_to_walls(points: PointMap, parts: Parts, wall_distance_m: FloatArray) -> Parts:
    """Carry flat parts on over pixels beside them that lie on their plane, and not on the wall.

    A pixel whose light misses its wall by little may be the wall's own error; many that lie on the plane of a part, and
    hang together with it, are the part: a ramp's foot, a board's edge against a wall, the back of a shallow niche.

    Parameters
    ----------
    points : PointMap
        Of all pixels that have a point.
    parts : Parts
        Of what surely is no wall.
    wall_distance_m : (H, W)
        Along each pixel's ray. [m]

    Returns
    -------
    Parts
        The same, some larger.
    """
    label, free = parts.label, points.known & (parts.label < 0)
    if not parts.flat.any():
        return parts
    inverse = 1 / points.distance_m
    sigma = at_least_usual(points.sigma_m, points.sigma_m[label >= 0]) / points.distance_m**2
    off_wall = free & (np.abs(inverse - 1 / wall_distance_m) > _SIGMAS * sigma)
    for number in np.flatnonzero(parts.flat):
        on = off_wall & (np.abs(inverse - points.rays @ parts.planes[number]) <= _SIGMAS * sigma)
        label = np.where(_reached(parts.label == number, on & (label < 0)), number, label)
    return replace(parts, label=label)


def _reached(part: BoolArray, more: BoolArray) -> BoolArray:
    """(H, W) those of more pixels that hang together with a part, without thin strips."""
    whole = part | opened(part | more, THIN_PX)
    number = cv2.connectedComponents(whole.astype(np.uint8), connectivity=4)[1]
    return np.asarray(more & whole & np.isin(number, np.unique(number[part])))
