"""Pictures of boards to corners, or to the reason why there are none."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.arrays import FloatArray, Frame, IntArray
from calibration.lenses.boards import Board
from calibration.lenses.corners.circles import find_circles, why_other_circles
from calibration.lenses.corners.cut_boards import is_of_larger_board, largest_part, seen_part
from calibration.lenses.corners.laid_over import refined_by_print

_SEARCHED_PX = 1600
"""Longer side in which a board is looked for; its corners are then refined in the whole picture."""
_LEAST_CORNERS = 8
_BLURRED_SHARE, _BLURRED_PX = 0.3, 8.0
"""Width of an edge, as a share of a square and in pixels: beyond, a corner is off by more than a tenth of a pixel."""
_SATURATED_SHARE = 0.2
"""Of the pixels within the board, at full scale: bright squares then spill over their corners."""
_FLAT_DN = 8.0
"""Of 255 between a board's dark and bright squares: less is no board, or no light."""
CIRCLES = ("circles", "asymmetric-circles")
_LEAST_OTHER = 20
"""Corners below which a board of another size is chance."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Detection:
    """What was found of a board in one picture."""

    ids: IntArray
    """(N,) numbers of the corners, as ``Board.points_m`` counts them."""
    xy_px: FloatArray
    """(N, 2)"""
    problem: str = ""
    """Why the picture cannot be used, and what to do; empty when it can."""
    edge_px: float = float("nan")
    """Width of an edge from dark to bright."""
    square_px: float = float("nan")
    """Distance of neighbouring corners."""
    bright_dn: float = float("nan")
    """Level of the bright squares."""


NOTHING = Detection(ids=np.zeros(0, dtype=np.int64), xy_px=np.zeros((0, 2)))


def detect_board(picture: Frame, board: Board, full_scale_dn: float) -> Detection:
    """Find a board's corners in a picture.

    Parameters
    ----------
    picture : (H, W)
        Levels that rise with light. [dn]
    board : Board
    full_scale_dn : float
        Largest level.

    Returns
    -------
    Detection
        With a problem in words when the picture cannot be used.
    """
    shown = _eight_bits(picture)
    found = _corners(shown, board)
    if len(found[0]) < _LEAST_CORNERS:
        return _nothing(_why_not(shown, board, len(found[0])))
    ids, xy = found
    square = _square_px(ids, xy, board)
    edge, dark, bright = _edge(picture, xy, square)
    problem = _quality(picture, xy, full_scale_dn=full_scale_dn, square_px=square, edge_px=edge)
    if not problem and board.kind in CIRCLES:
        problem = why_other_circles(shown, board, xy)
    if not problem and (bright - dark) < _FLAT_DN / 255 * full_scale_dn:
        problem = f"the board's squares differ by {bright - dark:.0f} dn only: light it, or expose longer"
    if not problem:
        ids, xy = refined_by_print(picture, board, ids, xy, square_px=square, edge_px=edge)
    return Detection(ids=ids, xy_px=xy, problem=problem, edge_px=edge, square_px=square, bright_dn=bright)


def _nothing(problem: str) -> Detection:
    return Detection(ids=NOTHING.ids, xy_px=NOTHING.xy_px, problem=problem)


def _eight_bits(picture: Frame) -> NDArray[np.uint8]:
    """Stretch to 8 bits; OpenCV's detectors take nothing else."""
    if picture.dtype == np.uint8:
        return np.ascontiguousarray(picture)
    top = max(float(np.percentile(picture, 99.8)), 1e-9)
    return np.asarray(np.clip(picture * (255 / top), 0, 255).astype(np.uint8))


def points_of(result: Any) -> FloatArray:
    """(N, 2) of what OpenCV returns for points: (N, 1, 2) before version 5, (N, 2) since; None for no points."""
    if result is None:
        return np.zeros((0, 2))
    return np.asarray(result, dtype=np.float64).reshape(-1, 2)


def flag(*names: str) -> int:
    """Return the sum of OpenCV's flags that this version has."""
    return sum(int(getattr(cv2, name, 0)) for name in names)


