"""Grids of circles in pictures, and whether what was found is all of the board."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

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

_LEVELS, _REPEATED = 20, 4
"""Levels at which spots are looked for, and at how many of them a circle shows: noise splits one at two, where the
level is the circle's own."""


def find_circles(shown: NDArray[np.uint8], board: Board) -> FloatArray:
    """(N, 2) centres of a board's circles in their order, or none."""
    kind = "CALIB_CB_ASYMMETRIC_GRID" if board.kind == "asymmetric-circles" else "CALIB_CB_SYMMETRIC_GRID"
    # OpenCV's detector has some circles twice, and then finds no grid; so it is given their middles, each once.
    settings = cv2.CirclesGridFinderParameters()
    spots = [_spots(np.asarray(image, dtype=np.uint8))[0].astype(np.float32) for image in (shown, 255 - shown)]
    for extra in (0, int(cv2.CALIB_CB_CLUSTERING)):
        for middles in spots:
            if len(middles) < board.columns * board.rows:
                continue
            flags = int(getattr(cv2, kind)) + extra
            size = (board.columns, board.rows)
            found, centres = cv2.findCirclesGrid(  # type: ignore[call-overload]
                middles.reshape(-1, 1, 2), size, flags=flags, blobDetector=None, parameters=settings
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
    spots = max((_alike(image) for image in (shown, 255 - shown)), key=len)
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


def _alike(shown: NDArray[np.uint8]) -> FloatArray:
    """(N, 2) dark spots of about one size."""
    spots, size_px = _spots(shown)
    return spots[np.abs(np.log(size_px / np.median(size_px))) < np.log(_LIKE)] if len(spots) else spots


def _spots(shown: NDArray[np.uint8]) -> tuple[FloatArray, FloatArray]:
    """(N, 2) middles of dark spots, each once, and (N,) their diameters."""
    found = sorted(_blobs(shown).detect(shown), key=lambda spot: -spot.size)
    spots, sizes = np.array([spot.pt for spot in found]).reshape(-1, 2), np.array([spot.size for spot in found])
    if not len(spots):
        return spots, sizes
    pairs = cKDTree(spots).query_pairs(sizes[0] / 2, output_type="ndarray")
    within = np.linalg.norm(spots[pairs[:, 0]] - spots[pairs[:, 1]], axis=1) < sizes[pairs.min(axis=1)] / 2
    once = np.ones(len(spots), dtype=bool)
    once[pairs.max(axis=1)[within]] = False
    return spots[once], sizes[once]


def _blobs(shown: NDArray[np.uint8]) -> Any:
    """Return a detector of spots, at levels that lie evenly between a picture's darkest and brightest."""
    settings = cv2.SimpleBlobDetector_Params()  # type: ignore[attr-defined]
    settings.minArea, settings.maxArea = 12.0, shown.shape[0] * shown.shape[1] / 50.0
    settings.minDistBetweenBlobs = 4.0
    dark, bright = np.percentile(shown, (1, 99)).tolist()
    settings.minThreshold, settings.maxThreshold = dark, max(bright, dark + 2 * _LEVELS)
    settings.thresholdStep = (settings.maxThreshold - dark) / _LEVELS
    settings.minRepeatability = _REPEATED
    return cv2.SimpleBlobDetector_create(settings)  # type: ignore[attr-defined]
