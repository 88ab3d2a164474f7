"""Where the backs of things may be that nobody saw: as far behind as these are wide, but in the room."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.geometry.room import RoomBox
from calibration.surfaces.bodies import guesses_of_backs, rim_of
from tests.calibration.surfaces.made import device

BOX = RoomBox(
    size_m=(4.0, 5.0, 2.5),
    seen=("y1",),
    faces=("x0", "x1", "y0", "y1", "floor", "ceiling"),
    camera=device((1.9, 0.6, 1.3), (2.0, 4.0, 1.2)),
    projector=device((2.1, 0.6, 1.3), (2.0, 4.0, 1.2)),
    angle_error_deg=0.0,
    notes="",
)
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])


def front(y_m):
    """(4, 3) corners of an upright square, 0.6 m wide, straight ahead of the devices and seen from them."""
    return np.array([[1.7, y_m, 0.5], [2.3, y_m, 0.5], [2.3, y_m, 1.1], [1.7, y_m, 1.1]])


def lying(z_m):
    """(4, 3) corners of a square that lies in the room, 0.6 m wide."""
    return np.array([[1.7, 3.0, z_m], [2.3, 3.0, z_m], [2.3, 3.6, z_m], [1.7, 3.6, z_m]])


def guesses(corners, *, flat=(False,)):
    """Of some squares, one after the other."""
    n = len(corners) // 4
    triangles = np.concatenate([TRIANGLES + 4 * k for k in range(n)])
    return guesses_of_backs(corners, triangles, np.repeat(np.arange(n), 2), flat=np.array(flat), box=BOX)


def test_the_back_of_a_body_lies_as_far_behind_its_front_as_that_is_wide():
    (backs_m,) = guesses(front(3.0))
    assert backs_m[:, 1] == pytest.approx(3.6)


def test_a_body_whose_depth_is_seen_is_no_deeper_than_wide():
    # Its top is seen as far back as the box is wide: what was not seen is at most as far behind its front as that.
    (backs_m,) = guesses(np.concatenate([front(3.0), lying(1.1)]), flat=[True, True])
    assert backs_m[:, 1].max() == pytest.approx(3.6, abs=0.01)


@pytest.mark.parametrize("aside_m", [-0.9, 0.0, 0.9])
@pytest.mark.parametrize("bottom_m", [0.0, 0.5, 1.6])
def test_no_back_is_where_a_device_looks_past_the_front(aside_m, bottom_m):
    corners = front(3.0) + np.array([aside_m, 0.0, bottom_m - 0.5])
    (backs_m,) = guesses(corners)
    for device_m in (BOX.camera.position_m, BOX.projector.position_m):
        through = device_m + (backs_m - device_m) * (3.0 - device_m[1]) / (backs_m[:, 1:2] - device_m[1])
        for axis in (0, 2):
            assert through[:, axis].min() > corners[:, axis].min() - 0.02
            assert through[:, axis].max() < corners[:, axis].max() + 0.02


@pytest.mark.parametrize("y_m", [4.8, 4.999])
def test_before_a_wall_it_ends_at_the_wall_and_stays_behind_its_front(y_m):
    (backs_m,) = guesses(front(y_m))
    assert (backs_m[:, 1] > y_m).all()
    assert backs_m[:, 1].max() == pytest.approx(5.0, abs=0.01)


def test_a_flat_part_alone_that_stands_may_be_the_front_of_a_column():
    (backs_m,) = guesses(front(3.0), flat=[True])
    assert backs_m[:, 1] == pytest.approx(3.6)


def test_a_flat_part_alone_that_lies_is_a_top_and_stays_thin():
    assert guesses(lying(0.7), flat=[True]) == []


def test_beside_a_body_a_front_is_thin_in_one_guess_and_deep_in_the_other():
    # Two panes that touch are of one box; the square at the left stands alone.
    pane_m = np.array([0.602, 0.0, 0.0])
    squares = [front(3.0) - 2 * pane_m, front(3.0), front(3.0) + pane_m]
    screen, column = guesses(np.concatenate(squares), flat=[True] * 3)
    depth_m = [np.linalg.norm(backs_m - np.concatenate(squares), axis=1) for backs_m in (screen, column)]
    assert depth_m[0][:4].max() < 0.01
    assert depth_m[1][:4].max() > 0.5
    assert (screen[4:] == column[4:]).all()


def test_a_screen_that_hangs_is_thin_in_one_guess_in_which_the_column_beside_it_is_deep():
    hanging, standing = (front(3.0) + np.array(shift_m) for shift_m in ((-0.9, 0.0, 0.0), (0.9, 0.0, -0.5)))
    both = np.concatenate([hanging, standing])
    columns, every = guesses(both, flat=[True, True])
    depth_m = [np.linalg.norm(backs_m - both, axis=1) for backs_m in (columns, every)]
    assert depth_m[0][:4].max() < 0.01
    assert depth_m[0][4:].max() > 0.5
    assert depth_m[1].max() > 0.5
    assert (columns[4:] == every[4:]).all()


def test_two_flat_sides_that_touch_are_of_one_box_as_deep_as_both_are_wide():
    left, right = front(3.0) - (0.3, 0, 0), front(3.0) + np.array([0.302, 0, 0])
    (backs_m,) = guesses(np.concatenate([left, right]), flat=[True, True])
    assert backs_m[:, 1] == pytest.approx(3.0 + 1.202, abs=0.01)


def test_a_rim_goes_once_around_and_leaves_out_what_triangles_share():
    rim, owner = rim_of(TRIANGLES)
    assert {tuple(side) for side in rim.tolist()} == {(0, 1), (1, 2), (2, 3), (3, 0)}
    assert [set(side) <= set(TRIANGLES[k].tolist()) for side, k in zip(rim.tolist(), owner, strict=True)] == [True] * 4
