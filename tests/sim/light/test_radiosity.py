"""The radiosity system against what is known exactly."""

import numpy as np
import pytest

from sim.errors import SimulationError
from sim.form_factors import ClosureWarning, form_factors
from sim.light.radiosity import Radiosity, gauss_seidel, jacobi
from sim.scenes.gridded import corner, furnace, paper_room, room


def floor_lit(scene):
    """Emission when the first face gets white light and the others none."""
    return np.where(scene.region == 0, scene.reflectance, 0.0)


def difference_rms(coarse, B_coarse, fine, B_fine):
    """RMS over the surface of the difference of two piecewise constant radiosities on the same faces."""
    parents = []
    for face, same in zip(coarse.faces, fine.faces, strict=True):
        u, v = np.meshgrid((np.arange(same.columns) + 0.5) / same.columns, (np.arange(same.rows) + 0.5) / same.rows)
        parents.append(face.patch_at(np.stack([u.ravel(), v.ravel()], axis=1)))
    squared = (B_coarse[np.concatenate(parents)] - B_fine) ** 2
    return float(np.sqrt((fine.areas * squared).sum() / fine.areas.sum()))


@pytest.fixture(scope="module")
def cube():
    scene = furnace(patch_size_m=0.25)
    return scene, form_factors(scene)


@pytest.mark.parametrize("reflectance", [0.0, 0.3, 0.9, 0.99, 0.9999])
def test_a_furnace_glows_as_one_over_one_minus_rho(cube, reflectance):
    _, factors = cube
    B = Radiosity(factors, reflectance).solve(np.ones(96))
    assert np.allclose(B, 1 / (1 - reflectance), rtol=1e-9)


def test_the_iterative_solver_agrees_with_the_direct_one():
    scene = paper_room(patch_size_m=0.2, reflectance=0.95)
    E = np.random.default_rng(0).random(scene.n_patches)
    radiosity = Radiosity(form_factors(scene), scene.reflectance)
    iterative = radiosity.solve(E)
    G = scene.reflectance[:, None] * radiosity.form_factors.matrix
    assert np.allclose(iterative, np.linalg.solve(np.eye(len(G)) - G, E), rtol=1e-9)
    assert radiosity.accuracy(iterative, E).residual < 1e-10


def test_the_error_bound_holds(cube):
    _, factors = cube
    radiosity = Radiosity(factors, 0.8)
    E = np.random.default_rng(1).random(96)
    B = radiosity.solve(E)
    wrong = B + 1e-3 * np.random.default_rng(2).normal(size=96)
    assert np.abs(wrong - B).max() / E.max() <= radiosity.accuracy(wrong, E).error_bound


def test_light_is_neither_made_nor_lost():
    scene = room((2.0, 1.5, 1.0), 0.25, {"floor": 0.2, "ceiling": 0.9, "x0": 0.0, "x1": 0.5, "y0": 0.7, "y1": 1.0})
    factors = form_factors(scene)
    E = np.random.default_rng(3).random(scene.n_patches)
    B = Radiosity(factors, scene.reflectance).solve(E)
    incident = factors.matrix @ B
    absorbed = (scene.areas * (1 - scene.reflectance) * incident).sum()
    assert absorbed == pytest.approx((scene.areas * E).sum(), rel=1e-10)


def test_a_black_patch_shows_its_emission_and_nothing_else(cube):
    _, factors = cube
    rho = np.where(np.arange(96) < 16, 0.0, 0.6)
    E = np.random.default_rng(4).random(96)
    B = Radiosity(factors, rho).solve(E)
    assert np.array_equal(B[:16], E[:16])
    assert (B[16:] > E[16:]).all()


@pytest.mark.parametrize("size_m", [0.25, 0.1])
def test_the_adjoint_solves_the_transposed_system(size_m):
    scene = corner(patch_size_m=size_m, reflectance={"floor": 0.9, "x0": 0.4, "y0": 0.0})
    radiosity = Radiosity(form_factors(scene), scene.reflectance)
    rng = np.random.default_rng(5)
    E, e = rng.random((scene.n_patches, 3)), rng.random((scene.n_patches, 3))
    assert (radiosity.solve(E) * e).sum() == pytest.approx((E * radiosity.solve_adjoint(e)).sum(), rel=1e-10)


def test_jacobi_and_gauss_seidel_reach_the_direct_solution(cube):
    _, factors = cube
    E = np.random.default_rng(6).random(96)
    direct = Radiosity(factors, 0.7).solve(E)
    by_jacobi, jacobi_steps = jacobi(0.7 * factors.matrix, E)
    by_gauss_seidel, sweeps = gauss_seidel(0.7 * factors.matrix, E)
    assert np.allclose(by_jacobi, direct, rtol=1e-8)
    assert np.allclose(by_gauss_seidel, direct, rtol=1e-8)
    assert sweeps < jacobi_steps


