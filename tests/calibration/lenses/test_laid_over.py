"""Corners that are refined by the board's own print: where they are to a hundredth of a pixel, whatever lies beside."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from calibration.arrays import FloatArray
from calibration.lenses.boards import Board
from calibration.lenses.corners.laid_over import refined_by_print
from calibration.lenses.detection import Detection, detect_board

CHESSBOARD = Board(kind="chessboard", columns=9, rows=6, square_m=0.03)
CHARUCO = Board(kind="charuco", columns=10, rows=7, square_m=0.03, marker_m=0.0225)
CIRCLES = Board(kind="circles", columns=8, rows=6, square_m=0.03)
ASYMMETRIC = Board(kind="asymmetric-circles", columns=4, rows=11, square_m=0.02)
BOARDS = pytest.mark.parametrize("board", [CHESSBOARD, CHARUCO, CIRCLES, ASYMMETRIC], ids=lambda board: board.kind)
SIZE = (900, 640)
FINE = 4
"""Samples of a pixel, each way."""
DOTS = 150
"""Of the print, on a square: none of the sizes that the refinement draws."""


def print_of(board: Board, *, markers_aside: int = 0) -> tuple[np.ndarray, FloatArray]:
    """A print with a white rim, and the dots of its corners."""
    if board.kind == "charuco":
        plain = board.charuco().generateImage((board.columns * DOTS, board.rows * DOTS))
        squares = (np.add(*np.mgrid[: board.rows * DOTS, : board.columns * DOTS] // DOTS) % 2) == 0
        moved = np.where(squares, 0, np.roll(plain, (markers_aside, markers_aside), axis=(0, 1)))
        picture = np.where(squares, 0, np.where(np.roll(squares, (markers_aside,) * 2, axis=(0, 1)), 255, moved))
        return np.pad(picture, DOTS, constant_values=255), board.points_m / board.square_m * DOTS + 2 * DOTS - 0.5
    width, height = (board.points_m.max(axis=0) / board.square_m + 4).astype(int)
    if board.kind == "chessboard":
        row, column = np.mgrid[:height, :width]
        inside = (row > 0) & (column > 0) & (row < height - 1) & (column < width - 1)
        cells = np.where(inside & ((row + column) % 2 == 0), 0, 255)
        return np.kron(cells, np.ones((DOTS, DOTS))), board.points_m / board.square_m * DOTS + 2 * DOTS - 0.5
    corners = (board.points_m / board.square_m + 2) * DOTS - 0.5
    row, column = np.mgrid[: height * DOTS, : width * DOTS]
    picture = np.full(row.shape, 255)
    for x, y in corners:
        picture[np.hypot(column - x, row - y) < 0.33 * DOTS] = 0
    return picture, corners


def pictured(
    board: Board, *, seed: int = 3, markers_aside: int = 0, tone: float = 1.0
) -> tuple[np.ndarray, FloatArray]:
    """A tilted board, blurred and noisy, and where its corners are."""
    random = np.random.default_rng(seed)
    picture, dots = print_of(board, markers_aside=markers_aside)
    high, wide = picture.shape
    ends = np.array([[110, 90], [790, 60], [740, 590], [150, 540]]) + random.uniform(-25, 25, (4, 2))
    matrix = cv2.getPerspectiveTransform(
        np.array([[0, 0], [wide - 1, 0], [wide - 1, high - 1], [0, high - 1]], np.float32), ends.astype(np.float32)
    )
    y, x = ((np.mgrid[: SIZE[1] * FINE, : SIZE[0] * FINE] + 0.5) / FINE - 0.5).astype(np.float64)
    there = cv2.perspectiveTransform(np.stack([x, y], axis=-1).reshape(-1, 1, 2), np.linalg.inv(matrix))
    u, v = (part.reshape(x.shape).astype(np.float32) for part in there.reshape(-1, 2).T)
    fine = cv2.remap(picture.astype(np.float32), u, v, cv2.INTER_LINEAR, borderValue=120.0)
    light = 0.1 + 0.75 * cv2.resize(fine, SIZE, interpolation=cv2.INTER_AREA) / 255
    soft = cv2.GaussianBlur(light, (0, 0), 0.8) ** tone
    levels = 230 * soft + random.normal(size=soft.shape)
    corners = cv2.perspectiveTransform(dots.reshape(-1, 1, 2), matrix).reshape(-1, 2)
    return np.clip(np.rint(levels), 0, 255).astype(np.uint8), corners


def off_px(found: Detection, corners: FloatArray) -> FloatArray:
    """(N,) from the truth; boards without names may be numbered from their other end."""
    turns = (corners[found.ids], corners[::-1][found.ids])
    return min((np.linalg.norm(found.xy_px - turn, axis=1) for turn in turns), key=np.median)


@BOARDS
@pytest.mark.parametrize("seed", [3, 4])
def test_corners_of_a_tilted_board_are_where_they_are_to_a_hundredth_of_a_pixel(board: Board, seed: int) -> None:
    picture, corners = pictured(board, seed=seed)
    off = off_px(detect_board(picture, board, 255), corners)
    assert len(off) == len(corners)
    assert np.sqrt((off**2).mean()) < 0.02  # gradients alone leave 0.03 to 0.2
    assert off.max() < 0.07


def test_markers_that_are_printed_aside_pull_no_corner() -> None:
    picture, corners = pictured(CHARUCO, markers_aside=1)  # less than a hundredth of a square, as printers' dots round
    off = off_px(detect_board(picture, CHARUCO, 255), corners)
    assert np.sqrt((off**2).mean()) < 0.02


@BOARDS
def test_a_tone_curve_moves_no_corner(board: Board) -> None:
    picture, corners = pictured(board, tone=1 / 2.2)
    off = off_px(detect_board(picture, board, 255), corners)
    assert np.sqrt((off**2).mean()) < 0.03


def test_a_corner_under_a_finger_is_left_out_and_the_others_stay() -> None:
    picture, corners = pictured(CHESSBOARD)
    found = detect_board(picture, CHESSBOARD, 255)
    x, y = np.rint(found.xy_px[22]).astype(int)
    cv2.circle(picture, (int(x) + 6, int(y) + 4), 12, 140, -1)
    ids, xy = refined_by_print(picture, CHESSBOARD, found.ids, found.xy_px, square_px=68, edge_px=2.5)
    assert 22 not in ids
    assert len(ids) >= len(corners) - 2
    assert off_px(replace(found, ids=ids, xy_px=xy), corners).max() < 0.07


def test_a_board_that_is_printed_otherwise_keeps_the_corners_that_were_found() -> None:
    picture, _ = pictured(CHESSBOARD)
    found = detect_board(picture, CHESSBOARD, 255)
    noise = np.random.default_rng(1).integers(0, 255, picture.shape).astype(np.uint8)
    ids, xy = refined_by_print(noise, CHESSBOARD, found.ids, found.xy_px, square_px=68, edge_px=2.5)
    np.testing.assert_array_equal(ids, found.ids)
    np.testing.assert_array_equal(xy, found.xy_px)


def test_levels_beyond_eight_bits_are_used_as_they_are() -> None:
    picture, corners = pictured(CHESSBOARD)
    sixteen = picture.astype(np.uint16) * 200
    off = off_px(detect_board(sixteen, CHESSBOARD, 65535), corners)
    assert np.sqrt((off**2).mean()) < 0.02


def test_corners_in_one_row_stay_where_they_were_found() -> None:
    picture, corners = pictured(CHARUCO)
    row = np.arange(9)
    ids, xy = refined_by_print(picture, CHARUCO, row, corners[row], square_px=55, edge_px=2.5)
    np.testing.assert_array_equal(ids, row)
    np.testing.assert_array_equal(xy, corners[row])
