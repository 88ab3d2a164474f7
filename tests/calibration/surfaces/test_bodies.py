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


def test_a_back_lies_as_far_behind_its_front_as_that_is_wide():
    backs_m = as_deep_as_wide(front(3.0), TRIANGLES, np.zeros(2, int), BOX)
    assert backs_m == pytest.approx(front(3.6), abs=1e-6)


@pytest.mark.parametrize("y_m", [4.8, 4.999])
def test_before_a_wall_it_ends_at_the_wall_and_stays_behind_its_front(y_m):
    backs_m = as_deep_as_wide(front(y_m), TRIANGLES, np.zeros(2, int), BOX)
    assert (backs_m[:, 1] > y_m).all()
    assert backs_m[:, 1].max() == pytest.approx(5.0, abs=0.01)


def test_each_part_is_as_deep_as_itself_is_wide():
    narrow = front(3.0) * (0.5, 1, 1) + (2.0, 0, 0)
    corners = np.concatenate([front(3.0) - (1.0, 0, 0), narrow])
    backs_m = as_deep_as_wide(corners, np.concatenate([TRIANGLES, TRIANGLES + 4]), np.array([0, 0, 1, 1]), BOX)
    depth_m = np.linalg.norm(backs_m - corners, axis=1)
    wide_m = [np.ptp(corners[k : k + 4] @ across(corners[k : k + 4])) for k in (0, 4)]
    assert depth_m == pytest.approx(np.repeat(wide_m, 4), rel=1e-6)


def across(corners):
    x, y = (corners.mean(axis=0) - (2.0, 0.6, 1.3))[:2]
    return np.array([-y, x, 0.0]) / np.hypot(x, y)


def test_a_rim_goes_once_around_and_leaves_out_what_triangles_share():
    rim, owner = rim_of(TRIANGLES)
    assert {tuple(side) for side in rim.tolist()} == {(0, 1), (1, 2), (2, 3), (3, 0)}
    assert [set(side) <= set(TRIANGLES[k].tolist()) for side, k in zip(rim.tolist(), owner, strict=True)] == [True] * 4
