"""Adaptive patches, of unequal size: what they cover, how they are split, and where."""

import numpy as np
import pytest

from sim.errors import SimulationError
from sim.form_factors import form_factors
from sim.geometry.adaptive_patches import coarsest_patches
from sim.geometry.mesh import Mesh
from sim.light.lighting import emission, make_test_lighting, sample_points
from sim.planning.adapt import Refinement, SolvedPatches, gradients, uniform_patches
from sim.planning.simulation import Model, simulate
from sim.scenes.gridded import corner, paper_room, room, room_with_box
from sim.scenes.meshes import grid_of_quad, integrating_sphere, sloped_room


def refined(scene, light_name, cells, probe_cells=500):
    whole = coarsest_patches(scene)
    light = make_test_lighting(light_name, whole)
    model = Model(method="auto", visibility="auto", residual=1e-8)
    solved = simulate(uniform_patches(whole, probe_cells), light, model)
    refinement = Refinement.start(whole, SolvedPatches.of(solved.cells, solved.irradiance[:, 0]), light)
    refinement.refine(0.0, cells)
    return refinement


@pytest.mark.parametrize("surface", [paper_room(), sloped_room(2.0), integrating_sphere(1)], ids=lambda s: s.name)
def test_halves_keep_area_side_and_plane(surface):
    cells = coarsest_patches(surface)
    pieces = cells.quarters()
    assert pieces.n_patches == 4 * cells.n_patches
    sums = pieces.areas.reshape(4, -1).sum(axis=0)
    assert sums == pytest.approx(cells.areas)
    assert np.tile(cells.normals, (4, 1)) == pytest.approx(pieces.normals)
    centres = (pieces.areas[:, None] * pieces.centres).reshape(4, -1, 3).sum(axis=0) / sums[:, None]
    assert centres == pytest.approx(cells.centres)


def drawn_patches(seed):
    """Triangles and flat quads of all shapes and sizes, anywhere."""
    draw = np.random.default_rng(seed)
    a, b, c = draw.normal(size=(3, 60, 3)) * 10.0 ** draw.uniform(-2, 2, (60, 1))
    d = np.where(np.arange(60)[:, None] % 2, a + c - b + draw.uniform(-0.4, 0.4, (60, 1)) * (c - a), c)
    return coarsest_patches(Mesh(name="drawn", vertices=np.stack([a, b, c, d], axis=1), reflectance=np.full(60, 0.5)))


@pytest.mark.parametrize("seed", range(4))
def test_sixteenths_are_the_quarters_of_quarters_to_the_last_bit(seed):
    cells = drawn_patches(seed)
    found, defined = cells.sixteenths(), cells.quarters().quarters()
    assert (found.corners == defined.vertices).all()
    assert found.areas == pytest.approx(defined.areas, rel=1e-12)
    size = np.ptp(defined.vertices, axis=1).max(axis=1, keepdims=True)
    assert (np.abs(found.centres - defined.centres) <= 1e-12 * (size + np.abs(defined.centres))).all()


def test_a_room_begins_with_a_cell_a_face():
    assert coarsest_patches(paper_room()).n_patches == 6
    assert coarsest_patches(corner()).n_patches == 3


def test_the_floor_is_cut_along_the_foot_of_a_box_and_left_out_under_it():
    cells = coarsest_patches(room_with_box(patch_size_m=0.4))
    floor = cells.chosen(cells.region == 0)
    assert floor.n_patches == 8
    assert floor.areas.sum() == pytest.approx(4.8**2 - 1.0)
    assert set(np.round(floor.vertices[:, :, 0].ravel(), 9)) == {0.0, 1.9, 2.9, 4.8}


def test_a_room_with_a_box_is_closed_once_the_covered_floor_is_left_out():
    cells = uniform_patches(coarsest_patches(room_with_box()), 300)
    assert cells.closed
    assert form_factors(cells, visibility="exact").row_sums == pytest.approx(1.0, abs=2e-3)


def test_a_face_with_a_picture_on_it_keeps_its_patches():
    scene = paper_room()
    rho = scene.reflectance.copy()
    rho[3] = 0.2
    cells = coarsest_patches(scene.with_reflectance(rho))
    assert (cells.region == 0).sum() == 144
    assert cells.n_patches == 144 + 5


def test_cells_of_unequal_size_lose_no_light_in_a_closed_room():
    cells = refined(paper_room(), "projector", 300).cells
    assert cells.areas.max() > 10 * cells.areas.min()
    factors = form_factors(cells)
    assert factors.row_sums == pytest.approx(1.0, abs=1e-10)
    assert cells.areas.sum() == pytest.approx(92.16)


