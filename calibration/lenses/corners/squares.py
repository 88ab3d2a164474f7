"""Which of a chessboard's corners are neighbours: a grid that OpenCV finds may leave some out between them.

Of a board that is cut on all sides it finds every second column, or rows that are askew by one square each. All its
corners are corners, but they are numbered as if they were neighbours. What a picture shows about a corner decides: the
squares' edges run through it, towards its neighbours.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np
from numpy.typing import NDArray

from calibration.arrays import FloatArray
from calibration.lenses.corners.saddles import corners_near

_RADIUS = 0.2
"""Of the distance to the nearest corner, which may be the diagonal of a square: of the ring on which edges are looked
for."""
_LEAST_RADIUS_PX = 3.0
_ASKEW_RAD = 0.2
"""Between an edge at a corner and the way to its neighbour: rings of few pixels tell no better."""
_PARTS = 3
"""A grid that leaves corners out leaves out every second or two of three."""
_TRIED = 12
"""Corners of a grid, from its middle on, of which one has to have four neighbours that make a square."""
_SAMES = 0.1
"""Of a square: neighbours that are the grid's own."""


def neighbours_only(shown: NDArray[np.uint8], grid: FloatArray) -> FloatArray:
    """Return a grid in which neighbours are neighbours on the board.

    Parameters
    ----------
    shown : (H, W) uint8
    grid : (R, C, 2)
        Corners, at least two by two. [px]

    Returns
    -------
    (R, C, 2)
        Right-handed: the grid itself, or two by two corners of one square where it leaves corners out; empty where no
        four corners make a square.
    """
    grid = right_handed(grid)
    for row, column in _from_the_middle(grid):
        right, down = grid[row, column + 1] - grid[row, column], grid[row + 1, column] - grid[row, column]
        square = _square_at(shown, grid[row, column], right, down)
        if square is None:
            continue
        edges = square[0, 1] - square[0, 0], square[1, 0] - square[0, 0]
        size_px = min(float(np.linalg.norm(edge)) for edge in edges)
        own = all(
            min(np.linalg.norm(edge - sign * step) for edge in edges for sign in (1, -1)) < _SAMES * size_px
            for step in (right, down)
        )
        return _looked_at(shown, grid, size_px) if own else square
    return grid[:0]


def _looked_at(shown: NDArray[np.uint8], grid: FloatArray, square_px: float) -> FloatArray:
    """The grid's corners where they are; NaN where none is seen: near the picture's edge OpenCV guesses some."""
    return corners_near(shown, grid.reshape(-1, 2), square_px).reshape(grid.shape)


def right_handed(grid: FloatArray) -> FloatArray:
    """Return a grid whose rows run to the left of its columns in the picture: as a board is printed, never mirrored."""
    right, down = grid[:, 1:] - grid[:, :-1], grid[1:] - grid[:-1]
    turn = np.nanmedian(right[:-1, :, 0] * down[:, :-1, 1] - right[:-1, :, 1] * down[:, :-1, 0])
    return grid if turn > 0 else np.ascontiguousarray(grid[:, ::-1])


def _from_the_middle(grid: FloatArray) -> Iterator[tuple[int, int]]:
    """Cells whose first corner and its two steps are known, those in the middle first."""
    rows, columns = grid.shape[0] - 1, grid.shape[1] - 1
    cells = sorted(
        product(range(rows), range(columns)), key=lambda at: abs(at[0] - rows / 2) + abs(at[1] - columns / 2)
    )
    known = (at for at in cells if np.isfinite(grid[at[0] : at[0] + 2, at[1] : at[1] + 2]).all())
    return (at for at, _ in zip(known, range(_TRIED), strict=False))


def _square_at(shown: NDArray[np.uint8], place: FloatArray, right: FloatArray, down: FloatArray) -> FloatArray | None:
    """(2, 2, 2) four corners of a square, the first at a place; None where the picture shows none."""
    steps = [
        (m * right + n * down) / k for k in range(1, _PARTS + 1) for m, n in product(range(-2 * k, 2 * k + 1), repeat=2)
    ]
    steps = sorted((step for step in steps if np.linalg.norm(step) > 1), key=lambda step: float(np.linalg.norm(step)))
    whole = min(np.linalg.norm(step) for step in (right, down, right + down, right - down))
    angles = _edges_at(shown, place, max(_RADIUS * float(whole), _LEAST_RADIUS_PX))
    found = [_neighbour(shown, place, steps, angle) for angle in angles]
    if len(found) != 2 or found[0] is None or found[1] is None:
        return None
    one, other = found[0] - place, found[1] - place
    if one[0] * other[1] - one[1] * other[0] < 0:
        one, other = other, one
    size_px = min(float(np.linalg.norm(one)), float(np.linalg.norm(other)))
    last = corners_near(shown, (place + one + other)[None], size_px)[0]
    return None if np.isnan(last[0]) else np.array([[place, place + one], [place + other, last]])


def _neighbour(
    shown: NDArray[np.uint8], place: FloatArray, steps: list[FloatArray], angle_rad: float
) -> FloatArray | None:
    """The nearest corner along an edge."""
    for step in steps:
        off = (np.arctan2(step[1], step[0]) - angle_rad + np.pi / 2) % np.pi - np.pi / 2
        if abs(off) > _ASKEW_RAD:
            continue
        found = corners_near(shown, (place + step)[None], float(np.linalg.norm(step)))[0]
        if np.isfinite(found[0]):
            return np.asarray(found)
    return None


def _edges_at(shown: NDArray[np.uint8], place: FloatArray, radius_px: float) -> list[float]:
    """Directions of the two edges that cross at a corner, 0 to π; empty where a ring about it shows no four."""
    angle = np.linspace(0, 2 * np.pi, 96, endpoint=False)
    x, y = np.rint(place[:, None] + radius_px * np.stack([np.cos(angle), np.sin(angle)])).astype(int)
    height, width = shown.shape
    ring = shown[y.clip(0, height - 1), x.clip(0, width - 1)].astype(np.float64)
    ring = np.convolve(np.concatenate([ring[-2:], ring, ring[:2]]), np.ones(5) / 5, mode="valid")
    bright = ring > (ring.max() + ring.min()) / 2
    at = np.flatnonzero(bright != np.roll(bright, 1))
    if len(at) != 4:
        return []
    edge = angle[at] - np.pi / len(angle)
    return [float(np.angle(np.exp(2j * edge[[k, k + 2]]).sum()) / 2 % np.pi) for k in (0, 1)]
