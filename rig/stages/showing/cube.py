"""Cube maps: six squares about a viewer, as a horizontal cross or in a strip."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_CROSS = {"right": (2, 1), "left": (0, 1), "up": (1, 0), "down": (1, 2), "ahead": (1, 1), "behind": (3, 1)}
"""Column and row of each square in a cross of 4 × 3."""
_STRIP = {name: (column, 0) for column, name in enumerate(("right", "left", "up", "down", "ahead", "behind"))}
_SQUARE = 0.01
"""By which a picture's shape may leave 4 : 3 or 6 : 1, relative."""


def cube_layout(shape: tuple[int, int]) -> dict[str, tuple[int, int]] | None:
    """Return column and row of each square of a cube map of a shape (height, width); None where it is none."""
    ratio = shape[1] / shape[0]
    if abs(ratio / (4 / 3) - 1) < _SQUARE:
        return _CROSS
    return _STRIP if abs(ratio / 6 - 1) < _SQUARE else None


def cube_places(away: FloatArray, shape: tuple[int, int]) -> FloatArray:
    """Return (n, 2) where directions lie in a cube map.

    Parameters
    ----------
    away : (n, 3)
        Ahead, to the right, up; of any length.
    shape
        (height, width) of a picture that has a :func:`cube_layout`.
    """
    layout = cube_layout(shape) or _CROSS
    side = shape[0] / (1 + max(row for _, row in layout.values()))
    ahead, right, up = away.T
    # Of each square: what is towards it, to the right in it and down in it. Up and down join the one ahead.
    squares = {
        "ahead": (ahead, right, -up),
        "behind": (-ahead, -right, -up),
        "right": (right, -ahead, -up),
        "left": (-right, ahead, -up),
        "up": (up, right, ahead),
        "down": (-up, right, -ahead),
    }
    places = np.full((len(away), 2), np.nan)
    most = np.abs(away).max(axis=1)
    for name, (towards, across, down) in squares.items():
        chosen = (towards == most) & (most > 0)
        place = np.stack([across[chosen], down[chosen]], axis=-1) / most[chosen, None]
        # Nothing of a neighbour in the picture, which may be none in the room, gets in.
        inside = np.clip((place + 1) / 2 * side, 0.5, side - 0.5)
        places[chosen] = np.array(layout[name]) * side + inside - 0.5
    return places
