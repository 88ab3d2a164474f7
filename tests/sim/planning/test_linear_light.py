"""Light that is linear within patches: its slopes against exact form factors, and what is left beside them."""

import numpy as np
import pytest

from sim import _kernel
from sim.form_factors import form_factors
from sim.form_factors.sampled import RaySample
from sim.geometry.adaptive_patches import coarsest_patches
from sim.geometry.crossings import cut_where_crossed
from sim.geometry.mesh import Mesh
from sim.light.lighting import make_test_lighting
from sim.light.sampled_light import sampled_light
from sim.planning.adapt import uniform_patches
from sim.planning.linear_light import Senders, gathered, linear_light, variation_within
from sim.planning.simulation import Model, simulate
from sim.scenes.cluttered import corner_with_ball, random_corner
from sim.scenes.gridded import paper_room
from sim.scenes.meshes import integrating_sphere
from sim.threads import set_threads


def corner_of_two(floor):
    """A floor patch beside a bright wall of 1 m."""
    wall = [[0, 0, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1]]
    vertices = np.array([floor, wall], dtype=float)
    return coarsest_patches(Mesh(name="two", vertices=vertices, reflectance=np.array([0.5, 0.5])))


FLOORS = {
    "quad": [[0.5, 0.2, 0], [0.9, 0.2, 0], [0.9, 0.6, 0], [0.5, 0.6, 0]],
    "triangle": [[0.5, 0.2, 0], [0.9, 0.2, 0], [0.9, 0.6, 0], [0.9, 0.6, 0]],
}
WALL_LIT = np.array([0.0, 1.0])


def exact_pieces(cells):
    """Centres and irradiances of the floor's sixteenths, by the exact factor of a point to a polygon."""
    pieces = cells.chosen([0]).quarters().quarters()
    vertices = np.concatenate([pieces.vertices, cells.vertices[1:]])
    both = Mesh(name="pieces", vertices=vertices, reflectance=np.zeros(17))
    return pieces, form_factors(both, method="polygon", visibility="none").apply(np.append(np.zeros(16), 1.0))[:16]


@pytest.mark.parametrize("floor", FLOORS.values(), ids=FLOORS)
def test_the_slope_that_rays_tell_is_that_of_exact_form_factors(floor):
    cells = corner_of_two(floor)
    pieces, exact = exact_pieces(cells)
    place = np.column_stack([np.ones(16), (pieces.centres - cells.centres[0])[:, :2]])
    weight = np.sqrt(pieces.areas)[:, None]
    expected = np.linalg.lstsq(weight * place, weight[:, 0] * exact, rcond=None)[0][1:]
    sample = RaySample(surface=cells)
    sample.lengthen(1 << 15)
    found = linear_light(sample, cells, WALL_LIT, sample.halves(WALL_LIT).mean)
    assert found.slopes[0, :2] == pytest.approx(expected, abs=0.02 * np.abs(expected).max())
    assert found.slopes[0, 2] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("floor", FLOORS.values(), ids=FLOORS)
def test_what_varies_within_a_patch_is_what_exact_form_factors_say(floor):
    cells = corner_of_two(floor)
    pieces, exact = exact_pieces(cells)
    share = pieces.areas / pieces.areas.sum()
    expected = share @ (exact - share @ exact) ** 2
    seen = variation_within(cells, np.arange(2), Senders.even(cells, WALL_LIT), rays=4096, stream=1)
    assert seen.beside_constant[0] == pytest.approx(expected, rel=0.1)
    assert seen.beside_linear[0] < 0.05 * seen.beside_constant[0]


def test_even_light_in_a_closed_surface_varies_nowhere():
    sphere = coarsest_patches(integrating_sphere(2))
    senders = Senders.even(sphere, np.ones(sphere.n_patches))
    seen = variation_within(sphere, np.arange(sphere.n_patches), senders, rays=8, stream=1)
    assert seen.beside_constant == pytest.approx(0, abs=1e-20)
    assert seen.pieces[0] == pytest.approx(0, abs=1e-12)


