"""Polygons of many corners are cut into triangles that cover them once, whatever their shape, or refused."""

import numpy as np
import pytest

from sim.geometry.mending.polygons import cut_polygon, cut_polygons

L_FLOOR = [(0, 0, 0), (2, 0, 0), (2, 1, 0), (1, 1, 0), (1, 2, 0), (0, 2, 0)]
ON_A_LINE = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (3, 0, 0), (3, 3, 0), (0, 3, 0), (0, 1.5, 0)]
KEYHOLE = [
    (0, 0, 0), (4, 0, 0), (4, 4, 0), (0, 4, 0), (0, 0, 0),
    (1, 1, 0), (1, 3, 0), (3, 3, 0), (3, 1, 0), (1, 1, 0),
]  # fmt: skip
COMB = [(0, 0, 0), (9, 0, 0), (9, 5, 0), (8, 5, 0), (8, 1, 0), (6, 1, 0), (6, 5, 0), (3, 5, 0), (3, 1, 0), (0, 1, 0)]


def vectors(corners, triangles):
    a, b, c = np.moveaxis(np.asarray(corners, dtype=float)[triangles], 1, 0)
    return np.cross(b - a, c - a) / 2


def enclosed(corners):
    points = np.asarray(corners, dtype=float)
    return np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0) / 2


def turn():
    return np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]


@pytest.mark.parametrize(
    ("corners", "area"), [(L_FLOOR, 3.0), (ON_A_LINE, 9.0), (KEYHOLE, 12.0), (COMB, 25.0), (L_FLOOR[::-1], 3.0)]
)
@pytest.mark.parametrize("turned", [False, True])
def test_its_triangles_cover_a_polygon_once_and_look_its_way(corners, area, turned):
    points = np.asarray(corners, dtype=float) @ (turn() if turned else np.eye(3))
    cut = cut_polygon(points)
    assert cut.fault == ""
    pieces = vectors(points, cut.triangles)
    assert np.linalg.norm(pieces, axis=1).sum() == pytest.approx(area)
    assert pieces.sum(axis=0) == pytest.approx(enclosed(points))


@pytest.mark.parametrize("seed", range(5))
def test_random_stars_are_covered(seed):
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.random(60)) * 2 * np.pi
    radius = rng.random(60) + 0.1
    star = np.stack([radius * np.cos(angle), radius * np.sin(angle), 0 * angle], axis=1)
    cut = cut_polygon(star)
    assert len(cut.triangles) == 58
    assert np.linalg.norm(vectors(star, cut.triangles), axis=1).sum() == pytest.approx(enclosed(star)[2])


def test_a_corner_a_rounding_off_a_line_is_decided_exactly():
    corners = [(0, 0, 0), (0.1, 0.1, 0), (0.3, np.nextafter(0.3, 1), 0), (1, 1, 0), (0, 1, 0)]
    cut = cut_polygon(corners)
    assert cut.fault == ""
    assert np.linalg.norm(vectors(corners, cut.triangles), axis=1).sum() == pytest.approx(0.5)


def test_edges_that_cross_are_no_surface():
    assert "cross" in cut_polygon([(0, 0, 0), (1, 1, 0), (1, 0, 0), (0, 1, 0), (0.5, 2, 0)]).fault


def test_a_bent_polygon_is_cut_within_a_hundredth_of_its_size_and_refused_above():
    pentagon = np.array([(0, 0, 0), (1, 0, 0), (1.3, 0.5, 0), (1, 1, 0), (0, 1, 0)], dtype=float)
    pentagon[2, 2] = 0.01
    assert len(cut_polygon(pentagon).triangles) == 3
    pentagon[2, 2] = 0.3
    assert "limit 0.013 m" in cut_polygon(pentagon).fault


@pytest.mark.parametrize("corners", [[(0, 0, 0), (1, 0, 0), (2, 0, 0), (1, 0, 0)], [(1, 1, 1)] * 5])
def test_a_polygon_without_area_has_no_triangles(corners):
    cut = cut_polygon(corners)
    assert cut.triangles.shape == (0, 3)
    assert cut.fault == ""


def test_a_corner_that_is_no_number_is_a_fault():
    assert "NaN" in cut_polygon([*L_FLOOR[:5], (0, np.nan, 0)]).fault


def _random_polygons(count, corners):
    """Round ones, stars, ones that name a corner twice, on a grid, bent, on a line and not a number, by turns."""
    rng = np.random.default_rng(corners)
    found = []
    for k in range(count):
        angle = np.sort(rng.uniform(0, 2 * np.pi, corners))
        radius = rng.uniform(0.2, 1, corners) if k % 7 == 1 else np.ones(corners)
        polygon = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(corners)], axis=1)
        if k % 7 == 2:
            polygon[k % corners] = polygon[k % corners - 1]
        elif k % 7 == 3:
            polygon = np.pad(rng.integers(0, 3, (corners, 2)), ((0, 0), (0, 1))).astype(float)
        elif k % 7 == 4:
            polygon[:, 2] = rng.normal(0, 0.006, corners)
        elif k % 7 == 5:
            polygon = np.outer(rng.uniform(size=corners), (1, 2, 3))
        elif k % 35 == 6:
            polygon[1, 2] = np.nan
        turned, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        found.append(polygon if k % 2 else polygon @ turned * 10 ** rng.uniform(-3, 3))
    return np.array(found)


@pytest.mark.parametrize("corners", [3, 4, 5, 8])
def test_polygons_cut_together_are_cut_as_by_themselves(corners):
    polygons = _random_polygons(140, corners)
    cut = cut_polygons(polygons)
    for i, polygon in enumerate(polygons):
        alone = cut_polygon(polygon)
        assert cut.triangles[cut.polygon == i].tolist() == alone.triangles.tolist()
        assert cut.faults.get(i, "") == alone.fault
    assert cut.faults
    assert len(np.unique(cut.polygon)) > 70


def test_a_convex_polygon_is_cut_as_if_it_were_looked_at_ear_by_ear():
    # A corner within an edge sends the same outline the other way, where each ear is looked into.
    outline = np.array([(0, 0, 0), (4, 0, 0), (5, 2, 0), (4, 5, 0), (0, 4, 0)], dtype=float)
    with_a_straight_corner = np.insert(outline, 1, (2, 0, 0), axis=0)
    areas = []
    for polygon in (outline, with_a_straight_corner):
        a, b, c = np.moveaxis(polygon[cut_polygon(polygon).triangles], 1, 0)
        areas.append((np.cross(b - a, c - a)[:, 2] / 2).sum())
    assert areas == pytest.approx([20.5, 20.5])


def test_no_polygons_are_cut_into_nothing():
    cut = cut_polygons(np.zeros((0, 4, 3)))
    assert cut.triangles.shape == (0, 3)
    assert not cut.faults
