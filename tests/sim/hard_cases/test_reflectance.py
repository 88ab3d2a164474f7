"""Reflectance near one, closure, the integrating sphere, precision and size."""

from dataclasses import replace

import numpy as np
import pytest

from sim.errors import SimulationError
from sim.form_factors import form_factors
from sim.light.radiosity import Radiosity
from sim.scenes.gridded import paper_room
from sim.scenes.meshes import integrating_sphere


@pytest.mark.parametrize("rho", [0.9, 0.99, 0.999, 0.9999])
def test_a_furnace_is_right_however_close_to_one_its_reflectance(closed_room, measured, rho):
    solution = Radiosity(closed_room, rho, tolerance=1e-13).solution(np.ones(576))
    error = np.abs(solution.B - 1 / (1 - rho)).max()
    measured("relative error of B", error * (1 - rho), 1e-11 / (1 - rho))
    # The bound is for these form factors; what they are off adds closure times rho / (1 - rho).
    assert error <= solution.error_bound + closed_room.closure_max * rho / (1 - rho) ** 2


@pytest.mark.parametrize("rho", [0.5, 0.9, 0.99])
def test_a_closure_defect_is_amplified_as_foretold(closed_room, measured, rho):
    defect = 1e-4
    wrong = replace(closed_room, matrix=closed_room.matrix * (1 + defect), row_sums=closed_room.row_sums * (1 + defect))
    B = Radiosity(wrong, rho).solve(np.ones(576))
    foretold = 1 / (1 - rho * (1 + defect))
    measured("departure from 1 / (1 - rho (1 + defect))", np.abs(B / foretold - 1).max(), 1e-9)


@pytest.mark.filterwarnings("ignore::sim.form_factors.factors.ClosureWarning")
def test_the_papers_quadrature_brightens_a_furnace_within_its_row_sums():
    factors = form_factors(paper_room(), "paper")
    for rho in (0.7, 0.9):
        B = Radiosity(factors, rho).solve(np.ones(576))
        low, high = (1 / (1 - rho * bound) for bound in (factors.row_sums.min(), factors.row_sums.max()))
        assert low <= B.min()
        assert B.max() <= high
    with pytest.raises(SimulationError, match="never fades"):
        Radiosity(factors, 0.985)


def test_reflectance_one_in_a_closed_room_is_refused(closed_room):
    with pytest.raises(SimulationError, match="never fades"):
        Radiosity(closed_room, 1.0)


def test_without_reflectance_radiosity_is_emission(closed_room):
    E = np.random.default_rng(0).random(576)
    assert np.array_equal(Radiosity(closed_room, 0.0).solve(E), E)


def test_the_facets_of_a_sphere_tend_to_its_factors(measured):
    spread = []
    for subdivisions in (1, 2, 3):
        sphere = integrating_sphere(subdivisions)
        factors = form_factors(sphere, "polygon", tolerance=1e-9)
        measured(f"closure, {sphere.n_patches} facets", factors.closure_max, 1e-9)
        apart = np.linalg.norm(sphere.centres[:, None] - sphere.centres, axis=2) > 0.7
        exact = sphere.areas / sphere.areas.sum()
        spread.append(np.abs(factors.matrix / exact - 1)[apart].mean())
        measured(
            f"mean of |F_ij / (A_j / 4 pi R²) - 1|, {sphere.n_patches} facets", spread[-1], 0.04 / 2**subdivisions * 2
        )
    # Facets are not equilateral: their normals are off the centroids' radii by a share of their size.
    assert spread[0] / spread[1] > 1.8
    assert spread[1] / spread[2] > 1.8


def test_the_sphere_itself_is_solved_exactly_for_any_light(measured):
    sphere, rho = integrating_sphere(2), 0.95
    share = sphere.areas / sphere.areas.sum()
    matrix = np.tile(share, (len(share), 1))
    np.fill_diagonal(matrix, 0)
    factors = form_factors(sphere, "polygon")
    exact = replace(factors, matrix=matrix, row_sums=1 - share)
    E = np.random.default_rng(1).random(len(share))
    B = Radiosity(exact, rho, tolerance=1e-14).solve(E)
    # B_i = E_i + rho (M - share_i B_i): flat facets do not see themselves; M is the mean of B.
    loss = share / (1 + rho * share)
    mean = (loss @ E) / (1 - rho * loss.sum())
    measured("relative error of B", np.abs(B * (1 + rho * share) / (E + rho * mean) - 1).max(), 1e-12)


@pytest.mark.parametrize("rho", [0.7, 0.99, 0.999])
def test_single_precision_is_off_by_no_more_than_its_rounding_amplified(closed_room, measured, rho):
    E = np.random.default_rng(6).random(576)
    double = Radiosity(closed_room, rho).solve(E)
    single = Radiosity(closed_room.in_single_precision(), rho).solve(E)
    measured("relative difference", np.abs(single / double - 1).max(), 2**-24 * (1 + rho / (1 - rho)))
    mixed = Radiosity(closed_room, rho, precision="mixed").solve(E)
    measured("relative difference, refined", np.abs(mixed / double - 1).max(), 1e-10)


@pytest.mark.parametrize("patch_size_m", [0.4, 0.2, 0.1])
def test_finer_patches_keep_closure_and_reciprocity(measured, patch_size_m):
    scene = paper_room(patch_size_m=patch_size_m)
    factors = form_factors(scene)
    measured(f"closure, {scene.n_patches} patches", factors.closure_max, 1e-10)
    some = np.random.default_rng(7).integers(scene.n_patches, size=(2, 10_000))
    there, back = (scene.areas[a] * factors.matrix[a, b] for a, b in (some, some[::-1]))
    assert np.allclose(there, back, rtol=4e-16, atol=0)
