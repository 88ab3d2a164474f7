"""A flat part that the picture's border cuts goes on to the walls; one that ends at an edge does not."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from calibration.geometry.room import RoomBox
from calibration.surfaces.before_walls import apart_from_walls, before_walls
from calibration.surfaces.continued import continued
from calibration.surfaces.flat_parts import parts_of
from calibration.surfaces.pieces import pieces_of
from calibration.surfaces.point_map import point_map
from tests.calibration.surfaces.made import correspondence_of, device, plane, rectangle

SIZE_M = (4.0, 5.0, 2.5)
WALLS = [plane((SIZE_M[0] * side, 0, 0), (1, 0, 0)) for side in (0, 1)]
WALLS += [plane((0, SIZE_M[1], 0), (0, 1, 0)), plane((0, 0, 0), (0, 0, 1)), plane((0, 0, SIZE_M[2]), (0, 0, 1))]
BOX = RoomBox(
    size_m=SIZE_M,
    seen=("y1",),
    faces=("x0", "x1", "y0", "y1", "floor", "ceiling"),
    camera=device((1.0, 0.6, 1.3), (1.6, 4.0, 1.2)),
    projector=device((1.4, 0.6, 1.2), (2.0, 4.0, 1.2), width_px=400, height_px=300, focal_px=260.0),
    angle_error_deg=0.0,
    notes="",
)
PARTITION = rectangle((2.2, 3.0, 0.0), (1.8, 0, 0), (0, 0, SIZE_M[2]))
"""From the wall x1 to the middle of the room, from floor to ceiling: the pictures end before it does."""
SCREEN = rectangle((0.9, 3.5, 0.7), (1.2, 0, 0), (0, 0, 0.9))
"""Whole in both pictures, and its shadow, too."""


@cache
def carried_on(what: str):
    thing = {"partition": PARTITION, "screen": SCREEN}[what]
    seen = correspondence_of([*WALLS, thing], camera=BOX.camera, projector=BOX.projector)
    every = point_map(seen, BOX.camera, BOX.projector)
    stands = before_walls(seen, BOX).stands
    points = point_map(seen, BOX.camera, BOX.projector, stands)
    parts = parts_of(points, pieces_of(points, stands, 40), 40)
    return points, continued(every, parts, BOX, 0.25)


def test_a_partition_that_the_picture_cuts_goes_on_to_walls_floor_and_ceiling():
    points, found = carried_on("partition")
    seen_m = (points.origin_m + points.distance_m[points.known][:, None] * points.rays[points.known])[:, 0]
    low, high = found.vertices_m.min(axis=0), found.vertices_m.max(axis=0)
    assert high == pytest.approx((4.0, 3.0, 2.5), abs=0.02)
    assert low[1:] == pytest.approx((3.0, 0.0), abs=0.02)
    assert 2.2 - 0.02 < low[0] < seen_m.max(), "it begins where the part was seen, and not in the open room"


def test_what_goes_on_fills_what_nobody_saw_and_faces_the_camera():
    points, found = carried_on("partition")
    a, b, c = (found.vertices_m[found.triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    assert (((BOX.camera.position_m - a) * normal).sum(axis=1) > 0).all()
    seen_m = (points.origin_m + points.distance_m[points.known][:, None] * points.rays[points.known])[:, 0].max()
    missing_m2 = (4.0 - seen_m) * 2.5
    assert np.linalg.norm(normal, axis=1).sum() / 2 == pytest.approx(missing_m2, rel=0.35), "but for cells at its rim"


def test_a_screen_that_ends_within_the_pictures_does_not_go_on():
    _, found = carried_on("screen")
    assert len(found.triangles) == 0


def test_points_are_apart_from_the_nearest_wall():
    apart_m = apart_from_walls(BOX, np.array([[0.3, 2.0, 1.0], [2.0, 4.9, 1.0], [2.0, 2.0, 2.3], [np.nan] * 3]))
    assert apart_m[:3] == pytest.approx([0.3, 0.1, 0.2])
    assert np.isnan(apart_m[3])
