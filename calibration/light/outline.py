"""Places beside the border of the projector's picture, continued from those inside.

A pixel there sees light from one side only: its code tells the middle of that light, up to half a blur further in than
the pixel looks, and of a check's edge and the picture's own it does not know which is near.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from calibration.arrays import BoolArray, Float32Array, FloatArray
from calibration.light.two_level import Footprint

_REACH = 3.0
"""Standard deviations of what a pixel sees from the border at which nothing of it is missing, 0.1 % of its light."""
_AROUND = 48
"""Pixels inside that tell a place, the nearest: a half disc of 5 or 6 of them, over which walls are flat."""
_EACH, _FAR, _LEAST_FAR_PX = 1 / 3, 4.0, 6.0
"""Of the width, in camera pixels, of what is beside the border: how far those that tell lie apart, one pixel at least,
and how far away the last of them may be, beside some pixels."""
_MOST_OFF_PX = 0.2
"""By which they may be off the plane through them, rms: on one wall 0.01 to 0.05, across a corner more."""


def beside_border(seen: Footprint, projector_shape: tuple[int, int]) -> BoolArray:
    """Return (…,) which pixels see the border of the projector's picture; none of those without a place.

    Parameters
    ----------
    seen : Footprint
        (…, 2) places by the code, which are never farther out than the true ones.
    projector_shape : (height, width)
    """
    reach = _REACH * np.sqrt(seen.variance_px2)
    height, width = projector_shape
    low, high = seen.xy_px + 0.5, np.array([width, height]) - 0.5 - seen.xy_px
    with np.errstate(invalid="ignore"):
        return np.asarray((np.minimum(low, high) < reach).any(axis=-1))


@dataclass(frozen=True, eq=False)
class ContinuedPlaces:
    """Places of N pixels, by those of others."""

    told: BoolArray
    """(N,) whether there are enough others, on one wall."""
    xy_px: FloatArray
    """(N, 2) in the projector's picture, where they are told."""
    variance_px2: FloatArray
    """(N,) of these along an axis."""


def looks_at_picture(xy_px: FloatArray | Float32Array, projector_shape: tuple[int, int]) -> BoolArray:
    """Return (…,) which places lie on the projector's picture: to the others only its blur sends light."""
    height, width = projector_shape
    with np.errstate(invalid="ignore"):
        return np.asarray(((xy_px >= -0.5) & (xy_px <= np.array([width, height]) - 0.5)).all(axis=-1))


def border_width_px(seen: Footprint, stretched: FloatArray, beside: BoolArray) -> float:
    """Return how many camera pixels the strip beside the border is wide, as a rule; 0 where there is none.

    Parameters
    ----------
    seen, stretched
        (H, W, 2) what pixels see, and :func:`~calibration.light.blur.stretch`.
    beside : (H, W)
    """
    chosen = beside & (stretched > 0).all(axis=-1)
    width = _REACH * np.sqrt(seen.variance_px2[chosen] / stretched[chosen])
    return float(np.median(width)) if chosen.any() else 0.0


def continued_places(xy_px: FloatArray, known: BoolArray, wanted: BoolArray, width_px: float) -> ContinuedPlaces:
    """Continue places in a straight line from pixels that know theirs to others beside them.

    Parameters
    ----------
    xy_px : (H, W, 2)
        Projector pixel of each camera pixel.
    known, wanted : (H, W)
        Pixels whose places are right, and those that are asked for, in the order of ``np.nonzero(wanted)``.
    width_px : float
        Of those that are asked for, across the border: :func:`border_width_px`.
    """
    apart = max(1, round(_EACH * width_px))
    inside, asked = np.argwhere(known[::apart, ::apart]) * apart, np.argwhere(wanted)
    if len(inside) < _AROUND or not len(asked):
        return ContinuedPlaces(np.zeros(len(asked), bool), np.zeros((len(asked), 2)), np.zeros(len(asked)))
    far_px = _FAR * width_px + _LEAST_FAR_PX
    distance, nearest = KDTree(inside).query(asked, k=_AROUND, distance_upper_bound=far_px)
    near = np.flatnonzero(np.isfinite(distance).all(axis=1))
    around = inside[nearest[near]]
    away = (around - asked[near, None]).astype(np.float64)
    matrix = np.concatenate([np.ones((*away.shape[:2], 1)), away], axis=2)
    inverse = np.linalg.inv(matrix.transpose(0, 2, 1) @ matrix + 1e-9 * np.eye(3))
    values = xy_px[around[..., 0], around[..., 1]].astype(np.float64)
    planes = inverse @ (matrix.transpose(0, 2, 1) @ values)
    scatter = ((values - matrix @ planes) ** 2).sum(axis=1).max(axis=1) / (_AROUND - 3)
    told, places, variance = np.zeros(len(asked), bool), np.zeros((len(asked), 2)), np.zeros(len(asked))
    told[near] = scatter < _MOST_OFF_PX**2
    # Away is counted from the pixel itself: its place is the planes' constant.
    places[near], variance[near] = planes[:, 0], scatter * (1 + inverse[:, 0, 0])
    return ContinuedPlaces(told, places, variance)
