"""Boards as they are: bent along any direction, twisted, printed longer than wide."""

from __future__ import annotations

import numpy as np

from calibration.arrays import FloatArray
from calibration.lenses.records import FLEX, BoardSightings, RigState


def board_points(sightings: BoardSightings, state: RigState) -> tuple[FloatArray, FloatArray]:
    """(N, 3) corners on the board as it is, and (N, 3, 4) how they move with its bend and its stretch.

    A sheet that bends keeps its lengths, so its corners also draw nearer to its middle, by the square of the bend: on a
    roll of curvature k by k² x³ / 6 across it, which is (s·p) s / 6 with s the slope of the sheet at p, whatever
    direction it is rolled in.
    """
    heights, slopes = _arches(sightings)
    by_board = np.zeros((len(heights), 3, FLEX + 1))
    by_board[:, 2, :FLEX] = heights
    by_board[:, 1, FLEX] = sightings.centred_m[:, 1]
    slope = slopes @ state.flex_m
    rise, rises = (slope * sightings.centred_m).sum(axis=1), np.einsum("nij,ni->nj", slopes, sightings.centred_m)
    by_board[:, :2, :FLEX] -= (slope[:, :, None] * rises[:, None, :] + rise[:, None, None] * slopes) / 6
    points = np.column_stack([sightings.board_m - rise[:, None] * slope / 6, heights @ state.flex_m])
    points[:, 1] += state.stretch * sightings.centred_m[:, 1]
    return points, by_board


def _arches(sightings: BoardSightings) -> tuple[FloatArray, FloatArray]:
    """(N, 3) height of the corners for a bend of 1 along x, of 1 along y, and for a twist of 1; (N, 2, 3) their slopes.

    Bends are parabolas of 1 in the middle and 0 at the edges; twist is a saddle of 1 at the first corner and the last,
    of -1 at the other two.
    """
    half = np.maximum(np.array(sightings.half_size_m), 1e-9)
    x, y = (sightings.centred_m / half).T
    none = np.zeros(len(x))
    slopes = np.stack([np.stack([-2 * x, none, y], axis=1), np.stack([none, -2 * y, x], axis=1)], axis=1)
    return np.column_stack([1 - x**2, 1 - y**2, x * y]), slopes / half[:, None]
