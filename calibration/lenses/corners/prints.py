"""Boards as they are printed, blurred as a photograph of them is."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.arrays import FloatArray
from calibration.lenses.boards import Board

TEXELS = 64
"""Of the print, along a square: a marker's bits are then eight of them, and finer than pixels of most photographs."""
_BESIDE_MARKERS = 0.6
"""Of the white margin around markers, counted from the squares' sides: what lies there is asked. Markers themselves are
often printed half a dot aside."""
_AROUND_CIRCLES = 0.5
"""Of the distance of neighbouring circles, from a circle's middle: what lies there is asked."""
_LEAST_RADIUS, _LARGEST_RADIUS = 0.1, 0.46
"""Of the distance of neighbours: circles beyond are no circles, or touch each other."""
_SHARPEST_PX = 0.3
"""Standard deviation of the blur by a square pixel alone."""
_SIDE = 48
"""Samples, each way, in which a circle's share of the window around it is counted."""


@dataclass(frozen=True, eq=False)
class Print:
    """A board as it is printed, as sharp as the photograph."""

    picture: NDArray[np.float32]
    asked: NDArray[np.float32]
    """1 where it is compared, 0 where it is not."""
    texel_from_board: FloatArray
    """(3, 3) from metres on the board."""


def print_of(shown: NDArray[np.float32], board: Board, xy_px: FloatArray, *, square_px: float, edge_px: float) -> Print:
    """Draw a board as sharp as a photograph.

    Parameters
    ----------
    shown : (H, W)
        The photograph, which tells how large the board's circles are.
    board : Board
    xy_px : (N, 2)
        All of its circles; of other boards any corners.
    square_px : float
        Distance of neighbouring corners in it.
    edge_px : float
        Width of an edge from dark to bright.

    Returns
    -------
    Print
        With nothing to compare when circles are too small, or touch each other.
    """
    if board.kind == "charuco":
        picture, asked = _charuco(board)
    elif board.kind == "chessboard":
        picture, asked = _chessboard(board)
    else:
        picture, asked = _circles(board, _radius_m(shown, board, xy_px))
    # The first corner is a square from the print's edge; whole numbers are the middles of texels.
    scale, shift = TEXELS / board.square_m, TEXELS - 0.5
    matrix = np.array([[scale, 0, shift], [0, scale, shift], [0, 0, 1.0]])
    # An edge that a Gaussian of s blurs is sqrt(2 pi) s wide, by its steepest place.
    blur_px = max(edge_px / np.sqrt(2 * np.pi), _SHARPEST_PX)
    blur = blur_px / square_px * neighbour_m(board) * scale
    soft = cv2.GaussianBlur(picture, (0, 0), blur, borderType=cv2.BORDER_REPLICATE)
    return Print(soft.astype(np.float32), asked, matrix)


def neighbour_m(board: Board) -> float:
    """Distance of neighbouring corners on a board."""
    return board.square_m * (np.sqrt(2) if board.kind == "asymmetric-circles" else 1.0)


def _chessboard(board: Board) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    row, column = np.mgrid[: (board.rows + 1) * TEXELS, : (board.columns + 1) * TEXELS] // TEXELS
    return ((row + column) % 2).astype(np.float32), np.ones(row.shape, np.float32)


def _charuco(board: Board) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    picture = board.charuco().generateImage((board.columns * TEXELS, board.rows * TEXELS))
    margin = _BESIDE_MARKERS * (1 - board.marker_m / board.square_m) / 2 * TEXELS
    row, column = (np.abs((np.arange(size) + 0.5 + TEXELS / 2) % TEXELS - TEXELS / 2) for size in picture.shape)
    beside = np.minimum(row[:, None], column[None, :]) < margin
    return (picture / 255).astype(np.float32), beside.astype(np.float32)


def _circles(board: Board, radius_m: float) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Dark discs on white, to a tenth of a texel at their rims."""
    width, height = np.ceil((board.points_m.max(axis=0) / board.square_m + 2) * TEXELS).astype(int)
    near = np.full((height, width), np.inf)
    reach = int(np.ceil(TEXELS * neighbour_m(board) / board.square_m))
    for x, y in (board.points_m / board.square_m + 1) * TEXELS - 0.5:
        left, top = max(int(x) - reach, 0), max(int(y) - reach, 0)
        row, column = np.mgrid[top : min(int(y) + reach, height), left : min(int(x) + reach, width)]
        part = near[top : top + row.shape[0], left : left + row.shape[1]]
        np.minimum(part, np.hypot(column - x, row - y), out=part)
    texels = TEXELS / board.square_m
    white = np.clip(near - radius_m * texels + 0.5, 0, 1)
    within = (near < _AROUND_CIRCLES * neighbour_m(board) * texels) & bool(radius_m)
    return white.astype(np.float32), within.astype(np.float32)


def _radius_m(shown: NDArray[np.float32], board: Board, xy_px: FloatArray) -> float:
    """Radius of a board's circles, by the share of their surroundings that is theirs; 0 where none is plausible."""
    to_picture = np.asarray(cv2.findHomography(board.points_m, xy_px, 0)[0], dtype=np.float64)
    if to_picture.shape != (3, 3):
        return 0.0
    half = neighbour_m(board) / 2
    y, x = ((np.mgrid[:_SIDE, :_SIDE] + 0.5) / _SIDE * 2 - 1) * half
    shares = []
    for place, pixel in zip(board.points_m, xy_px, strict=True):
        points = np.column_stack([x.ravel() + place[0], y.ravel() + place[1]]).reshape(-1, 1, 2)
        there = cv2.perspectiveTransform(points, to_picture).reshape(-1, 2)
        there += pixel - cv2.perspectiveTransform(place.reshape(1, 1, 2), to_picture).reshape(2)
        u, v = (axis.reshape(_SIDE, _SIDE).astype(np.float32) for axis in there.T)
        part = cv2.remap(shown, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        low, high = np.percentile(part, (3, 97))
        middle = part[_SIDE // 2 - 1 : _SIDE // 2 + 1, _SIDE // 2 - 1 : _SIDE // 2 + 1].mean()
        dark = part < (low + high) / 2
        shares.append(float(dark.mean() if middle < (low + high) / 2 else 1 - dark.mean()))
    radius = 2 * half * np.sqrt(np.median(shares) / np.pi)
    return float(radius) if _LEAST_RADIUS < radius / (2 * half) < _LARGEST_RADIUS else 0.0
