"""Form factors by rays: known answers, reciprocity, energy, convergence, the same bits everywhere."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from sim import _kernel
from sim.errors import SimulationError
from sim.form_factors import form_factors
from sim.form_factors.sampled import RaySample, sampled_form_factors
from sim.geometry.mesh import Mesh
from sim.light.radiosity import Radiosity
from sim.light.sampled_light import GAIN, _wanted, received, sampled_light
from sim.scenes.cluttered import corner_with_ball, random_corner
from sim.scenes.gridded import paper_room, room_with_box
from sim.scenes.meshes import grid_of_quad, integrating_sphere
from sim.threads import set_threads


def sampled(surface, rays, seed=0):
    sample = RaySample(surface=surface, seed=seed)
    sample.lengthen(rays)
    return sampled_form_factors(sample)


def mesh_of(*quads):
    vertices = np.array(quads, dtype=float)
    return Mesh(name="plates", vertices=vertices, reflectance=np.full(len(vertices), 0.5))


def hits(surface, rays=64, seed=0):
    met = np.empty((surface.n_patches, rays), dtype=np.int32)
    _kernel.RayTree(np.ascontiguousarray(surface.vertices)).sample(np.arange(surface.n_patches), seed, 0, met)
    return met


def test_parallel_and_perpendicular_unit_squares_have_their_published_factors():
    # Howell, A Catalog of Radiation Heat Transfer Configuration Factors, C-11 and C-14.
    parallel = mesh_of([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 0, 1], [0, 1, 1], [1, 1, 1], [1, 0, 1]])
    perpendicular = mesh_of([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 0, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1]])
    assert form_factors(parallel, method="rays", rays=1 << 14).matrix[0, 1] == pytest.approx(0.199825, abs=1e-3)
    assert form_factors(perpendicular, method="rays", rays=1 << 14).matrix[0, 1] == pytest.approx(0.200044, abs=1e-3)


def test_inside_a_sphere_every_patch_sees_all_others_by_their_share_of_the_surface():
    sphere = integrating_sphere(3)
    light = np.random.default_rng(0).uniform(size=sphere.n_patches)
    received = sampled(sphere, 1024).apply(light)
    # Facets of an icosahedron cut three times: 0.5 % off the sphere's own factor.
    assert received == pytest.approx(np.average(light, weights=sphere.areas), rel=0.05)
    assert received.mean() == pytest.approx(np.average(light, weights=sphere.areas), rel=5e-3)


@pytest.mark.parametrize("surface", [paper_room(), integrating_sphere(2)], ids=["room", "sphere"])
def test_no_ray_leaves_a_closed_surface_and_rows_sum_to_one(surface):
    assert (hits(surface) >= 0).all()
    factors = sampled(surface, 64)
    assert factors.row_sums == pytest.approx(1.0, abs=2e-3)
    assert factors.row_sums.max() <= 1


def test_reciprocity_is_exact():
    K = sampled(random_corner(1, 800), 64).exchange_areas
    assert abs(K - K.T).max() == 0


@pytest.mark.parametrize("seed", range(4))
def test_light_never_grows_even_with_white_walls_and_few_rays(seed):
    surface = random_corner(seed, 500)
    factors = sampled(surface, 16, seed)
    assert factors.row_sums.max() <= 1
    assert Radiosity(factors, 1.0).spectral_radius() <= 1
    dense = form_factors(surface, method="rays", rays=16)
    assert dense.spectral_radius <= 1


def test_two_patches_that_see_nobody_else_do_not_create_light():
    # Their measured sums contradict each other: no scaling meets both.
    large, small = (
        [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]],
        [[0, 0, 0.3], [0, 0.1, 0.3], [0.1, 0.1, 0.3], [0.1, 0, 0.3]],
    )
    factors = sampled(mesh_of(large, small), 16)
    assert factors.row_sums.max() <= 1


def test_shadows_of_rays_and_of_polygons_agree():
    scene = room_with_box()
    E = scene.reflectance * (scene.region == 0)
    exact = Radiosity(form_factors(scene), scene.reflectance).solve(E)
    by_rays = Radiosity(form_factors(scene, method="rays", rays=1024), scene.reflectance).solve(E)
    assert np.sqrt(((exact - by_rays) ** 2).mean()) < 0.004


def test_four_times_the_rays_halve_the_error_at_least():
    room = paper_room(patch_size_m=0.8)
    light = room.centres[:, 2]
    exact = form_factors(room).apply(light)
    errors = [np.sqrt(((sampled(room, rays).apply(light) - exact) ** 2).mean()) for rays in (64, 256, 1024)]
    assert errors[1] < errors[0] / 2
    assert errors[2] < errors[1] / 2


def test_the_halves_tell_the_error_within_a_factor_of_two():
    room = paper_room(patch_size_m=0.4)
    light = room.centres[:, 2]
    sample = RaySample(surface=room)
    sample.lengthen(128)
    halves = sample.halves(light)
    actual = np.sqrt(((halves.mean - form_factors(room).apply(light)) ** 2).mean())
    assert 0.7 < np.sqrt((halves.standard_error**2).mean()) / actual < 2


def test_a_longer_sample_goes_on_where_the_shorter_one_ended():
    surface = corner_with_ball(400)
    grown, at_once = RaySample(surface=surface), RaySample(surface=surface)
    grown.lengthen(32)
    grown.lengthen(np.where(np.arange(surface.n_patches) % 2, 128, 32))
    grown.lengthen(128)
    at_once.lengthen(128)
    assert (grown.exchange_areas().exchange_areas != at_once.exchange_areas().exchange_areas).nnz == 0


def test_exchange_areas_are_what_a_count_of_every_ray_says():
    surface = random_corner(1, 400)
    sample, n = RaySample(surface=surface), surface.n_patches
    rays = np.where(np.arange(n) % 3, 32, 128)
    sample.lengthen(rays)
    counts = np.zeros((n, n))
    few, many = hits(surface, 32), hits(surface, 128)
    for row in range(n):
        met = few[row] if rays[row] == 32 else many[row]
        np.add.at(counts[row], met[met >= 0], 1)
    density = rays / surface.areas
    both = density[:, None] + density
    expected = (counts + counts.T) / both
    found = sample.exchange_areas()
    K = found.exchange_areas.toarray()
    assert K == pytest.approx(expected, rel=1e-12, abs=0)
    assert (K == K.T).all()
    assert found.row_sums == pytest.approx(counts.sum(axis=1) / rays, rel=1e-12)
    assert found.by_others * K.sum(axis=1) == pytest.approx((expected * density / both).sum(axis=1), rel=1e-12)


def test_a_patch_that_meets_nobody_has_an_empty_row():
    sample = RaySample(surface=mesh_of([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]))
    sample.lengthen(32)
    found = sample.exchange_areas()
    assert found.exchange_areas.nnz == 0
    assert found.row_sums == found.by_others == 0


def test_threads_and_instruction_sets_change_no_bit(restored):
    surface = corner_with_ball(500)
    set_threads(1)
    expected = hits(surface)
    for instructions in _kernel.instruction_sets():
        _kernel.set_instruction_set(instructions)
        for threads in (1, 2):
            set_threads(threads)
            assert (hits(surface) == expected).all()


@pytest.mark.parametrize("rays", [1, 7, 8, 24, 65, 300])
def test_any_number_of_rays_has_the_same_bits_on_every_instruction_set(rays, restored):
    surface, values = random_corner(1, 300), np.random.default_rng(0).uniform(size=300 * 4)
    tree, rows = _kernel.RayTree(np.ascontiguousarray(surface.vertices)), np.arange(surface.n_patches)
    found = []
    for instructions in _kernel.instruction_sets():
        _kernel.set_instruction_set(instructions)
        met, means = hits(surface, rays), np.empty((surface.n_patches, 3))
        tree.moments(rows, 0, 0, met=met, values=values[: surface.n_patches], means=means)
        found.append((met, means))
    for met, means in found:
        assert (met == found[0][0]).all()
        assert means.tobytes() == found[0][1].tobytes()


def test_rays_leave_by_the_cosine_and_evenly():
    # Under half a dome, a floor sees as much of each part as it has of the projected disc.
    floor = mesh_of([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[-1, -1, 1], [-1, 1, 1], [1, 1, 1], [1, -1, 1]])
    share = (hits(floor, 1 << 14) == 1)[0].mean()
    # Squares of side a at a distance of a / 2: Howell, C-11.
    assert share == pytest.approx(0.415253, abs=5e-4)


def test_a_round_sends_no_more_rays_than_its_goal_asks_for():
    random = np.random.default_rng(0)
    rays = 2 ** random.integers(4, 8, size=500)
    squared = random.uniform(size=500) ** 6
    for share in (0.9, 0.5, 0.2):
        wanted = _wanted(rays, squared, share * squared.sum(), 1 << 20)
        left = squared * (wanted / rays) ** -GAIN
        assert left.sum() <= share * squared.sum()
        # Less for any row that has got more, and the goal is missed by about as much as that row counts.
        more = wanted > rays
        assert (left.sum() + (left * (2**GAIN - 1))[more]).max() > share * squared.sum()


def test_another_seed_sends_other_rays():
    surface = corner_with_ball(400)
    assert (hits(surface, seed=1) != hits(surface, seed=2)).mean() > 0.3


def test_what_is_met_from_behind_takes_the_light_away():
    floor = grid_of_quad([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], 2, 2)
    lid_facing_up = grid_of_quad([[-9, -9, 0.1], [9, -9, 0.1], [9, 9, 0.1], [-9, 9, 0.1]], 1, 1)
    surface = Mesh(name="lid", vertices=np.concatenate([floor, lid_facing_up]), reflectance=np.full(5, 0.5))
    sample = RaySample(surface=surface)
    sample.lengthen(64)
    assert sample.met_behind[:4] == pytest.approx(1.0, abs=0.05)
    assert sampled_form_factors(sample).row_sums[:4] == pytest.approx(0.0)


def test_a_sheet_with_two_lit_sides_does_not_shade_itself():
    sheet = np.array([[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], dtype=float)
    roof = np.array([[0, 0, 2], [0, 1, 2], [1, 1, 2], [1, 0, 2]], dtype=float)
    floor = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    surface = Mesh(name="sheet", vertices=np.stack([sheet, sheet[::-1], roof, floor]), reflectance=np.full(4, 0.5))
    F = form_factors(surface, method="rays", rays=1 << 12).matrix
    assert F[0, 2] == pytest.approx(0.199825, abs=2e-3)
    assert F[1, 3] == pytest.approx(0.199825, abs=2e-3)
    assert F[2, 3] == F[0, 1] == 0


def test_rays_are_sent_until_the_light_is_as_exact_as_wanted():
    surface = corner_with_ball(500)
    E = surface.reflectance
    truth = sampled_light(surface, E, surface.reflectance, error=1e-3, seed=9).B
    for error in (0.02, 0.006):
        found = sampled_light(surface, E, surface.reflectance, error=error)
        actual = np.sqrt((surface.areas * (found.B - truth) ** 2).sum() / surface.areas.sum())
        assert error / 10 < actual < error
        assert found.error <= error


def spot(surface):
    """Emission that falls off about one patch: light that is far from even."""
    size_m = np.ptp(surface.vertices.reshape(-1, 3), axis=0).max()
    squared_m2 = ((surface.centres - surface.centres[surface.n_patches // 3]) ** 2).sum(axis=1)
    return surface.reflectance * np.exp(-squared_m2 / (0.02 * size_m**2))


SPOTTED = [corner_with_ball(600), random_corner(1, 800), room_with_box(), paper_room()]


@pytest.mark.parametrize("surface", SPOTTED, ids=["ball", "random", "box", "paper"])
def test_the_mean_of_own_rays_and_reciprocal_factors_is_better_than_either_and_tells_its_error(surface):
    E, rho = spot(surface), surface.reflectance
    weights = surface.areas * rho**2
    many = RaySample(surface=surface, seed=99)
    many.lengthen(4096)
    own, reciprocal, both, told = [], [], [], []
    for seed in range(4):
        sample = RaySample(surface=surface, seed=seed)
        sample.lengthen(64)
        factors = sampled_form_factors(sample)
        B = Radiosity(factors, rho).solve(E)
        truth, found = many.halves(B).mean, received(sample, factors, B, weights)
        for errors, H in (
            (own, sample.halves(B).mean),
            (reciprocal, factors.apply(B)),
            (both, found.H),
        ):
            errors.append(weights @ (H - truth) ** 2)
        told.append(weights @ found.variance)
    assert np.mean(both) < 0.9 * np.mean(own)
    assert np.mean(both) < np.mean(reciprocal)
    assert 0.9 < np.sqrt(np.mean(told) / np.mean(both)) < 1.5


def test_a_reciprocal_that_is_much_noisier_than_own_rays_hardly_counts():
    surface = corner_with_ball(600)
    E, rho = spot(surface), surface.reflectance
    sample = RaySample(surface=surface)
    sample.lengthen(64)
    factors = sampled_form_factors(sample)
    # Every entry off by nine tenths of itself: their sums hardly tell.
    K = factors.exchange_areas.copy()
    K.data *= 1 + 0.9 * np.random.default_rng(0).choice([-1.0, 1.0], K.nnz)
    weights = surface.areas * rho**2
    B = Radiosity(factors, rho).solve(E)
    good, spoilt = (received(sample, f, B, weights) for f in (factors, replace(factors, exchange_areas=K)))
    assert spoilt.share < good.share
    assert weights @ good.variance < weights @ spoilt.variance <= weights @ spoilt.own_variance


def test_the_estimate_of_light_by_rays_is_honest_over_scenes_lights_and_seeds():
    shares = []
    for surface in (corner_with_ball(600), random_corner(5, 800), room_with_box()):
        for E in (surface.reflectance, spot(surface)):
            truth = sampled_light(surface, E, surface.reflectance, error=5e-4, seed=9).B
            for seed in range(3):
                found = sampled_light(surface, E, surface.reflectance, error=0.008, seed=seed)
                squared = (surface.areas * (found.B - truth) ** 2).sum() / surface.areas.sum()
                shares.append(np.sqrt(squared) / found.error)
    assert max(shares) < 1.15
    assert 0.6 < np.mean(shares) < 1


def test_a_room_that_traps_its_light_keeps_it_however_few_rays():
    room = room_with_box()
    truth = sampled_light(room, room.reflectance, room.reflectance, error=1e-3, seed=9).B
    sample = RaySample(surface=room)
    sample.lengthen(32)
    B = Radiosity(sampled_form_factors(sample), room.reflectance).solve(room.reflectance)
    assert room.areas @ B == pytest.approx(room.areas @ truth, rel=2e-3)


def test_moments_are_of_the_places_where_rays_begin():
    # Over a floor that alone is lit, from above: half of the light lies on the lit side.
    lid = np.array([[0, 0, 0.1], [0, 1, 0.1], [1, 1, 0.1], [1, 0, 0.1]], dtype=float)
    halves = grid_of_quad([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], 2, 1)
    surface = Mesh(name="lid", vertices=np.concatenate([lid[None], halves]), reflectance=np.full(3, 0.5))
    sample = RaySample(surface=surface)
    sample.lengthen(1024)
    lit = np.array([0.0, 1.0, 0.0])
    towards = surface.centres[1] - surface.centres[2]
    moment = sample.moment_halves(lit).mean[0]
    assert moment @ towards > 0.5 * 0.25 * 0.45 * np.linalg.norm(towards)
    assert abs(moment[2]) < 1e-6


def test_rows_that_matter_little_get_few_rays():
    surface = corner_with_ball(500)
    black = np.where(np.arange(surface.n_patches) < 100, 0.0, 0.7)
    found = sampled_light(surface, np.ones(surface.n_patches), black, error=0.005)
    assert found.sample.rays[:100].mean() < found.sample.rays[100:].mean() / 2


@pytest.mark.parametrize("rays", [0, 8, 100, 1 << 21])
def test_odd_numbers_of_rays_are_refused(rays):
    with pytest.raises(SimulationError, match="power of 2"):
        RaySample(surface=paper_room()).lengthen(rays)


def test_rays_with_another_visibility_are_refused():
    with pytest.raises(SimulationError, match="finds shadows itself"):
        form_factors(paper_room(), method="rays", visibility="exact")


def test_a_sample_without_rays_has_no_factors():
    with pytest.raises(SimulationError, match="without rays"):
        sampled_form_factors(RaySample(surface=paper_room()))


INTERRUPTED = """
import signal, sys, threading, time
import subprocess
import sys

import numpy as np
from sim import _kernel, form_factors
from sim.scenes.cluttered import corner_with_ball
from sim.form_factors.sampled import RaySample

scene = corner_with_ball(2144)
work = {"exact": lambda: form_factors(scene), "rays": lambda: RaySample(surface=scene).lengthen(1 << 18)}[sys.argv[1]]
sent = []
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs begin with it ignored
def send():
    sent.append(time.monotonic())
    signal.raise_signal(signal.SIGINT)
threading.Timer(1.0, send).start()
try:
    work()
except KeyboardInterrupt:
    print(time.monotonic() - sent[0])
"""


@pytest.mark.parametrize("work", ["exact", "rays"])
def test_ctrl_c_ends_long_work_of_the_kernel(work):
    # Exact shadows of this scene take minutes. What a loop's iteration takes on a busy machine is not the point here.
    run = subprocess.run(
        [sys.executable, "-c", INTERRUPTED, work], capture_output=True, text=True, timeout=60, check=False
    )
    assert run.returncode == 0, run.stderr
    assert float(run.stdout) < 20
