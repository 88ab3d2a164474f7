"""Patches cut where others pass through them, against cuts that are known."""

import numpy as np
import pytest

from sim.geometry import crossings
from sim.geometry.adaptive_patches import coarsest_patches
from sim.geometry.crossings import MOST_CROSSINGS, crossings_each, cut_where_crossed
from sim.geometry.mesh import Mesh
from sim.scenes.cluttered import random_corner

FLOOR = [[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]]
FAR_BELOW = [[0, 0, -3], [2, 0, -3], [2, 2, -3], [0, 2, -3]]


def patches_of(*quads):
    vertices = np.array([*quads, FAR_BELOW], dtype=float)
    # As something that stands in a scene: both sides of all of them stop light.
    return coarsest_patches(
        Mesh.from_arrays("some", vertices.reshape(-1, 3), np.arange(4 * len(vertices)).reshape(-1, 4), 0.5)
    )


def areas_of(parent, cells):
    pieces, parents = cut_where_crossed(cells)
    return sorted(pieces.areas[parents == parent].tolist())


def upright(x, low, high, begin=-1.0, end=3.0):
    """A wall across the floor at x."""
    return [[x, begin, low], [x, end, low], [x, end, high], [x, begin, high]]


def test_a_wall_through_a_floor_cuts_it_along_its_line_and_is_cut_by_it():
    cells = patches_of(FLOOR, upright(0.5, -1, 1))
    assert areas_of(0, cells) == pytest.approx([1.0, 3.0])
    # The wall goes on beside the floor: it is cut at the floor's plane, along the floor's whole length.
    assert areas_of(1, cells) == pytest.approx([4.0, 4.0])


def test_a_wall_that_stands_on_a_floor_cuts_it_and_one_that_hangs_under_it_or_over_it_does_not():
    assert areas_of(0, patches_of(FLOOR, upright(0.5, 0, 1))) == pytest.approx([1.0, 3.0])
    assert areas_of(0, patches_of(FLOOR, upright(0.5, -1, 0))) == [4.0]
    assert areas_of(0, patches_of(FLOOR, upright(0.5, 0.1, 1))) == [4.0]


def test_a_wall_along_a_floors_border_cuts_nothing():
    assert areas_of(0, patches_of(FLOOR, upright(0.0, 0, 1))) == [4.0]


def test_a_column_leaves_one_piece_within_it_and_one_for_each_side_around_it():
    x, y = (0.8, 1.2), (0.7, 1.1)
    corners = [(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])]
    sides = [
        [[*p, -1.0], [*q, -1.0], [*q, 1.0], [*p, 1.0]] for p, q in zip(corners, corners[1:] + corners[:1], strict=True)
    ]
    cells = patches_of(FLOOR, *sides)
    pieces, parents = cut_where_crossed(cells)
    floor = pieces.chosen(parents == 0)
    inside = ((floor.centres[:, :2] > (x[0], y[0])) & (floor.centres[:, :2] < (x[1], y[1]))).all(axis=1)
    assert floor.n_patches == 5
    assert floor.areas[inside] == pytest.approx([0.16])
    assert floor.areas.sum() == pytest.approx(4.0)


def test_a_line_that_leaves_a_strip_of_no_account_cuts_nothing():
    assert areas_of(0, patches_of(FLOOR, upright(0.001, -1, 1))) == [4.0]


@pytest.mark.parametrize("seed", range(4))
def test_pieces_of_things_that_pierce_each_other_cover_their_patches_and_are_crossed_no_more(seed):
    cells = coarsest_patches(random_corner(seed, 600))
    pieces, parents = cut_where_crossed(cells)
    assert pieces.n_patches > cells.n_patches
    assert np.bincount(parents, pieces.areas) == pytest.approx(cells.areas, rel=1e-9)
    assert np.einsum("pk,pk->p", pieces.normals, cells.normals[parents]).min() > 1 - 1e-9
    assert (pieces.reflectance == cells.reflectance[parents]).all()
    assert cut_where_crossed(pieces)[0].n_patches < 1.02 * pieces.n_patches


@pytest.mark.parametrize("seed", range(40))
def test_lines_through_corners_and_through_each_other_leave_no_piece_without_area_or_edge(seed):
    """Walls that pass through a floor's corners, its middle and each other's lines, turned so that rounding decides."""
    random = np.random.default_rng(seed)
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    lines = np.array([[0, 0, 2, 2], [2, 0, 0, 2], [1, 0, 1, 2], [0, 1, 2, 1], [0, 0, 2, 1], [0, 0, 1, 2], [2, 0, 0, 1]])
    walls = []
    for x, y, to_x, to_y in lines[random.permutation(len(lines))[:5]]:
        along, up = np.array([to_x - x, to_y - y, 0.0]), np.array([0.0, 0.0, 1.0])
        begin, end = np.array([x, y, 0.0]) - along, np.array([x, y, 0.0]) + 2 * along
        walls.append([begin - up, end - up, end + up, begin + up])
    cells = patches_of(*(np.array(quad) @ turn.T for quad in (FLOOR, *walls)))
    pieces, parents = cut_where_crossed(cells)
    assert np.bincount(parents, pieces.areas) == pytest.approx(cells.areas, rel=1e-6)
    assert (pieces.areas > 0).all()
    edges = np.linalg.norm(pieces.vertices[:, 1] - pieces.vertices[:, 0], axis=1)
    assert (edges > 0).all()
    assert np.isfinite(pieces.normals).all()


def test_patches_that_nothing_crosses_stay_as_they_are():
    cells = patches_of(FLOOR)
    pieces, parents = cut_where_crossed(cells)
    assert pieces is cells
    assert parents.tolist() == [0, 1]


def test_crossings_are_counted_at_some_patches_or_at_all():
    cells = patches_of(FLOOR, upright(0.5, -1, 1), upright(1.5, -1, 1))  # the floor is crossed twice, each wall once
    assert crossings_each(cells, looked_at=10) == 4 / cells.n_patches
    assert crossings_each(cells, looked_at=1) == 2
    assert crossings_each(patches_of(FLOOR, upright(0.5, 0.1, 1)), looked_at=10) == 0


def test_a_patch_that_very_many_cross_stays_whole_and_the_others_are_cut():
    places = np.linspace(0.2, 1.8, MOST_CROSSINGS)
    fence = [upright(x, -1, 1) for x in places]
    assert len(areas_of(0, patches_of(FLOOR, *fence))) == MOST_CROSSINGS + 1
    cells = patches_of(FLOOR, *fence, upright(1.9, -1, 1))
    assert areas_of(0, cells) == [4.0]
    assert areas_of(1, cells) == pytest.approx([4.0, 4.0])


def test_crossings_are_the_same_however_many_pairs_are_looked_at_together(monkeypatch):
    cells = coarsest_patches(random_corner(2, 600))
    at_once, of_all = cut_where_crossed(cells)
    monkeypatch.setattr(crossings, "FIRST", 7)
    monkeypatch.setattr(crossings, "PAIRS_AT_A_TIME", 50)
    by_parts, of_parts = cut_where_crossed(cells)
    assert at_once.n_patches > cells.n_patches
    assert np.array_equal(by_parts.vertices, at_once.vertices)
    assert np.array_equal(of_parts, of_all)
