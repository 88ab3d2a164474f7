"""Grids of circles in pictures, and whether what was found is all of the board."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.arrays import FloatArray
from calibration.lenses.boards import Board

_REACH = 0.3
"""Of the distance of neighbours: so near to where a grid goes on lies a circle that belongs to it. Perspective that the
found part tells within a few per cent carries no farther than one row."""
_MISFIT = 0.15
"""Of the distance of neighbours, by root mean square: a lens bends a board by less, a grid that is taken askew by more.
"""
_MOST_OTHER = 0.5
"""Share of a side's places beyond the grid with a circle each: more are no dirt."""
_LEAST_CIRCLES = 20
"""Spots of one size below which there is no board in a picture."""
_LIKE = 3.0
"""Ratio of diameters within which spots are circles of one board, seen at a slant."""


def find_circles(shown: NDArray[np.uint8], board: Board) -> FloatArray:
    """(N, 2) centres of a board's circles in their order, or none."""
    kind = "CALIB_CB_ASYMMETRIC_GRID" if board.kind == "asymmetric-circles" else "CALIB_CB_SYMMETRIC_GRID"
    for extra in (0, int(cv2.CALIB_CB_CLUSTERING)):
        for image in (shown, 255 - shown):
            found, centres = cv2.findCirclesGrid(
                image,
                (board.columns, board.rows),
                flags=int(getattr(cv2, kind)) + extra,
                blobDetector=_blobs(shown.shape),
            )
            numbered = _numbered(board, np.asarray(centres, dtype=np.float64).reshape(-1, 2)) if found else None
            if numbered is not None:
                return numbered
    return np.zeros((0, 2))


def _numbered(board: Board, centres: FloatArray) -> FloatArray | None:
    """Return the circles in the order in which they are the board, not its mirror image; none where there is no such.

    Of asymmetric boards with an even number of rows OpenCV exchanges the rows of each pair.
    """
    grid, places = centres.reshape(board.rows, board.columns, 2), _places(board.columns, board.rows, board)
    pairs = board.rows % 2 == 0
    exchanged = grid.reshape(-1, 2, board.columns, 2)[:, ::-1].reshape(grid.shape) if pairs else grid
    for ordered in (each[::down, ::right] for each in (grid, exchanged) for down in (1, -1) for right in (1, -1)):
        xy = ordered.reshape(-1, 2)
        slopes = np.linalg.lstsq(np.column_stack([places, np.ones(len(places))]), xy, rcond=None)[0]
        to_picture = cv2.findHomography(places, xy)[0]
        if np.linalg.det(slopes[:2]) <= 0 or to_picture is None:
            continue
        off = np.linalg.norm(_pictured(to_picture, places) - xy, axis=1)
        if np.sqrt(np.mean(off**2)) < _MISFIT * np.sqrt(np.linalg.det(slopes[:2])):
            return np.ascontiguousarray(xy)
    return None


def why_other_circles(shown: NDArray[np.uint8], board: Board, found: FloatArray) -> str:
    """Say that a picture shows a board of more, or of fewer circles than the manifest says; empty if it does not.

    Parameters
    ----------
    shown : (H, W)
        The picture in which they were looked for.
    board : Board
        As the manifest says.
    found : (N, 2)
        Its circles, if they were found.
    """
    spots = max((_spots(image) for image in (shown, 255 - shown)), key=len)
    asked = f"{board.columns} × {board.rows}"
    if len(found):
        sides = _sides_that_go_on(board, found, spots)
        more = f"shows more circles {sides} of the {asked} that the manifest says: correct [board] columns and rows"
        return more if sides else ""
    expected = board.columns * board.rows
    is_other = len(spots) < expected or len(spots) >= expected + min(board.columns, board.rows)
    if len(spots) < _LEAST_CIRCLES or not is_other:
        return ""
    return (
        f"shows {len(spots)} circles of one size, a board of {board.words} has {expected}: correct [board] columns and "
        "rows, or show all of the board, with light on all of it"
    )


def _sides_that_go_on(board: Board, found: FloatArray, spots: FloatArray) -> str:
    """On which sides of the grid a row or column of further circles lies."""
    to_picture = cv2.findHomography(_places(board.columns, board.rows, board), found)[0]
    sides = []
    for name, places in _beyond(board).items():
        there, step = (_pictured(to_picture, places + shift) for shift in (0.0, 0.5))
        reach = 2 * _REACH * np.linalg.norm(step - there, axis=1) / 2**0.5
        near = np.linalg.norm(there[:, None] - spots[None], axis=2).min(axis=1) if len(spots) else np.inf
        if np.mean(near < reach) > _MOST_OTHER:
            sides.append(name)
    return " and ".join(sides)


def _places(columns: int, rows: int, board: Board) -> FloatArray:
    """(N, 2) of a grid's circles, in distances of neighbours."""
    row, column = np.divmod(np.arange(columns * rows), columns)
    if board.kind == "asymmetric-circles":
        column = 2 * column + row % 2
    return np.column_stack([column, row]).astype(np.float64)


def _beyond(board: Board) -> dict[str, FloatArray]:
    """Where the next circles would be, on each side of the grid."""
    step = 2 if board.kind == "asymmetric-circles" else 1
    down, right = np.arange(board.rows), step * np.arange(board.columns)
    shift = down % 2 if step == 2 else np.zeros(board.rows)
    above, below = ((number % 2 if step == 2 else 0) for number in (-1, board.rows))
    return {
        "left": np.column_stack([shift - step, down]),
        "right": np.column_stack([shift + step * board.columns, down]),
        "above": np.column_stack([right + above, np.full(board.columns, -1.0)]),
        "below": np.column_stack([right + below, np.full(board.columns, float(board.rows))]),
    }


def _pictured(to_picture: NDArray[Any], places: FloatArray) -> FloatArray:
    """(N, 2) places on the board as the picture has them."""
    pictured = cv2.perspectiveTransform(places.reshape(-1, 1, 2), to_picture)
    return np.asarray(pictured, dtype=np.float64).reshape(-1, 2)


def _spots(shown: NDArray[np.uint8]) -> FloatArray:
    """(N, 2) dark spots of about one size."""
    spots = _blobs(shown.shape).detect(shown)
    if not spots:
        return np.zeros((0, 2))
    size = np.array([spot.size for spot in spots])
    alike = np.abs(np.log(size / np.median(size))) < np.log(_LIKE)
    return np.asarray(np.array([spot.pt for spot in spots], dtype=np.float64)[alike])


def _blobs(shape: tuple[int, ...]) -> Any:
    settings = cv2.SimpleBlobDetector_Params()  # type: ignore[attr-defined]
    settings.minArea, settings.maxArea = 12.0, shape[0] * shape[1] / 50.0
    settings.minDistBetweenBlobs = 4.0
    return cv2.SimpleBlobDetector_create(settings)  # type: ignore[attr-defined]
