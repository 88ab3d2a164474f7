"""Rooms that should keep their light, and occluders that should hide it."""

from itertools import pairwise

import numpy as np
import pytest

from sim.form_factors import form_factors
from sim.geometry.checks import mesh_faults
from sim.geometry.mesh import Mesh
from sim.scenes.gridded import furnace, room
from sim.scenes.meshes import sloped_room
from tests.sim.hard_cases.pairs import FACING, SQUARE, lambert, opposed, pair


def room_of_unequal_patches():
    coarse, fine = room((2, 2, 2), 1.0), room((2, 2, 2), 0.25)
    vertices = [fine.vertices[fine.faces[0].patches], coarse.vertices[coarse.faces[0].n_patches :]]
    corners = np.concatenate(vertices)
    return Mesh.from_arrays("unequal", corners.reshape(-1, 3), np.arange(corners.size // 3).reshape(-1, 4), 0.5)


def test_a_room_of_unequal_patches_loses_nothing_at_its_corners(measured):
    measured("closure, patches 1 : 4", form_factors(room_of_unequal_patches()).closure_max, 1e-10)
    measured("closure, polygons", form_factors(room_of_unequal_patches(), "polygon", tolerance=1e-9).closure_max, 1e-8)


def test_a_rotated_room_under_a_sloped_ceiling_keeps_its_light(measured):
    turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    factors = form_factors(sloped_room(0.8, turn * np.linalg.det(turn)), "polygon", tolerance=1e-9)
    measured("closure", factors.closure_max, 1e-8)


def two_rooms():
    """A room parted from wall to wall by a sheet without thickness, both sides lit."""
    scene = room((2, 1, 1), 0.5)
    sheet = np.array([[1.0, 0, 0], [1, 1, 0], [1, 1, 1], [1, 0, 1]])
    vertices = np.concatenate([scene.vertices, [sheet, sheet[::-1]]])
    return Mesh.from_arrays("two rooms", vertices.reshape(-1, 3), np.arange(len(vertices) * 4).reshape(-1, 4), 0.5)


def test_no_light_leaks_past_a_sheet_that_parts_a_room(measured):
    mesh = two_rooms()
    assert [problem.kind for problem in mesh_faults(mesh) if problem.kind != "t-junction"] == ["contact"]
    matrix = form_factors(mesh).matrix
    left = np.where(np.abs(mesh.centres[:, 0] - 1) < 1e-9, mesh.normals[:, 0] < 0, mesh.centres[:, 0] < 1)
    measured("largest factor through the sheet", matrix[left][:, ~left].max(), 1e-15)
    measured("row sums", np.abs(matrix.sum(axis=1) - 1).max(), 1e-5)


def strip_between(low, high):
    """Two plates, and half-way between them a strip from one edge to the other."""
    strip = SQUARE * (high - low, 1, 1) + np.array([low, 0, 0.5])
    return Mesh(name="strip", vertices=np.stack([SQUARE, FACING, strip]), reflectance=np.full(3, 0.5))


def hidden_share(low, high, steps=1000):
    """Share that the strip hides, by Lambert's factor of its shadow on the upper plate at points of the lower."""
    gauss, weights = np.polynomial.legendre.leggauss(20)
    x, y = np.meshgrid((np.arange(steps) + 0.5) / steps, (gauss + 1) / 2, indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    west, east = (np.clip(2 * rim - points[:, 0], 0, 1) for rim in (low, high))
    south, north = np.clip(-points[:, 1], 0, 1), np.clip(2 - points[:, 1], 0, 1)
    corners = [(west, south), (west, north), (east, north), (east, south)]
    shadow = np.stack([np.stack([a, b, np.ones(x.size)], axis=1) for a, b in corners], axis=1)
    factor = lambert(points, np.array([0.0, 0, 1]), shadow).reshape(x.shape)
    return factor.mean(axis=0) @ weights / 2 / opposed(1, 1)


@pytest.mark.parametrize("width", [0.1, 1e-2, 1e-3])
def test_occluders_thinner_than_a_patch_hide_their_share(measured, width):
    rims = [0.0, 0.5 - width / 2, 0.5 + width / 2, 1.0]
    free = form_factors(pair(SQUARE, FACING)).matrix[0, 1]
    hidden = [1 - form_factors(strip_between(*strip)).matrix[0, 1] / free for strip in pairwise(rims)]
    # Strips that tile the plane between the plates hide, one after the other, exactly everything.
    measured("hidden shares of strips that tile the plane, off 1", abs(sum(hidden) - 1), 1e-12)
    expected = hidden_share(rims[1], rims[2])
    measured("relative error of the thin strip's share", abs(hidden[1] / expected - 1), 5e-3)


def test_a_wall_between_two_plates_hides_all():
    mesh = Mesh(
        name="wall",
        vertices=np.stack([SQUARE, FACING, SQUARE * (1.2, 1.2, 1) + (-0.1, -0.1, 0.5)]),
        reflectance=np.full(3, 0.5),
    )
    assert form_factors(mesh).matrix[0, 1] == 0


@pytest.mark.filterwarnings("ignore::sim.form_factors.factors.ClosureWarning")
def test_occluded_factors_lie_between_nothing_and_the_free_ones():
    box = Mesh.from_arrays(
        "block",
        np.array([[x, y, z] for z in (0.4, 0.6) for y in (0.4, 0.6) for x in (0.4, 0.6)]),
        np.array([[0, 2, 3, 1], [4, 5, 7, 6], [0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3]]),
        0.5,
    )
    scene = furnace(0.25)
    mesh = Mesh(
        name="block in room", vertices=np.concatenate([scene.vertices, box.vertices]), reflectance=np.full(102, 0.5)
    )
    free, occluded = (form_factors(mesh, visibility=visibility).matrix for visibility in ("none", "exact"))
    assert (occluded >= 0).all()
    assert (occluded <= free).all()
    exchange = mesh.areas[:, None] * occluded
    assert np.allclose(exchange, exchange.T, rtol=1e-14, atol=0)
