"""Pairs of patches in awkward places against formulae and quadrature."""

import numpy as np
import pytest

from sim.form_factors import form_factors
from sim.geometry.mesh import Mesh
from sim.scenes.meshes import grid_of_quad
from tests.sim.hard_cases.pairs import FACING, SQUARE, opposed, pair, reference_factor
from tests.sim.plates import parallel_plates, wedge


@pytest.mark.parametrize("degrees", [1, 5, 30, 60, 90, 120, 150, 175, 179])
def test_wedges_of_any_angle_agree_with_lambert(measured, degrees):
    mesh = wedge(degrees)
    factor = form_factors(mesh, "polygon", tolerance=1e-10).matrix[0, 1]
    expected = reference_factor(mesh.vertices[0], mesh.vertices[1])
    measured("relative error of F", abs(factor / expected - 1), 1e-8)


@pytest.mark.parametrize("degrees", [1, 10, 45, 90, 135, 170, 179])
def test_long_wedges_tend_to_crossed_strings(measured, degrees):
    # Infinitely long strips: F = 1 - sin(angle / 2). Ends cost less than a width in the length, from above none.
    length = 1000.0
    factor = form_factors(wedge(degrees, length), "polygon", tolerance=1e-10).matrix[0, 1]
    infinite = 1 - np.sin(np.radians(degrees) / 2)
    assert factor < infinite
    measured("1 - F / F infinite", 1 - factor / infinite, 1 / length)


def test_the_axis_parallel_wedge_is_the_same_in_closed_form(measured):
    mesh = wedge(90)
    exact, polygon = (form_factors(mesh, method).matrix[0, 1] for method in ("closed_form", "polygon"))
    assert exact == pytest.approx(0.200043776075, abs=1e-12)
    measured("difference of polygon and closed form", abs(polygon / exact - 1), 1e-6)


def test_patches_that_share_a_vertex_only_agree_with_lambert(measured):
    wall = np.array([[1.0, 1, 0], [1, 2, 0], [1, 2, 1], [1, 1, 1]])[::-1]
    factor = form_factors(pair(SQUARE, wall), "polygon", tolerance=1e-10).matrix[0, 1]
    measured("relative error of F", abs(factor / reference_factor(SQUARE, wall) - 1), 1e-8)


@pytest.mark.parametrize("gap", [1e-6, 1e-5, 1e-4, 1e-3, 1e-2])
@pytest.mark.parametrize("method", ["closed_form", "polygon"])
def test_plates_with_a_gap_of_nearly_nothing_agree_with_the_textbook(measured, method, gap):
    factor = form_factors(parallel_plates((1, 1), gap, 1.0), method, "none").matrix[0, 1]
    measured("error of F", abs(factor - opposed(1 / gap, 1 / gap)), 1e-8 if method == "closed_form" else 1e-6)


@pytest.mark.parametrize("width", [1e-1, 1e-2, 1e-3])
def test_slivers_facing_each_other_agree_with_the_textbook(measured, width):
    first, second = SQUARE * (1, width, 1), FACING * (1, width, 1)
    expected = opposed(1, width)
    for method, limit in (("closed_form", 1e-8), ("polygon", 1e-6)):
        factor = form_factors(pair(first, second), method).matrix[0, 1]
        measured(f"relative error of F, {method}", abs(factor / expected - 1), limit)


def test_slivers_along_a_shared_edge_agree_with_lambert(measured):
    sliver = np.array([[0.0, 0, 0], [0, 1, 0], [0, 1, 1e-3], [0, 0, 1e-3]])
    factors = form_factors(pair(SQUARE, sliver), "polygon", tolerance=1e-9).matrix
    measured("relative error of F", abs(factors[1, 0] / reference_factor(sliver, SQUARE) - 1), 1e-6)


@pytest.mark.parametrize("place", ["opposite", "at the edge"])
def test_patches_a_thousand_times_larger_agree_with_lambert(measured, place):
    small = FACING * 1e-3 if place == "opposite" else SQUARE[:, [2, 0, 1]] * 1e-3
    small = small + (np.array([0.5, 0.5, 0.5]) if place == "opposite" else np.array([0, 0.5, 0]))
    factors = form_factors(pair(SQUARE, small), "polygon", tolerance=1e-9).matrix
    measured("relative error of F small to large", abs(factors[1, 0] / reference_factor(small, SQUARE) - 1), 1e-7)
    assert factors[0, 1] == pytest.approx(1e-6 * factors[1, 0], rel=1e-12)


@pytest.mark.parametrize("method", ["closed_form", "polygon", "paper"])
def test_coplanar_patches_exchange_exactly_nothing(method):
    turn = np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1]])
    floor = grid_of_quad(SQUARE, 4, 4)
    mesh = Mesh(
        name="floor", vertices=floor if method == "closed_form" else floor @ turn.T + 0.1, reflectance=np.full(16, 0.5)
    )
    assert not form_factors(mesh, method).matrix.any()


@pytest.mark.parametrize("method", ["closed_form", "polygon"])
def test_a_patch_cut_by_anothers_horizon_counts_with_its_upper_part(measured, method):
    floor = SQUARE * (0.9, 1, 1)
    wall = np.array([[1.0, 0, -0.5], [1, 0, 0.5], [1, 1, 0.5], [1, 1, -0.5]])
    upper = wall * (1, 1, 0) + np.maximum(wall, 0) * (0, 0, 1)
    cut = form_factors(pair(floor, wall), method, "none", tolerance=1e-9).matrix[0, 1]
    expected = reference_factor(floor, upper)
    measured("relative error of F", abs(cut / expected - 1), 1e-7)


def test_a_patch_wholly_behind_another_gets_exactly_nothing():
    behind = SQUARE + np.array([0, 0, -1.0])
    assert not form_factors(pair(SQUARE, behind), "polygon", "none").matrix.any()
