"""Chessboards that the edge of the picture cuts: the corners that are seen, and which of the board's they may be.

A chessboard's corners have no names, so which part of it is seen shows only at ends that lie within the picture. The
lens does not care: another numbering is another pose of a flat board.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.arrays import FloatArray, IntArray
from calibration.lenses.boards import Board
from calibration.lenses.corners.saddles import OFF_SQUARES, corners_near
from calibration.lenses.corners.squares import neighbours_only

_SMALLEST_GRID, _SMALLEST_SEED = 3, 2
"""Corners a side with which a part of a board is looked for, and from which it is gone on with."""
LEAST_PART = 12
"""Corners of a part: fewer hold neither pose nor lens, and may be chance."""
_ENOUGH = 18
"""Corners of a part that is not looked for in other ways."""
_RIM_PX = 40
"""About a picture whose edge cuts a board: the search wants something around it."""
_MOST_BEYOND = 0.5
"""Of places one square beyond a board's last corners, or between its corners, those that may look like one: its rim and
its edges have none."""
_SQUARES_TO_EDGE = 1.6
"""A part ends where the next corner would lie at the picture's edge: half a square more, for corners that are too near
to it to be found."""


@dataclass(frozen=True, eq=False)
class SeenPart:
    """A grid of corners, row after row."""

    size: tuple[int, int]
    """(columns, rows) of the grid."""
    xy_px: FloatArray
    """(columns * rows, 2)"""
    ids: IntArray | None
    """Numbers on the board; None where the grid is no part of it that the picture's edge explains."""


def seen_part(shown: NDArray[np.uint8], board: Board) -> SeenPart | None:
    """Find the largest grid of chessboard corners in a picture, and what part of a board it is.

    Parameters
    ----------
    shown : (H, W) uint8
    board : Board
        A chessboard.

    Returns
    -------
    SeenPart or None
        None where there is no grid of three corners a side.
    """
    if not hasattr(cv2, "findChessboardCornersSBWithMeta"):
        return None
    flags = sum(int(getattr(cv2, name)) for name in _FLAGS if hasattr(cv2, name))
    found, corners, meta = cv2.findChessboardCornersSBWithMeta(shown, (_SMALLEST_GRID, _SMALLEST_GRID), flags)
    if not found or meta is None:
        return None
    rows, columns = np.asarray(meta).shape[:2]
    seed = _unfolded(np.asarray(corners, dtype=np.float64).reshape(rows, columns, 2))
    if min(seed.shape[:2]) < _SMALLEST_SEED:
        return None
    seed = neighbours_only(shown, seed)
    if min(seed.shape[:2]) < _SMALLEST_SEED:
        return None
    grid = _grown(shown, seed)
    rows, columns = grid.shape[:2]
    if (columns > board.columns or rows > board.rows) and columns <= board.rows and rows <= board.columns:
        grid = np.ascontiguousarray(np.rot90(grid))  # a quarter, so that it stays right-handed
    first = _firsts(grid, board, shown.shape)
    seen = np.isfinite(grid[..., 0])
    row, column = np.nonzero(seen)
    ids = None if first is None else np.asarray((row + first[0]) * board.columns + column + first[1])
    return SeenPart((grid.shape[1], grid.shape[0]), grid[seen], ids)


def largest_part(shown: NDArray[np.uint8], board: Board) -> SeenPart | None:
    """Find a part of a chessboard, if need be with a rim about the picture, or mirrored: each may miss a cut one.

    A chessboard's mirror image is a chessboard, so that corners found there are corners here, numbered the other way.
    """
    part = seen_part(shown, board)
    if _corners_of(part) >= _ENOUGH:
        return part
    rimmed = seen_part(np.pad(shown, _RIM_PX, mode="edge"), board)
    mirrored = seen_part(np.ascontiguousarray(shown[:, ::-1]), board)
    parts = [part, _moved(rimmed), _mirrored(mirrored, board, shown.shape[1])]
    return max(parts, key=_corners_of) if any(_corners_of(one) for one in parts) else part


def _corners_of(part: SeenPart | None) -> int:
    """How many, if they are a part of the board."""
    return 0 if part is None or part.ids is None else len(part.ids)


def _moved(part: SeenPart | None) -> SeenPart | None:
    return None if part is None else SeenPart(part.size, part.xy_px - _RIM_PX, part.ids)


def _mirrored(part: SeenPart | None, board: Board, width_px: int) -> SeenPart | None:
    if part is None or part.ids is None:
        return None
    row, column = np.divmod(part.ids, board.columns)
    there = (width_px - 1, 0) + part.xy_px * (-1, 1)
    return SeenPart(part.size, there, np.asarray((row + 1) * board.columns - 1 - column))