def test_the_variation_of_a_linear_light_over_a_cell_is_exact():
    cells = coarsest_patches(sloped_room(2.4))
    gradient = np.tile([0.3, -0.2, 0.5], (cells.n_patches, 1))
    points, weights = sample_points(cells, 60)
    heights = ((points - cells.centres[:, None]) * gradient[:, None]).sum(axis=2)
    assert cells.variation(gradient) == pytest.approx(cells.areas * (weights * heights**2).sum(axis=1), rel=1e-3)


def test_the_gradient_of_a_linear_light_is_exact_and_nothing_is_rough():
    cells = refined(paper_room(), "floor", 200).cells
    slope = np.array([0.3, -0.2, 0.5])
    gradient, roughness = gradients(cells, cells.centres @ slope)
    in_plane = slope - (cells.normals @ slope)[:, None] * cells.normals
    assert gradient == pytest.approx(in_plane, abs=1e-9)
    assert roughness == pytest.approx(0, abs=1e-15)


def test_light_that_steps_at_a_wall_tells_no_slope_to_patches_that_see_only_their_own_side():
    wall = [[0.5, 0.0, -0.2], [0.5, 1.0, -0.2], [0.5, 1.0, 1.0], [0.5, 0.0, 1.0]]
    floor = grid_of_quad([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], 8, 8)
    below = [[0, 0, -1], [1, 0, -1], [1, 1, -1], [0, 1, -1]]
    points = np.concatenate([floor.reshape(-1, 3), wall, below])
    cells = coarsest_patches(Mesh.from_arrays("two halves", points, np.arange(len(points)).reshape(-1, 4), 0.5))
    values = np.where(cells.centres[:, 0] < 0.5, 1.0, 3.0)
    on_floor = cells.centres[:, 2] == 0
    assert np.abs(gradients(cells, values)[0][on_floor, 0]).max() > 1
    assert gradients(cells, values, in_sight=True)[0][on_floor] == pytest.approx(0, abs=1e-9)


def test_cells_are_small_where_lit_floor_and_dark_wall_meet():
    cells = refined(corner(), "floor", 100).cells
    walls = cells.region > 0
    low, high = cells.centres[:, 2] < 0.5, cells.centres[:, 2] > 1.5
    assert cells.areas[walls & low].mean() < 0.5 * cells.areas[walls & high].mean()


def test_more_cells_leave_less_error():
    scene = room((2.0, 2.0, 2.0), 1.0)
    errors = [refined(scene, "floor", n).error for n in (12, 50, 200, 800)]
    assert np.all(np.diff(errors) < 0)
    # Of constant cells in the plane: error ~ cells^(-1/2) or a little better.
    assert 0.4 < np.log(errors[1] / errors[3]) / np.log(800 / 50) < 0.8


def test_adapted_cells_are_nearer_the_truth_than_as_many_even_ones():
    whole = coarsest_patches(paper_room())
    light, model = make_test_lighting("floor", whole), Model(method="auto", visibility="auto", residual=1e-8)
    even = uniform_patches(whole, 300)
    adapted = refined(paper_room(), "floor", even.n_patches).cells
    assert adapted.n_patches == even.n_patches
    errors = []
    for cells in (adapted, even):
        fine = simulate(cells.quarters(), light, model)
        coarse = simulate(cells, light, model)
        difference = fine.irradiance - np.tile(coarse.irradiance, (4, 1))
        errors.append(np.sqrt((fine.cells.areas[:, None] * difference**2).sum()))
    assert errors[0] < 0.85 * errors[1]


def test_light_on_the_floor_is_on_the_floor_alone():
    cells = uniform_patches(coarsest_patches(room_with_box()), 100)
    lit = emission(cells, make_test_lighting("floor", cells)).irradiance
    assert set(np.unique(lit)) == {0.0, 1.0}
    assert (cells.centres[lit > 0, 2] == 0).all()


def test_the_standard_projector_lights_half_of_the_papers_room():
    cells = uniform_patches(coarsest_patches(paper_room()), 1000)
    light = emission(cells, make_test_lighting("projector", cells))
    assert cells.areas[light.irradiance > 0].sum() / cells.areas.sum() == pytest.approx(0.52, abs=0.06)
    assert 0.9 < light.irradiance.max() <= 1


def test_the_box_throws_a_shadow_and_its_sides_away_from_the_projector_are_dark():
    cells = uniform_patches(coarsest_patches(room_with_box()), 1500)
    irradiance = emission(cells, make_test_lighting("projector", cells)).irradiance
    behind = (np.abs(cells.centres - [3.1, 3.1, 0.0]) < 0.2).all(axis=1) & (cells.region == 0)
    assert behind.any()
    assert irradiance[behind].max() == 0
    away = np.isclose(cells.centres[:, 0], 2.9)
    assert irradiance[away & (cells.normals[:, 0] > 0.5)].max() == 0


def test_an_unknown_light_names_those_there_are():
    with pytest.raises(SimulationError, match="projector, floor, uniform"):
        make_test_lighting("sun", coarsest_patches(corner()))
