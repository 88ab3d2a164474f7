"""Where the backs of things may be that nobody saw: as far behind as these are wide, but in the room."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.geometry.room import RoomBox
from calibration.surfaces.bodies import as_deep_as_wide, rim_of
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


def backs_of(corners, *, flat=(False,)):
    """Of some squares, one after the other."""
    n = len(corners) // 4
    triangles = np.concatenate([TRIANGLES + 4 * k for k in range(n)])
    return as_deep_as_wide(corners, triangles, np.repeat(np.arange(n), 2), flat=np.array(flat), box=BOX)


def test_a_back_lies_as_far_behind_its_front_as_that_is_wide():
    assert backs_of(front(3.0)) == pytest.approx(front(3.6), abs=1e-6)


@pytest.mark.parametrize("y_m", [4.8, 4.999])
def test_before_a_wall_it_ends_at_the_wall_and_stays_behind_its_front(y_m):
    backs_m = backs_of(front(y_m))
    assert (backs_m[:, 1] > y_m).all()
    assert backs_m[:, 1].max() == pytest.approx(5.0, abs=0.01)


def test_a_flat_part_alone_is_a_screen_and_stays_thin():
    assert backs_of(front(3.0), flat=[True]) == pytest.approx(front(3.0), abs=0.01)


def test_two_flat_sides_that_touch_are_of_one_box_as_deep_as_both_are_wide():
    left, right = front(3.0) - (0.3, 0, 0), front(3.0) + np.array([0.302, 0, 0])
    backs_m = backs_of(np.concatenate([left, right]), flat=[True, True])
    assert backs_m[:, 1] == pytest.approx(3.0 + 1.202, abs=0.01)


def test_a_rim_goes_once_around_and_leaves_out_what_triangles_share():
    rim, owner = rim_of(TRIANGLES)
    assert {tuple(side) for side in rim.tolist()} == {(0, 1), (1, 2), (2, 3), (3, 0)}
    assert [set(side) <= set(TRIANGLES[k].tolist()) for side, k in zip(rim.tolist(), owner, strict=True)] == [True] * 4