def is_of_larger_board(shown: NDArray[np.uint8], grid: FloatArray) -> bool:
    """Tell whether there are corners beyond a whole grid, or between its corners: then the board has more.

    Parameters
    ----------
    shown : (H, W) uint8
    grid : (R, C, 2)
        Corners, row after row. [px]
    """
    square_px = float(np.median(np.linalg.norm(np.diff(grid, axis=1), axis=-1)))
    turned = grid.transpose(1, 0, 2)
    beyond = (2 * lines[0] - lines[1] for lines in (grid, grid[::-1], turned, turned[::-1]))
    between = ((lines[1:] + lines[:-1]).reshape(-1, 2) / 2 for lines in (grid, turned))
    return any(_share_of_corners(shown, places, square_px) > _MOST_BEYOND for places in beyond) or any(
        _share_of_corners(shown, places, square_px / 2) > _MOST_BEYOND for places in between
    )


def _share_of_corners(shown: NDArray[np.uint8], places: FloatArray, square_px: float) -> float:
    """Of places, those near which there is a corner."""
    return float(np.isfinite(corners_near(shown, places, square_px)[:, 0]).mean())


def _grown(shown: NDArray[np.uint8], seed: FloatArray) -> FloatArray:
    """(R, C, 2) a grid and all corners around it that are there, line by line; NaN where one is not."""
    grid, before = seed, -1
    while (count := int(np.isfinite(grid[..., 0]).sum())) > before:
        before = count
        grid = np.pad(grid, ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
        for expected in (_continued(grid, axis, way) for axis in (0, 1) for way in (1, -1)):
            open_ = np.isnan(grid[..., 0]) & np.isfinite(expected[..., 0])
            square_px = float(np.nanmedian(np.linalg.norm(np.diff(grid, axis=1), axis=-1)))
            grid[open_] = corners_near(shown, expected[open_], square_px)
        there = np.isfinite(grid[..., 0])
        rows, columns = np.flatnonzero(there.any(axis=1)), np.flatnonzero(there.any(axis=0))
        grid = grid[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return grid


def _continued(grid: FloatArray, axis: int, way: int) -> FloatArray:
    """(R, C, 2) where corners are if those of two neighbours in a direction go on; NaN where there are none."""
    one, two = (np.roll(grid, way * k, axis=axis) for k in (1, 2))
    expected = 2 * one - two
    edge = [slice(None)] * 2
    edge[axis] = slice(0, 2) if way > 0 else slice(-2, None)
    expected[tuple(edge)] = np.nan
    return np.asarray(expected)


def _unfolded(grid: FloatArray) -> FloatArray:
    """The largest part of a grid that is one board: where the edge cuts a tilted one, corners are found twice."""
    rows, columns = grid.shape[:2]
    place = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).astype(np.float64)
    square_px = float(np.median(np.linalg.norm(np.diff(grid, axis=1), axis=-1)))
    cv2.setRNGSeed(0)
    _, kept = cv2.findHomography(place.reshape(-1, 2), grid.reshape(-1, 2), cv2.RANSAC, OFF_SQUARES * square_px)
    good = np.zeros((rows, columns), dtype=bool) if kept is None else np.asarray(kept).reshape(rows, columns) > 0
    spans = [
        (top, bottom, left, right)
        for top in range(rows)
        for bottom in range(top + 1, rows + 1)
        for left in range(columns)
        for right in range(left + 1, columns + 1)
        if good[top:bottom, left:right].all()
    ]
    top, bottom, left, right = max(spans, key=lambda s: (s[1] - s[0]) * (s[3] - s[2]), default=(0, 0, 0, 0))
    return grid[top:bottom, left:right]


_FLAGS = ("CALIB_CB_NORMALIZE_IMAGE", "CALIB_CB_EXHAUSTIVE", "CALIB_CB_ACCURACY", "CALIB_CB_LARGER")


def _firsts(grid: FloatArray, board: Board, shape: tuple[int, ...]) -> tuple[int, int] | None:
    """Row and column on the board of a grid's first corner; None where it is no part that an edge explains."""
    if np.isfinite(grid[..., 0]).sum() < LEAST_PART:
        return None
    row = _first(grid, board.rows, shape)
    column = _first(grid.transpose(1, 0, 2), board.columns, shape)
    return None if row is None or column is None else (row, column)


def _first(lines: FloatArray, count: int, shape: tuple[int, ...]) -> int | None:
    """Number of the first of some lines of corners of a board that has so many; None where no edge cuts it."""
    missing = count - len(lines)
    if missing < 0:
        return None
    before = _is_cut(lines[0], lines[1], shape)
    behind = _is_cut(lines[-1], lines[-2], shape)
    if missing and not (before or behind):
        return None
    if before and behind:
        return missing // 2
    return missing if before else 0


def _is_cut(last: FloatArray, inner: FloatArray, shape: tuple[int, ...]) -> bool:
    """Whether the line of corners beyond the last one would leave the picture, at least for a part."""
    beyond = last + _SQUARES_TO_EDGE * (last - inner)
    beyond = beyond[np.isfinite(beyond[:, 0])]
    size = np.array(shape[1::-1])
    return bool(np.isnan(last).any() or ((beyond < 0) | (beyond > size - 1)).any())
