"""From correspondences to surfaces: what stands before walls, in pieces, flat and curved parts, triangles."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from calibration.geometry.pinhole import project
from calibration.geometry.room import RoomBox
from calibration.surfaces.before_walls import before_walls
from calibration.surfaces.flat_parts import parts_of
from calibration.surfaces.pieces import largest_first, pieces_of
from calibration.surfaces.point_map import point_map
from calibration.surfaces.triangulated import triangulated
from tests.calibration.surfaces.made import (
    CAMERA,
    PROJECTOR,
    ball,
    correspondence_of,
    device,
    distances,
    plane,
    rectangle,
)

ROOM_CAMERA = device((1.6, 0.6, 1.3), (1.5, 4.0, 1.1))
ROOM_PROJECTOR = device((1.1, 0.6, 1.2), (1.5, 4.0, 1.1), width_px=400, height_px=300, focal_px=280.0)
BOX = RoomBox(
    size_m=(3.0, 4.0, 2.5),
    seen=("y1",),
    faces=("x0", "x1", "y0", "y1", "floor", "ceiling"),
    camera=ROOM_CAMERA,
    projector=ROOM_PROJECTOR,
    angle_error_deg=0.0,
    notes="",
)
WALLS = [
    plane((0, 0, 0), (1, 0, 0)),
    plane((3, 0, 0), (1, 0, 0)),
    plane((0, 4, 0), (0, 1, 0)),
    plane((0, 0, 0), (0, 0, 1)),
    plane((0, 0, 2.5), (0, 0, 1)),
]
BLOCK = rectangle((1.0, 3.0, 0.6), (0.9, 0, 0), (0, 0, 0.9))
"""The front of something that stands a metre before the wall y1."""


STATED = (8, 12)
"""Points of a line of the projector err alike: each has a sigma that is several times what they differ by."""


def on_all(shapes, camera=CAMERA, projector=PROJECTOR, seed=0, stated=1.0):
    """Points and a chosen mask of all that was decoded, whose sigma is stated as so many times what it is."""
    decoded = correspondence_of(shapes, seed=seed, camera=camera, projector=projector)
    points = point_map(replace(decoded, sigma_px=decoded.sigma_px * np.float32(stated)), camera, projector)
    return points, points.known


@cache
def ball_and_wall():
    return on_all([ball((0.3, 2.6, 1.1), 0.5), plane((0, 4.0, 0), (0, 1, 0))])


def test_bare_walls_have_nothing_before_them():
    seen = correspondence_of(WALLS, camera=ROOM_CAMERA, projector=ROOM_PROJECTOR)
    assert not before_walls(seen, BOX).stands.any()


def test_what_stands_before_a_wall_is_found_to_the_pixel():
    seen = correspondence_of([*WALLS, BLOCK], camera=ROOM_CAMERA, projector=ROOM_PROJECTOR)
    found = before_walls(seen, BOX)
    true = seen.valid & (distances([BLOCK], ROOM_CAMERA) < np.inf)
    assert true.sum() > 2000
    assert (found.stands != true).sum() <= 8, "but for its four corners"
    assert found.wall_distance_m == pytest.approx(distances(WALLS, ROOM_CAMERA), rel=1e-9)


def test_no_piece_bridges_a_step_in_depth():
    points, chosen = ball_and_wall()
    pieces = pieces_of(points, chosen, 30)
    truth = distances([ball((0.3, 2.6, 1.1), 0.5)]) < np.inf
    for piece in (0, 1):
        share = truth[pieces == piece].mean()
        assert min(share, 1 - share) == 0, "either all of the ball, or all of the wall"
    assert (pieces[chosen] >= 0).mean() > 0.99


def test_a_surface_that_leans_away_stays_one_piece():
    points, chosen = on_all([plane((0, 4.0, 0), (0.7, 0.714, 0))])
    pieces = pieces_of(points, chosen, 30)
    assert (pieces[chosen] == 0).mean() > 0.97


def test_labels_are_numbered_by_their_size_and_small_ones_are_left_out():
    label = np.array([[7, 7, 7, 2, 2, 5, -1, -1, -1, -1]])
    assert largest_first(label, 2).tolist() == [[0, 0, 0, 1, 1, -1, -1, -1, -1, -1]]


@pytest.mark.parametrize("fold_deg", [20, 60, 90])
def test_two_planes_are_two_flat_parts_that_meet_at_their_edge(fold_deg):
    half = np.radians(fold_deg / 2)
    sides = [plane((0.3, 3.0, 1.1), (np.sin(half) * sign, np.cos(half), 0)) for sign in (1, -1)]
    truth = np.stack([distances([side]) for side in sides])
    points, chosen = on_all([lambda o, r: np.max([side(o, r) for side in sides], axis=0)])
    parts = parts_of(points, pieces_of(points, chosen, 30), 30)
    assert parts.flat.tolist() == [True, True]
    expected = truth.argmax(axis=0)
    agree = (parts.label == expected)[parts.label >= 0].mean()
    assert max(agree, 1 - agree) > 0.985


@pytest.mark.parametrize("radius_m", [0.3, 0.5, 0.9])
def test_a_ball_is_no_heap_of_planes(radius_m):
    points, chosen = on_all([ball((0.3, 3.0, 1.1), radius_m)])
    parts = parts_of(points, pieces_of(points, chosen, 30), 30)
    assert not parts.flat.any()
    assert (parts.label[chosen] == 0).mean() > 0.98


@pytest.mark.parametrize("stated", STATED)
def test_a_ball_no_deeper_than_its_points_are_uncertain_is_no_plane(stated):
    points, chosen = on_all([ball((0.3, 3.0, 1.1), 0.2)], stated=stated)
    assert not parts_of(points, pieces_of(points, chosen, 30), 30).flat.any()


@pytest.mark.parametrize("stated", STATED)
def test_a_pane_of_uncertain_points_is_flat(stated):
    points, chosen = on_all([rectangle((0.1, 3.0, 0.9), (0.4, 0.1, 0), (0, 0, 0.4))], stated=stated)
    assert parts_of(points, pieces_of(points, chosen, 30), 30).flat.all()


@pytest.mark.parametrize("seed", range(3))
def test_triangles_of_a_ball_lie_on_it(seed):
    centre, radius_m = np.array([0.3, 2.6, 1.1]), 0.5
    points, chosen = on_all([ball(centre, radius_m)], seed=seed)
    parts = parts_of(points, pieces_of(points, chosen, 30), 30)
    found = triangulated(points, parts, CAMERA, 0.15)
    middles = found.vertices_m[found.triangles].mean(axis=1)
    off = np.abs(np.linalg.norm(np.concatenate([middles, found.vertices_m]) - centre, axis=1) - radius_m)
    distance_m = 2.4
    assert np.median(off) < 0.0015 * distance_m
    assert np.quantile(off, 0.95) < 0.005 * distance_m


def test_triangles_face_the_camera_and_cover_what_it_sees():
    points, chosen = ball_and_wall()
    parts = parts_of(points, pieces_of(points, chosen, 30), 30)
    found = triangulated(points, parts, CAMERA, 0.2)
    a, b, c = (found.vertices_m[found.triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    assert (((points.origin_m - a) * normal).sum(axis=1) > 0).all()
    a, b, c = (project(CAMERA, corners) for corners in (a, b, c))
    covered_px = np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]).sum() / 2
    assert covered_px == pytest.approx(chosen.sum(), rel=0.03)


def test_corners_of_a_flat_part_lie_in_its_plane():
    points, chosen = on_all([rectangle((-0.5, 3.0, 0.5), (1.5, 0.4, 0), (0, 0, 1.2))])
    parts = parts_of(points, pieces_of(points, chosen, 30), 30)
    found = triangulated(points, parts, CAMERA, 0.3)
    assert found.flat.tolist() == [True]
    normal = np.cross((1.5, 0.4, 0), (0, 0, 1.2)) / np.linalg.norm(np.cross((1.5, 0.4, 0), (0, 0, 1.2)))
    off = (found.vertices_m - (-0.5, 3.0, 0.5)) @ normal
    assert np.abs(off).max() < 0.002
    assert len(found.triangles) < 200, "a plane needs no small triangles"


def test_nothing_chosen_is_no_surface():
    points, chosen = ball_and_wall()
    parts = parts_of(points, pieces_of(points, np.zeros_like(chosen), 30), 30)
    found = triangulated(points, parts, CAMERA, 0.2)
    assert len(found.triangles) == found.n_parts == 0
