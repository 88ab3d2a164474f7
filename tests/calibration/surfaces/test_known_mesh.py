"""A known mesh is found in what a camera measured of it, and what does not fit is seen by its misfit."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.geometry.pinhole import PinholeModel
from calibration.surfaces.known.nearest import nearest_on_triangles
from calibration.surfaces.known.registration import better_size, register
from calibration.surfaces.point_map import PointMap, camera_rays

CAMERA = PinholeModel(
    width_px=80,
    height_px=60,
    focal_px=(70.0, 70.0),
    principal_point_px=(39.5, 29.5),
    distortion=(0.0, 0.0, 0.0, 0.0, 0.0),
    rotation=np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]),
    translation_m=np.array([0.0, 0.8, 0.0]),
)
"""At x = 0, 0.8 m high, looking along x; z is up."""
SIGMA_M = 0.002


def block(low, high):
    """Twelve triangles of a box, counter-clockwise seen from outside."""
    x, y, z = ([a, b] for a, b in zip(low, high, strict=True))
    corner = np.array([[x[i], y[j], z[k]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return np.array([[corner[a], corner[b], corner[c]] for q in quads for a, b, c in (q[:3], (q[0], q[2], q[3]))])


def steps():
    """A thing like no mirror image or turn of itself: three blocks of different sizes."""
    return np.concatenate(
        [
            block((-0.5, -0.4, 0.0), (0.5, 0.4, 0.3)),
            block((-0.1, -0.4, 0.3), (0.5, 0.0, 0.7)),
            block((0.2, 0.1, 0.3), (0.45, 0.3, 0.5)),
        ]
    )


def turned(triangles, degrees, to):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return triangles @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T + np.array(to)


def seen(triangles, noise_m=0.0):
    """What the camera measures of triangles before a wall at x = 5 m: distances along rays, the nearest first."""
    rays = camera_rays(CAMERA).reshape(-1, 3)
    origin = CAMERA.position_m
    a, ab, ac = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    p = np.cross(rays[:, None], ac)
    with np.errstate(divide="ignore", invalid="ignore"):
        over = 1 / (p * ab).sum(axis=-1)
        to = origin - a
        u = (p * to).sum(axis=-1) * over
        q = np.cross(to, ab)
        v = (rays[:, None] * q).sum(axis=-1) * over
        distance = (ac * q).sum(axis=-1) * over
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (distance > 0)
        wall = np.where(rays[:, 0] > 0, 5 / rays[:, 0], np.nan)
    nearest = np.where(hit, distance, np.inf).min(axis=1)
    thing = (nearest < wall).reshape(60, 80)
    noise = np.random.default_rng(1).normal(0, 1, len(rays)) * noise_m
    measured = (np.where(nearest < wall, nearest, wall) + noise).reshape(60, 80)
    points = PointMap(
        origin_m=origin, rays=rays.reshape(60, 80, 3), distance_m=measured, sigma_m=np.full((60, 80), SIGMA_M)
    )
    return points, thing


def test_the_nearest_place_on_a_triangle_is_within_on_a_side_or_at_a_corner():
    triangle = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    points = np.array([[0.2, 0.2, 0.7], [0.5, -1, 0], [2, -1, 0.3], [-1, -1, 0], [1, 1, 0], [-1, 0.4, 0]])
    nearest = nearest_on_triangles(points, np.broadcast_to(triangle, (6, 3, 3)))
    expected = [[0.2, 0.2, 0], [0.5, 0, 0], [1, 0, 0], [0, 0, 0], [0.5, 0.5, 0], [0, 0.4, 0]]
    assert nearest == pytest.approx(np.array(expected))


def test_a_mesh_is_found_however_it_is_turned_in_its_file():
    truth = turned(steps(), 205.0, (2.6, 0.2, 0.0))
    points, thing = seen(truth, SIGMA_M)
    found = register(points, thing, CAMERA, steps())
    assert np.abs(found.pose.to_world(steps()) - truth).max() < 0.004
    assert np.median(np.abs(found.misfit_m)) < 1.5 * SIGMA_M
    assert found.see_through < 0.05
    assert found.loosest_m < 0.004
    assert found.also is None


def test_what_is_missing_in_the_room_is_seen_through():
    there = steps()[:12]
    points, thing = seen(turned(there, 20.0, (2.6, 0.2, 0.0)), SIGMA_M)
    assert register(points, thing, CAMERA, steps()).see_through > 0.1


def test_what_the_file_lacks_is_left_as_misfit():
    truth = turned(steps(), 20.0, (2.6, 0.2, 0.0))
    points, thing = seen(truth, SIGMA_M)
    misfit = register(points, thing, CAMERA, steps()[:12]).misfit_m
    assert np.quantile(np.abs(misfit), 0.9) > 0.05


def test_a_file_that_is_too_small_is_told_from_the_right_one_by_its_size():
    points, thing = seen(turned(steps(), 20.0, (2.6, 0.2, 0.0)), SIGMA_M)
    found = register(points, thing, CAMERA, steps() / 1.04)
    scale, misfit_m = better_size(points, thing, steps() / 1.04, found.pose)
    assert scale == pytest.approx(1.04, abs=0.004)
    assert misfit_m < 0.5 * np.median(np.abs(found.misfit_m))


def test_the_turn_of_a_round_column_is_named_as_what_nothing_holds():
    angle = np.linspace(0, 2 * np.pi, 49)
    ring = 0.3 * np.stack([np.cos(angle), np.sin(angle), np.zeros(49)], axis=1)
    top, middle = ring + np.array([0, 0, 0.5]), np.array([0, 0, 0.5])
    sides = [[ring[k], ring[k + 1], top[k + 1]] for k in range(48)] + [[ring[k], top[k + 1], top[k]] for k in range(48)]
    sides += [[top[k], top[k + 1], middle] for k in range(48)]
    column = np.array(sides)
    points, thing = seen(turned(column, 0.0, (2.5, 0.0, 0.0)), SIGMA_M)
    found = register(points, thing, CAMERA, column)
    assert np.median(np.abs(found.misfit_m)) < 2 * SIGMA_M
    assert found.loosest == "a turn about the room's z"


def test_a_cube_may_have_its_bump_on_either_side_that_is_not_seen():
    """The camera sees two sides of a cube at an edge; the file says that there is a bump on one of the four."""
    cube = block((-0.3, -0.3, 0.0), (0.3, 0.3, 0.6))
    points, thing = seen(turned(cube, 45.0, (2.5, 0.0, 0.2)), SIGMA_M)
    found = register(points, thing, CAMERA, np.concatenate([cube, block((0.3, -0.15, 0.1), (0.45, 0.15, 0.5))]))
    assert np.median(np.abs(found.misfit_m)) < 2 * SIGMA_M
    assert found.also is not None