def test_senders_with_slopes_send_what_they_have_where_rays_meet_them():
    # Irradiance from a field that grows by height alone, in a closed room: that of a lit ceiling and a dark floor.
    cells = uniform_patches(coarsest_patches(paper_room()), 60)
    up = np.tile([0.0, 0.0, 0.3], (cells.n_patches, 1))
    slopes = up - (cells.normals @ [0, 0, 0.3])[:, None] * cells.normals
    own = np.arange(cells.n_patches)
    linear = Senders(surface=cells, B=0.3 * cells.centres[:, 2], slopes=slopes)
    fine = cells.quarters().quarters()
    even = Senders.even(fine, 0.3 * fine.centres[:, 2])
    low = gathered(cells, own, linear, rays=16, stream=3)[..., 1]
    finer = gathered(cells, own, even, rays=16, stream=3)[..., 0]
    one_number = gathered(cells, own, linear, rays=16, stream=3)[..., 0]
    # What is left are the finer senders' own steps, a quarter as high.
    assert np.abs(low - finer).mean() < 0.3 * np.abs(one_number - finer).mean()


def test_gathered_light_is_the_same_bits_on_any_number_of_threads_and_any_instructions(restored):
    cells = coarsest_patches(corner_with_ball(300))
    senders = Senders.even(cells, np.linspace(0, 1, cells.n_patches))
    found = []
    for count, name in ((1, "baseline"), (2, _kernel.best_instruction_set())):
        set_threads(count)
        _kernel.set_instruction_set(name)
        found.append(gathered(cells, np.arange(cells.n_patches), senders, rays=16, stream=0))
    assert (found[0] == found[1]).all()


def test_linear_light_is_nearer_the_truth_than_one_number_a_patch():
    cells = uniform_patches(coarsest_patches(paper_room()), 100)
    light = make_test_lighting("floor", cells)
    fine = cells.quarters().quarters()
    exact = simulate(fine, light, Model(method="auto", visibility="none", residual=1e-8)).irradiance
    found = simulate(cells, light, Model(method="rays", visibility="rays", residual=1e-6, sampling=0.004, linear=True))
    error = np.sqrt(np.average((found.irradiance_at(fine) - exact)[:, 0] ** 2, weights=fine.areas))
    constant = np.sqrt(np.average((np.tile(found.irradiance, (16, 1)) - exact)[:, 0] ** 2, weights=fine.areas))
    assert error < 0.5 * constant


def test_the_error_of_slopes_is_what_many_rays_find_where_things_pierce_each_other():
    cells = cut_where_crossed(coarsest_patches(random_corner(3, 400)))[0]
    E = cells.reflectance * np.ones(cells.n_patches)
    true = sampled_light(cells, E, cells.reflectance, error=8e-4, seed=9)
    H = (true.B - E) / cells.reflectance
    many = linear_light(true.sample, cells, true.B, H)
    weight = cells.reflectance**2
    for seed in range(3):
        sample = RaySample(surface=cells, seed=seed)
        sample.lengthen(256)
        found = linear_light(sample, cells, true.B, sample.halves(true.B).mean)
        actual = weight @ cells.variation(found.slopes - many.slopes)
        estimated = weight @ (cells.areas * found.squared_error)
        assert 0.8 < estimated / actual < 2


def test_few_rays_find_in_the_sum_what_many_do_where_noise_is_greater_than_what_there_is():
    # Which patches are taken for stepped ones, of whose squares more is hidden, may not depend on noise: its positive
    # part would add up over thousands of patches, twelve times what there is in this corner by eight rays.
    cells, _ = cut_where_crossed(coarsest_patches(random_corner(6, 1000)))
    light = make_test_lighting("uniform", cells)
    B = simulate(cells, light, Model(method="rays", visibility="rays", residual=1e-5, sampling=2e-3)).B[:, 0]
    senders, own = Senders.even(cells, B), np.arange(cells.n_patches)

    def left(rays, stream):
        seen = variation_within(cells, own, senders, rays=rays, stream=stream)
        return float((cells.areas * cells.reflectance**2 * seen.beside_linear).sum())

    many = np.mean([left(512, stream) for stream in (1000, 2000)])
    few = np.array([left(8, 10 * k) for k in range(24)])
    assert few.mean() == pytest.approx(many, abs=4 * few.std() / np.sqrt(len(few)))
    assert few.std() > many
