"""What a projector's black adds to a dark room: at its picture's border its light ends, and the room's does not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.arrays import BoolArray, Float32Array, FloatArray

_TILE_PX = 32
"""Squares of the camera's picture, within which room light changes along a plane."""
_LEAST_PIXELS, _LEAST_TILES = 60, 6
"""On each side of the border in a tile; tiles, below which their scatter says too little."""
_OF_MEDIAN = 1.4826 * 1.2533
"""Times the median distance from the median over the root of how many: the standard error of a median."""


@dataclass(frozen=True, slots=True)
class ProjectorBlack:
    """Light of a projector that shows black."""

    share_of_white: float
    """One over its contrast. [1]"""
    sigma: float
    """Standard error. [1]"""


def projector_black(
    black: Float32Array | FloatArray, white: Float32Array | FloatArray, inside: BoolArray, outside: BoolArray
) -> ProjectorBlack | None:
    """Tell a projector's black from room light.

    Both are there in a photograph of black. Across the border of the picture white and the projector's black fall by
    the same share; room light does not care, nor do walls, on average over the border.

    Parameters
    ----------
    black : (H, W)
        Light while the projector shows black, the sensor's own level off. [camera unit]
    white : (H, W)
        What white adds to it. [camera unit]
    inside, outside : (H, W) bool
        Pixels that see all of the projector's white, and those that see none of it.

    Returns
    -------
    ProjectorBlack or None
        None where the border is seen along too little of the picture.
    """
    shares = [
        share for tile in _tiles(black.shape) if (share := _share(black, white, inside, outside, tile=tile)) is not None
    ]
    if len(shares) < _LEAST_TILES:
        return None
    middle = float(np.median(shares))
    scatter = float(np.median(np.abs(np.array(shares) - middle)))
    return ProjectorBlack(middle, _OF_MEDIAN * scatter / float(np.sqrt(len(shares))))


def _tiles(shape: tuple[int, ...]) -> list[tuple[slice, slice]]:
    return [
        (slice(top, top + _TILE_PX), slice(left, left + _TILE_PX))
        for top in range(0, shape[0], _TILE_PX)
        for left in range(0, shape[1], _TILE_PX)
    ]


def _share(
    black: Float32Array | FloatArray,
    white: Float32Array | FloatArray,
    inside: BoolArray,
    outside: BoolArray,
    *,
    tile: tuple[slice, slice],
) -> float | None:
    """Of one tile: the step of black over that of white, beside a plane."""
    lit, unlit = inside[tile], outside[tile]
    if min(int(lit.sum()), int(unlit.sum())) < _LEAST_PIXELS:
        return None
    rows, columns = np.nonzero(lit | unlit)
    terms = np.stack([lit[rows, columns], np.ones(len(rows)), rows, columns], axis=1).astype(np.float64)
    light = np.stack([white[tile][rows, columns], black[tile][rows, columns]], axis=1).astype(np.float64)
    (of_white, of_black), *_ = np.linalg.lstsq(terms, light, rcond=None)[0]
    return float(of_black / of_white) if of_white > 0 else None
