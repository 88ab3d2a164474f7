"""Boards in pictures: corners where they are, and pictures that cannot be used named with their fault."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.lenses.boards import Board
from calibration.lenses.detection import detect_board, points_of
from calibration.lenses.lens import project_points
from tests.calibration.lenses.board_world import BOARD, CAMERA, Stand, photograph, printed, stand, truth

CHARUCO = Board(kind="charuco", columns=9, rows=7, square_m=0.03, marker_m=0.022)
CIRCLES = Board(kind="circles", columns=8, rows=6, square_m=0.03)
ASYMMETRIC = Board(kind="asymmetric-circles", columns=4, rows=11, square_m=0.02)


EVEN = Board(kind="asymmetric-circles", columns=5, rows=8, square_m=0.018)


@pytest.fixture(scope="module")
def chessboard() -> Stand:
    return stand(truth(1), 0, printed(BOARD))


@pytest.fixture(scope="module")
def charuco() -> Stand:
    return stand(truth(1, board=CHARUCO), 0, printed(CHARUCO))


@pytest.mark.parametrize("board", [BOARD, CHARUCO, CIRCLES, ASYMMETRIC], ids=lambda board: board.kind)
def test_corners_are_where_the_lens_has_them(board: Board) -> None:
    state = truth(1, board=board)
    found = detect_board(photograph(stand(state, 0, printed(board))), board, 255)
    assert found.problem == ""
    assert len(found.ids) == len(board.points_m)
    places = board.points_m[found.ids] @ state.rotations[0][:, :2].T + state.translations_m[0]
    wanted = project_points(CAMERA, places)
    nearest = np.linalg.norm(found.xy_px[:, None] - wanted[None], axis=2).min(axis=1)
    assert np.sqrt((nearest**2).mean()) < 0.15  # a chessboard may be numbered from its other end


@pytest.mark.parametrize("board", [BOARD, CIRCLES, ASYMMETRIC, EVEN], ids=lambda board: f"{board.kind}-{board.rows}")
def test_corners_are_numbered_as_the_board_or_a_turn_of_it(board: Board) -> None:
    found = detect_board(photograph(stand(truth(1, board=board), 0, printed(board))), board, 255)
    to_picture, _ = cv2.findHomography(board.points_m, found.xy_px)
    pictured = cv2.perspectiveTransform(board.points_m.reshape(-1, 1, 2), to_picture).reshape(-1, 2)
    assert np.abs(pictured - found.xy_px).max() < 2.0  # what the lens bends
    assert np.linalg.det(to_picture) > 0


@pytest.mark.parametrize("board", [CIRCLES, EVEN], ids=lambda board: board.kind)
@pytest.mark.parametrize(("columns", "rows"), [(-1, 0), (0, -1), (-1, -2), (1, 0), (0, 2)])
def test_circles_of_another_board_are_named(board: Board, columns: int, rows: int) -> None:
    picture = photograph(stand(truth(1, board=board), 0, printed(board)))
    said = replace(board, columns=board.columns + columns, rows=board.rows + rows)
    assert "correct [board] columns and rows" in detect_board(picture, said, 255).problem


def test_a_mirrored_board_of_circles_is_named_where_its_mirror_image_is_another_board() -> None:
    picture = photograph(stand(truth(1, board=EVEN), 0, printed(EVEN)))
    assert "is mirrored" in detect_board(np.ascontiguousarray(picture[:, ::-1]), EVEN, 255).problem


def test_a_charuco_board_may_be_cut_by_the_edge_of_the_picture(charuco: Stand) -> None:
    found = detect_board(np.ascontiguousarray(photograph(charuco)[:, :320]), CHARUCO, 255)
    assert found.problem == ""
    assert 8 <= len(found.ids) < len(CHARUCO.points_m)


def test_a_large_picture_is_searched_small_and_measured_whole(chessboard: Stand) -> None:
    small = photograph(chessboard)
    large = cv2.resize(small, None, fx=5, fy=5, interpolation=cv2.INTER_CUBIC)
    one, other = detect_board(small, BOARD, 255), detect_board(large, BOARD, 255)
    assert np.abs((other.xy_px + 0.5) / 5 - 0.5 - one.xy_px).max() < 0.3


@pytest.mark.parametrize(
    ("light", "blur_px", "words"), [(430, 0.7, "saturated"), (200, 7.0, "blurred"), (3, 0.7, "differ by")]
)
def test_a_bad_photograph_is_named(chessboard: Stand, light: float, blur_px: float, words: str) -> None:
    found = detect_board(photograph(chessboard, light=light, blur_px=blur_px), BOARD, 255)
    assert words in found.problem


def test_another_board_is_named_with_its_size(chessboard: Stand) -> None:
    other = Board(kind="chessboard", columns=8, rows=6, square_m=0.03)
    assert "9 × 6 inner corners, the manifest says 8 × 6" in detect_board(photograph(chessboard), other, 255).problem


def test_a_mirrored_photograph_is_named(charuco: Stand) -> None:
    mirrored = np.ascontiguousarray(photograph(charuco)[:, ::-1])
    assert "mirrored" in detect_board(mirrored, CHARUCO, 255).problem


def test_another_charuco_board_is_named(charuco: Stand) -> None:
    other = Board(kind="charuco", columns=5, rows=4, square_m=0.03, marker_m=0.022)
    assert "ends at 9" in detect_board(photograph(charuco), other, 255).problem


def test_a_picture_without_a_board_is_named() -> None:
    noise = np.random.default_rng(0).integers(80, 120, (480, 640)).astype(np.uint8)
    assert "no board of 9 × 6" in detect_board(noise, BOARD, 255).problem


@pytest.mark.parametrize(("square_m", "right"), [(25.0, "0.025"), (2.5e-5, "0.025")])
def test_a_unit_mistaken_by_a_thousand_is_named_with_the_right_number(square_m: float, right: str) -> None:
    with pytest.raises(CalibrationError, match=f"square_m = {right}"):
        Board(kind="chessboard", columns=9, rows=6, square_m=square_m).check()


@pytest.mark.parametrize("shape", [(7, 1, 2), (7, 2)])
def test_points_have_one_shape_whatever_opencvs_version(shape: tuple[int, ...]) -> None:
    assert points_of(np.zeros(shape, np.float32)).shape == (7, 2)
    assert points_of(None).shape == (0, 2)