def _corners(shown: NDArray[np.uint8], board: Board) -> tuple[IntArray, FloatArray]:
    if board.kind == "charuco":
        return _charuco(shown, board)
    factor = max(1, -(-max(shown.shape) // _SEARCHED_PX))
    small = shown if factor == 1 else _smaller(shown, factor)
    found = _chessboard(small, board) if board.kind == "chessboard" else find_circles(small, board)
    ids = np.arange(len(found))
    if board.kind == "chessboard" and len(found):
        if is_of_larger_board(small, found.reshape(board.rows, board.columns, 2)):
            return NOTHING.ids, NOTHING.xy_px
    if not len(found):
        sharp = board.kind == "chessboard" and not _is_blurred(small)  # edges tell which corners are neighbours
        part = largest_part(small, board) if sharp else None
        if part is None or part.ids is None:
            return NOTHING.ids, NOTHING.xy_px
        found, ids = part.xy_px, part.ids
    xy = (found + 0.5) * factor - 0.5
    if factor > 1:
        xy = _refined(shown, xy, _square_px(ids, xy, board)) if board.kind == "chessboard" else xy
    return ids, xy


def _smaller(shown: NDArray[np.uint8], factor: int) -> NDArray[np.uint8]:
    height, width = (size // factor for size in shown.shape)
    cut = shown[: height * factor, : width * factor]
    return np.asarray(cv2.resize(cut, (width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _chessboard(shown: NDArray[np.uint8], board: Board) -> FloatArray:
    size = (board.columns, board.rows)
    for flags in (
        flag("CALIB_CB_NORMALIZE_IMAGE", "CALIB_CB_ACCURACY"),
        flag("CALIB_CB_NORMALIZE_IMAGE", "CALIB_CB_EXHAUSTIVE", "CALIB_CB_ACCURACY"),
    ):
        found, corners = cv2.findChessboardCornersSB(shown, size, flags=flags)
        if found:
            return points_of(corners)
    found, corners = cv2.findChessboardCorners(
        shown, size, flags=flag("CALIB_CB_ADAPTIVE_THRESH", "CALIB_CB_NORMALIZE_IMAGE", "CALIB_CB_FAST_CHECK")
    )
    if not found:
        return NOTHING.xy_px
    xy = points_of(corners)
    return _refined(shown, xy, _square_px(np.arange(len(xy)), xy, board))


def _refined(shown: NDArray[np.uint8], xy: FloatArray, square_px: float) -> FloatArray:
    half = int(np.clip(0.3 * square_px, 2, 25))
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-4)
    start = np.ascontiguousarray(xy.astype(np.float32).reshape(-1, 1, 2))
    return points_of(cv2.cornerSubPix(shown, start, winSize=(half, half), zeroZone=(-1, -1), criteria=criteria))


def _charuco(shown: NDArray[np.uint8], board: Board) -> tuple[IntArray, FloatArray]:
    corners, ids, _, _ = cv2.aruco.CharucoDetector(board.charuco()).detectBoard(shown)
    xy = points_of(corners)
    if not len(xy):
        return NOTHING.ids, xy
    numbers = np.asarray(ids, dtype=np.int64).ravel()
    order = np.argsort(numbers)
    ids_sorted, xy = numbers[order], xy[order]
    return ids_sorted, xy


def _square_px(ids: IntArray, xy: FloatArray, board: Board) -> float:
    """Median distance in the picture of corners that are neighbours on the board."""
    places = board.points_m[ids] / board.square_m
    apart = np.linalg.norm(places[:, None] - places[None], axis=2)
    nearest = np.where(apart > 0, apart, np.inf)
    first, second = np.nonzero(nearest <= nearest.min() + 1e-6)
    return float(np.median(np.linalg.norm(xy[first] - xy[second], axis=1)))


def _why_not(shown: NDArray[np.uint8], board: Board, corners: int) -> str:
    """What is wrong with a picture in which the board was not found."""
    contrast = float(np.percentile(shown, 95)) - float(np.percentile(shown, 5))
    if contrast < _FLAT_DN:
        return f"nothing to be seen: its levels differ by {contrast:.0f} of 255; light the board, or expose longer"
    if board.kind == "charuco":
        return _why_no_charuco(shown, board, corners)
    if board.kind != "chessboard" and len(_corners(np.ascontiguousarray(shown[:, ::-1]), board)[0]):
        return "is mirrored: give the photograph as the camera took it"
    if board.kind in CIRCLES and not _is_blurred(shown):
        other_circles = why_other_circles(shown, board, NOTHING.xy_px)
        if other_circles:
            return other_circles
    other = _other_size(shown, board)
    if other is not None:
        cut = ", or show all of the board: part of it may lie outside the picture"
        fewer = other[0] * other[1] < board.columns * board.rows
        return (
            f"shows a board of {other[0]} × {other[1]} inner corners, the manifest says {board.columns} × "
            f"{board.rows}: "
            f"correct [board] columns and rows (corners between squares, not squares){cut if fewer else ''}"
        )
    if _is_blurred(shown):
        return "is blurred: no sharp edge in it; focus on the board, and hold it still"
    return (
        f"no board of {board.words} found: all of it has to be in the picture with a bright rim, lit evenly, and not "
        "tilted by more than 60 degrees"
    )


def _other_size(shown: NDArray[np.uint8], board: Board) -> tuple[int, int] | None:
    """Columns and rows of a chessboard of another size than the expected one."""
    if board.kind != "chessboard":
        return None
    factor = max(1, -(-max(shown.shape) // _SEARCHED_PX))
    part = seen_part(shown if factor == 1 else _smaller(shown, factor), board)
    return None if part is None or len(part.xy_px) < _LEAST_OTHER else part.size


def _why_no_charuco(shown: NDArray[np.uint8], board: Board, corners: int) -> str:
    markers = len(_markers(shown, board))
    mirrored = len(_markers(np.ascontiguousarray(shown[:, ::-1]), board))
    if mirrored > max(2 * markers, 3):
        return "is mirrored: give the photograph as the camera took it"
    expected = board.columns * board.rows // 2
    beyond = [number for number in _markers(shown, board) if number >= expected]
    if beyond:
        return (
            f"shows marker {max(beyond)}, a board of {board.words} ends at {expected - 1}: correct [board] columns "
            "and rows (squares), or its dictionary"
        )
    if _is_blurred(shown):
        return "is blurred: no sharp edge in it; focus on the board, and hold it still"
    if markers:
        return (
            f"{markers} markers but only {corners} corners found, {_LEAST_CORNERS} are needed: show more of the board; "
            "check columns and rows (squares) and legacy (boards printed by OpenCV before 4.6)"
        )
    return f"no marker of {board.dictionary} found: check [board] dictionary, focus and light"


def _markers(shown: NDArray[np.uint8], board: Board) -> list[int]:
    detector = cv2.aruco.ArucoDetector(board.charuco().getDictionary())
    _, ids, _ = detector.detectMarkers(shown)
    return [] if ids is None else [int(number) for number in np.asarray(ids).ravel()]


def _is_blurred(shown: NDArray[np.uint8]) -> bool:
    """Whether the steepest edges of a picture are wide against its contrast."""
    contrast = float(np.percentile(shown, 98)) - float(np.percentile(shown, 2))
    steepest = float(np.percentile(_gradient(shown.astype(np.float32)), 99.8))
    return contrast / max(steepest, 1e-6) > _BLURRED_PX


def _gradient(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """(H, W) change of level per pixel."""
    x = cv2.Sobel(values, cv2.CV_32F, 1, 0, ksize=3, scale=0.125)
    y = cv2.Sobel(values, cv2.CV_32F, 0, 1, ksize=3, scale=0.125)
    return np.asarray(np.hypot(x, y))


def _edge(picture: Frame, xy: FloatArray, square_px: float) -> tuple[float, float, float]:
    """Median over corners of an edge's width [px], and the levels of dark and bright squares [dn]."""
    half = int(np.clip(0.7 * square_px, 3, 40))
    widths, darks, brights = [], [], []
    for x, y in np.rint(xy).astype(int)[:: max(1, len(xy) // 40)]:
        window = picture[max(y - half, 0) : y + half + 1, max(x - half, 0) : x + half + 1].astype(np.float32)
        dark, bright = np.percentile(window, (8, 92))
        steep = float(np.percentile(_gradient(window), 98))
        widths.append((bright - dark) / max(steep, 1e-6))
        darks.append(dark)
        brights.append(bright)
    return float(np.median(widths)), float(np.median(darks)), float(np.median(brights))


def _quality(picture: Frame, xy: FloatArray, *, full_scale_dn: float, square_px: float, edge_px: float) -> str:
    left, top = np.maximum(np.floor(xy.min(axis=0)), 0).astype(int)
    right, bottom = np.ceil(xy.max(axis=0)).astype(int) + 1
    clipped = float((picture[top:bottom, left:right] >= full_scale_dn).mean())
    if clipped > _SATURATED_SHARE:
        return (
            f"is saturated: {100 * clipped:.0f} % of the board's pixels are at full scale, the limit is "
            f"{100 * _SATURATED_SHARE:.0f} %; expose shorter"
        )
    if edge_px > max(_BLURRED_SHARE * square_px, min(_BLURRED_PX, 0.5 * square_px)):
        return (
            f"is blurred: an edge is {edge_px:.1f} px wide, a square {square_px:.0f} px; focus on the board and hold "
            "it still"
        )
    return ""
