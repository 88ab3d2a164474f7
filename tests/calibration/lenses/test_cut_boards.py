"""Chessboards that the edge of the picture cuts."""

import numpy as np
import pytest

from calibration.lenses.boards import Board
from calibration.lenses.detection import detect_board
from calibration.lenses.lens import project_points
from tests.calibration.lenses.board_world import BOARD, CAMERA, photograph, printed, stand, truth


@pytest.fixture(scope="module")
def state():
    return truth(1)


@pytest.fixture(scope="module")
def picture(state):
    return photograph(stand(state, 0, printed(BOARD)))


@pytest.fixture(scope="module")
def corners(state):
    """(6, 9, 2) where the corners are."""
    places = BOARD.points_m @ state.rotations[0][:, :2].T + state.translations_m[0]
    return project_points(CAMERA, places).reshape(6, 9, 2)


@pytest.mark.parametrize("side", ["left", "right", "top", "bottom"])
def test_a_board_that_the_picture_cuts_gives_the_corners_that_are_seen(picture, corners, side):
    x, y = (int(v) for v in (corners[3, 4] + corners[2, 3]) / 2)
    cut = {"left": np.s_[:, x:], "right": np.s_[:, :x], "top": np.s_[y:], "bottom": np.s_[:y]}[side]
    found = detect_board(np.ascontiguousarray(picture[cut]), BOARD, 255)
    assert found.problem == ""
    assert 12 <= len(found.ids) < 54
    xy = found.xy_px + {"left": (x, 0), "top": (0, y)}.get(side, (0, 0))
    apart = np.linalg.norm(xy[:, None] - corners.reshape(1, -1, 2), axis=2)
    assert apart.min(axis=1).max() < 0.4
    # One numbering of the board, or that of the board turned by half.
    nearest = apart.argmin(axis=1)
    assert (found.ids == nearest).all() or (found.ids == 53 - nearest).all()


@pytest.mark.parametrize("sides", ["top left", "top right", "bottom left", "bottom right", "left right", "top bottom"])
def test_a_board_that_two_sides_cut_is_numbered_as_one_flat_board(picture, corners, sides):
    left, top = int((corners[1, 1] + corners[2, 2])[0] / 2), int((corners[0, 4] + corners[1, 4])[1] / 2)
    bottom, right = picture.shape
    if "right" in sides:
        right = int((corners[2, 6] + corners[3, 7])[0] / 2)
    if "bottom" in sides:
        bottom = int((corners[4, 4] + corners[5, 4])[1] / 2)
    left, top = left * ("left" in sides), top * ("top" in sides)
    found = detect_board(np.ascontiguousarray(picture[top:bottom, left:right]), BOARD, 255)
    assert found.problem == ""
    assert len(found.ids) >= 12
    apart = np.linalg.norm(found.xy_px[:, None] + (left, top) - corners.reshape(1, -1, 2), axis=2)
    assert np.median(apart.min(axis=1)) < 0.2
    nearest = apart.argmin(axis=1)
    # Of both numberings one differs from what is printed by the same rows and columns everywhere.
    steps = [np.subtract(np.divmod(found.ids, 9), np.divmod(one, 9)) for one in (nearest, 53 - nearest)]
    assert any((step == step[:, :1]).all() for step in steps)


@pytest.mark.parametrize("size", [(8, 5), (7, 4), (6, 4), (5, 4), (4, 3), (3, 3)])
def test_a_small_grid_within_a_larger_board_is_refused_with_the_boards_size(picture, size):
    """OpenCV finds some of them, one with every second column of the board."""
    smaller = Board(kind="chessboard", columns=size[0], rows=size[1], square_m=0.03)
    said = detect_board(picture, smaller, 255).problem
    assert f"9 × 6 inner corners, the manifest says {size[0]} × {size[1]}" in said


def test_a_whole_board_of_another_size_is_no_cut_one(picture):
    larger = Board(kind="chessboard", columns=11, rows=8, square_m=0.03)
    assert "9 × 6 inner corners, the manifest says 11 × 8" in detect_board(picture, larger, 255).problem


MANY = Board(kind="chessboard", columns=20, rows=15, square_m=0.0125)


@pytest.fixture(scope="module")
def many():
    return truth(3, board=MANY)


@pytest.mark.parametrize(("view", "beyond"), [(0, 1), (0, 3), (1, 2), (2, 3)])
def test_neighbours_of_a_board_that_all_sides_cut_are_neighbours_on_the_board(many, view, beyond):
    """OpenCV finds every second row of it, or rows that are askew, and guesses corners at the picture's edge."""
    whole = photograph(stand(many, view, printed(MANY, pixels=24)))
    places = MANY.points_m @ many.rotations[view][:, :2].T + many.translations_m[view]
    xy = project_points(CAMERA, places)
    grid = xy.reshape(15, 20, 2)
    left, right = (int(grid[:, [k - 1, k], 0].mean()) for k in (beyond, -beyond))
    top, bottom = (int(grid[[k - 1, k], :, 1].mean()) for k in (beyond, -beyond))
    found = detect_board(np.ascontiguousarray(whole[top:bottom, left:right]), MANY, 255)
    assert found.problem == ""
    apart = np.linalg.norm(found.xy_px[:, None] + (left, top) - xy, axis=2)
    assert apart.min(axis=1).max() < 0.5
    true, said = np.stack(np.divmod(apart.argmin(axis=1), 20)), np.stack(np.divmod(found.ids, 20))
    inside = ((xy > (left + 20, top + 20)) & (xy < (right - 20, bottom - 20))).all(axis=1).sum()
    assert len(found.ids) >= 0.8 * inside
    turns = (np.array(turn) for turn in ([[1, 0], [0, 1]], [[0, 1], [-1, 0]], [[-1, 0], [0, -1]], [[0, -1], [1, 0]]))
    assert any((np.ptp(said - turn @ true, axis=1) == 0).all() for turn in turns)