def test_jacobi_says_so_when_it_does_not_arrive(cube):
    _, factors = cube
    with pytest.raises(SimulationError, match="not within"):
        jacobi(1.01 * factors.matrix, np.ones(96), limit=50)


def test_the_spectral_radius_of_a_closed_room_is_its_reflectance(cube):
    _, factors = cube
    assert Radiosity(factors, 0.9).spectral_radius() == pytest.approx(0.9, abs=1e-9)


def test_the_papers_quadrature_is_refused_where_it_makes_light():
    with pytest.warns(ClosureWarning):
        factors = form_factors(paper_room(), "paper")
    assert (Radiosity(factors, 0.98).solve(np.ones(576)) > 0).all()
    with pytest.raises(SimulationError, match=r"spectral radius of rho F is 1\.00.*closed_form"):
        Radiosity(factors, 0.985)


def test_a_perfect_mirror_of_light_is_refused(cube):
    _, factors = cube
    with pytest.raises(SimulationError, match="never fades"):
        Radiosity(factors, 1.0)


def test_wrong_shapes_and_reflectances_are_refused(cube):
    _, factors = cube
    with pytest.raises(SimulationError, match="96 patches"):
        Radiosity(factors, np.ones(5))
    with pytest.raises(SimulationError, match=r"0 \.\.\. 1"):
        Radiosity(factors, -0.1)
    with pytest.raises(SimulationError, match="96 patches"):
        Radiosity(factors, 0.5).solve(np.ones(3))


def test_refinement_converges_at_about_first_order():
    scenes = [paper_room(patch_size_m=size_m) for size_m in (0.8, 0.4, 0.2)]
    solved = [Radiosity(form_factors(scene), 0.7).solve(floor_lit(scene)) for scene in scenes]
    coarse = difference_rms(scenes[0], solved[0], scenes[1], solved[1])
    fine = difference_rms(scenes[1], solved[1], scenes[2], solved[2])
    assert 1.5 < coarse / fine < 2.5


@pytest.mark.parametrize("reflectance", [0.7, 0.95, 0.99, 0.999])
def test_thirty_products_solve_any_room_to_ten_digits(reflectance):
    factors = form_factors(paper_room())
    E = floor_lit(paper_room(reflectance=reflectance))
    solution = Radiosity(factors, reflectance, tolerance=1e-10).solution(E)
    assert solution.products <= 30
    exact = np.linalg.solve(np.eye(576) - reflectance * factors.matrix, E)
    assert np.linalg.norm(solution.B - exact) < 1e-9 * np.linalg.norm(exact)


@pytest.mark.parametrize("reflectance", [0.7, 0.999, 0.9999])
@pytest.mark.parametrize("precision", ["double", "mixed"])
def test_the_error_bound_of_a_solution_is_true(reflectance, precision):
    factors = form_factors(paper_room())
    E = np.random.default_rng(7).random(576)
    solution = Radiosity(factors, reflectance, tolerance=1e-9, precision=precision).solution(E)
    exact = np.linalg.solve(np.eye(576) - reflectance * factors.matrix, E)
    error = np.abs(solution.B - exact).max() / E.max()
    assert error <= solution.error_bound < 1e-2
    assert (solution.products_single > 0) == (precision == "mixed")


def test_an_error_bound_exists_where_row_sums_reach_beyond_one():
    with pytest.warns(ClosureWarning):
        factors = form_factors(paper_room(), "paper")
    radiosity = Radiosity(factors, 0.95, tolerance=1e-6)
    E = np.random.default_rng(8).random(576)
    solution = radiosity.solution(E)
    exact = np.linalg.solve(np.eye(576) - 0.95 * factors.matrix, E)
    assert 0.95 * factors.row_sums.max() > 1
    assert np.abs(solution.B - exact).max() / E.max() <= solution.error_bound < 1e-2


def test_all_solvers_give_the_same_light():
    scene = paper_room(reflectance=0.9)
    factors = form_factors(scene)
    E = np.random.default_rng(9).random((576, 8))
    by = {name: Radiosity(factors, 0.9, solver=name).solve(E) for name in ("conjugate_gradients", "direct", "repeated")}
    assert np.allclose(by["conjugate_gradients"], by["direct"], rtol=1e-10)
    assert np.array_equal(by["direct"], by["repeated"])
    single = Radiosity(factors, 0.9, precision="mixed").solve(E[:, 0])
    assert np.allclose(single, by["direct"][:, 0], rtol=1e-10)


def test_unknown_solvers_and_precisions_are_refused(cube):
    _, factors = cube
    with pytest.raises(SimulationError, match="auto, repeated, conjugate_gradients, direct"):
        Radiosity(factors, 0.5, solver="magic")
    with pytest.raises(SimulationError, match="double, mixed"):
        Radiosity(factors, 0.5, precision="half")
