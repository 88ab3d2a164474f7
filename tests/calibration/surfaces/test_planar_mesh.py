"""Triangles within outlines fill them, keep to them, and are of the size that was asked for."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.surfaces.planar_mesh import mesh_within

SQUARE = np.array([[0, 0], [4, 0], [4, 4], [0, 4]], float)
HOLE = np.array([[1, 1], [3, 1], [3, 3], [1, 3]], float)
L_SHAPE = np.array([[0, 0], [4, 0], [4, 1], [1, 1], [1, 4], [0, 4]], float)
NO_POINTS = np.zeros((0, 2))


def areas(mesh):
    a, b, c = (mesh.corners[mesh.triangles[:, k]] for k in range(3))
    return ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2


def everywhere(side):
    return lambda points: np.full(len(points), side)


def area_of(ring):
    x, y = ring.T
    return abs(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) / 2


def star(seed):
    """A polygon with random bays and capes."""
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0, 2 * np.pi, 24))
    return rng.uniform(0.3, 2.0, 24)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


@pytest.mark.parametrize(
    ("outlines", "area"), [([SQUARE], 16.0), ([SQUARE, HOLE], 12.0), ([L_SHAPE], 7.0), ([L_SHAPE[::-1]], 7.0)]
)
def test_triangles_fill_an_outline_and_leave_its_holes_out(outlines, area):
    mesh = mesh_within(outlines, NO_POINTS, everywhere(0.8), 0.05)
    assert areas(mesh).min() > 0, "all are counter-clockwise"
    assert areas(mesh).sum() == pytest.approx(area, rel=1e-9)


@pytest.mark.parametrize("seed", range(12))
def test_no_triangle_crosses_a_ragged_outline(seed):
    ring = star(seed)
    mesh = mesh_within([ring], NO_POINTS, everywhere(0.5), 0.01)
    assert areas(mesh).sum() == pytest.approx(area_of(ring), rel=2e-3)


def test_sides_are_about_as_long_as_was_asked_for():
    grid = np.stack(np.meshgrid(np.arange(0.1, 4, 0.4), np.arange(0.1, 4, 0.4)), axis=-1).reshape(-1, 2)
    mesh = mesh_within([SQUARE], grid, everywhere(0.4), 0.05)
    ends = mesh.corners[mesh.triangles]
    sides = np.linalg.norm(ends - np.roll(ends, 1, axis=1), axis=2)
    assert sides.max() < 0.9
    assert np.median(sides) == pytest.approx(0.42, abs=0.1)


def test_points_outside_of_the_outline_are_not_used():
    mesh = mesh_within([SQUARE], np.array([[9.0, 9.0], [2.0, 2.0]]), everywhere(4.0), 0.1)
    assert mesh.corners.max() == 4.0
    assert (mesh.corners == [2.0, 2.0]).all(axis=1).any()


def test_a_line_has_no_triangles():
    assert len(mesh_within([np.array([[0, 0], [1, 1], [2, 2.0]])], NO_POINTS, everywhere(0.5), 0.1).triangles) == 0
    assert len(mesh_within([], NO_POINTS, everywhere(0.5), 0.1).triangles) == 0


def test_sides_are_short_only_where_that_is_wanted():
    mesh = mesh_within([SQUARE], NO_POINTS, lambda points: np.where(points[:, 1] < 0.5, 0.25, 2.0), 0.05)
    low, high = (np.sort(mesh.corners[np.abs(mesh.corners[:, 1] - y) < 1e-9, 0]) for y in (0.0, 4.0))
    assert np.diff(low).max() <= 0.25
    assert np.diff(high).min() == 2.0
    assert areas(mesh).sum() == pytest.approx(16.0)
