"""By how much matte patches would be wrong: nothing without gloss, the less the rougher, and as sampled."""

import numpy as np
import pytest

from sim.errors import SimulationError
from sim.geometry.adaptive_patches import coarsest_patches
from sim.light.gloss.lobe import frames_of, lobe
from sim.light.gloss.material import Gloss, matte_equivalent
from sim.light.lighting import make_test_lighting
from sim.planning.gloss import (
    FEWEST_RAYS,
    RAYS,
    bend_by_lobes,
    gloss_cost,
    gloss_of_cells,
    glossy_simulation,
    rays_each,
    refined_gloss_check,
)
from sim.planning.gloss_effect import gloss_effect
from sim.planning.plan import plan
from sim.planning.simulation import Model, simulate
from sim.scenes.catalogue import SURFACES
from sim.scenes.cluttered import random_corner
from sim.scenes.gridded import furnace, paper_room, room

ROOM = room((3.0, 3.0, 2.0), 0.5, 0.5)


def glossy(scene, gloss, light="projector", tolerance=8.0, **more):
    made = plan(scene.with_reflectance(matte_equivalent(scene, gloss)), tolerance, light)
    matte = simulate(made.cells, made.light, made.model)
    return glossy_simulation(matte, made.light, gloss_of_cells(made.cells, scene, gloss), **more), made


def effect(share, roughness, light="projector"):
    found, made = glossy(ROOM, Gloss.of(ROOM, share, roughness), light)
    return gloss_effect(found, made.light)


def test_nothing_is_wrong_without_gloss():
    found = effect(0.0, 0.3)
    assert found.area_share == 0
    assert found.largest == pytest.approx(0, abs=1e-9)


def test_less_gloss_is_wrong_by_less_in_proportion():
    much, little = effect(0.2, 0.3), effect(0.02, 0.3)
    for name in ("between", "seen", "highlight"):
        assert 5 < getattr(much, name) / getattr(little, name) < 25
    assert much.area_share == pytest.approx(1.0)


def test_rougher_gloss_is_nearer_to_matte():
    rows = [effect(0.2, roughness) for roughness in (0.1, 0.3, 0.9)]
    for name in ("seen", "highlight"):
        values = [getattr(row, name) for row in rows]
        assert values == sorted(values, reverse=True)


def test_even_light_from_everywhere_makes_no_highlights_worth_speaking_of():
    assert effect(0.2, 0.3, "uniform").highlight < 0.2 * effect(0.2, 0.3).highlight


def test_highlights_are_as_wrong_as_random_viewers_find():
    share, roughness = 0.3, 0.5
    found, made = glossy(ROOM, Gloss.of(ROOM, share, roughness))
    cells, light = made.cells, make_test_lighting("projector", coarsest_patches(ROOM))
    random, n = np.random.default_rng(0), 400_000
    patch = random.choice(cells.n_patches, n, p=cells.areas / cells.areas.sum())
    a, b, _, d = np.moveaxis(cells.vertices[patch], 1, 0)
    s, t = random.uniform(size=(2, n, 1))
    points = a + s * (b - a) + t * (d - a)
    H = light.irradiance(points, cells.normals[patch], cells.region[patch])
    r, turn = np.sqrt(random.uniform(size=n)), random.uniform(0, 2 * np.pi, n)
    viewers = np.stack([r * np.cos(turn), r * np.sin(turn), np.sqrt(1 - r**2)], axis=1)
    to_lamp = light.source_m - points
    to_lamp /= np.linalg.norm(to_lamp, axis=1, keepdims=True)
    coming = np.einsum("nij,nj->ni", frames_of(cells.normals[patch]), to_lamp)
    seen = np.pi * share * lobe(coming, viewers, np.full(n, roughness)) * H
    wrong = seen - Gloss.of(ROOM, share, roughness).mean_albedo[0] * H
    expected = np.sqrt(np.mean(wrong**2))
    assert gloss_effect(found, made.light).highlight == pytest.approx(expected, rel=0.04)


def test_in_even_light_a_narrow_lobe_is_as_good_as_matte_patches():
    # A furnace lit alike everywhere: mirrors and matte patches send back the same even light.
    scene = furnace(reflectance=0.3)
    found, made = glossy(scene, Gloss.of(scene, 0.4, 0.001), "uniform")
    assert found.irradiance.mean() == pytest.approx(found.matte.irradiance.mean(), rel=3e-3)
    assert np.allclose(found.irradiance, found.matte.irradiance, rtol=0.01)
    wrong = gloss_effect(found, made.light)
    assert wrong.between < 0.01 * found.irradiance.mean()
    assert wrong.seen < 0.02 * found.irradiance.mean()


def test_other_rays_on_finer_cells_agree_within_the_plans_tolerance():
    found, made = glossy(ROOM, Gloss.of(ROOM, 0.3, 0.3), tolerance=3.0)
    check = refined_gloss_check(found, made.light, made.model, 4 * made.patches)
    assert check.patches == 4 * made.patches
    assert 0.001 < check.rms < 0.03


def test_sixteenths_show_what_quarters_hide_where_they_fit():
    found, made = glossy(ROOM, Gloss.of(ROOM, 0.3, 0.3), tolerance=8.0)
    quarters, sixteenths = (
        refined_gloss_check(found, made.light, made.model, times * made.patches) for times in (31, 32)
    )
    assert (quarters.patches, sixteenths.patches) == (4 * made.patches, 16 * made.patches)
    assert 1.05 < sixteenths.rms / quarters.rms < 1.3


def test_by_rays_quarters_whose_sixteenths_get_light_by_rays_find_what_sixteenths_do():
    # Things that pierce each other: light steps within patches, of which quarters alone show half.
    scene = random_corner(1, 300)
    cells = coarsest_patches(scene)
    light = make_test_lighting("uniform", cells)
    model = Model(method="rays", visibility="rays", residual=1e-5, sampling=0.01)
    found = glossy_simulation(simulate(cells, light, model), light, Gloss.of(cells, 0.1, 0.5))
    fitting, not_fitting = (
        refined_gloss_check(found, light, model, times * cells.n_patches, rays=32) for times in (16, 4)
    )
    assert (fitting.patches, not_fitting.patches) == (16 * cells.n_patches, 4 * cells.n_patches)
    assert 0.95 < not_fitting.rms / fitting.rms < 1.25


def test_cells_have_the_gloss_of_what_they_lie_on():
    on_floor = np.where(ROOM.region == 0, 0.2, 0.0)
    cells = plan(ROOM, 5.0).cells
    gloss = gloss_of_cells(cells, ROOM, Gloss.of(ROOM, on_floor, 0.3))
    assert np.array_equal(gloss.glossy, np.abs(cells.centres[:, 2]) < 1e-9)


def test_many_patches_share_their_rays_and_the_cost_grows_with_them():
    few, many = (Gloss(np.full(n, 0.1), np.full(n, 0.3)) for n in (100, 1_000_000))
    assert rays_each(few, RAYS) == RAYS
    assert rays_each(many, RAYS) == FEWEST_RAYS
    everywhere, placed = (make_test_lighting(name, coarsest_patches(ROOM)) for name in ("uniform", "projector"))
    assert gloss_cost(few, 256, everywhere).seconds < gloss_cost(many, 32, everywhere).seconds
    assert gloss_cost(few, 256, everywhere).peak_mb < gloss_cost(many, 32, everywhere).peak_mb
    assert gloss_cost(few, 256, everywhere).seconds < gloss_cost(few, 4096, everywhere).seconds
    assert gloss_cost(few, 256, everywhere).seconds < gloss_cost(few, 256, placed).seconds


def test_a_gloss_above_what_patches_reflect_in_all_is_refused():
    made = plan(ROOM.with_reflectance(0.1), 8.0)
    matte = simulate(made.cells, made.light, made.model)
    with pytest.raises(SimulationError, match="both must lie in 0"):
        glossy_simulation(matte, made.light, Gloss(np.full(made.patches, 0.5), np.full(made.patches, 0.1)))


def test_the_more_light_lobes_send_the_finer_are_their_patches():
    room = paper_room()
    bends = [
        bend_by_lobes(room.with_reflectance(0.9 - share), Gloss.of(room.with_reflectance(0.9 - share), share, 0.3))
        for share in (0.01, 0.1, 0.4, 0.8)
    ]
    assert bends[0] == pytest.approx(1.0, abs=1e-2)
    assert bends == sorted(bends)
    assert bends[-1] > 2
    black = room.with_reflectance(0.0)
    assert bend_by_lobes(black, Gloss.of(black, 0.0, 0.3)) == 1.0


def test_a_room_with_lobes_is_planned_for_light_of_one_number_a_patch():
    room = SURFACES["paper-room"].build()
    assert plan(room, 1.0).model.method == "rays"
    assert plan(room, 1.0, one_number=True).model.method == "closed_form"


def strong_gloss(**more):
    return glossy(paper_room().with_reflectance(0.3), Gloss.of(paper_room().with_reflectance(0.3), 0.5, 0.2), **more)


def test_two_halves_of_the_rays_tell_the_noise_that_other_rays_show():
    runs = [strong_gloss(seed=seed, rays=128)[0] for seed in range(8)]
    cells, rho = runs[0].matte.cells, runs[0].matte.reflectance[:, 0]
    variance = np.var([rho * run.irradiance[:, 0] for run in runs], axis=0, ddof=1)
    scatter = np.sqrt(cells.areas @ variance / cells.areas.sum())
    assert scatter > 0.01
    assert np.sqrt(np.mean([run.noise**2 for run in runs])) == pytest.approx(scatter, rel=0.2)


def test_where_less_noise_is_asked_for_there_are_as_many_rays_as_that_needs():
    few, wanted = strong_gloss(rays=64)[0], 0.008
    less = strong_gloss(rays=64, noise=wanted)[0]
    assert wanted < few.noise
    assert less.noise < wanted
    assert 2 * few.rays < less.rays < 16 * few.rays
    assert strong_gloss(rays=64, noise=2 * few.noise)[0].rays == few.rays


def test_where_the_most_rays_leave_more_noise_than_asked_for_the_result_says_so(monkeypatch):
    monkeypatch.setattr("sim.planning.gloss.MOST_PAIRS", 1 << 15)
    found, made = strong_gloss(noise=0.002)
    assert found.rays * made.patches <= 1 << 15
    assert found.noise > 0.002


def test_the_noise_of_a_checks_own_rays_is_not_taken_for_an_error():
    found, made = strong_gloss(rays=4096)
    few, many = (refined_gloss_check(found, made.light, made.model, 4 * made.patches, rays=rays) for rays in (64, 2048))
    assert few.noise > 0.02 > 4 * many.noise
    assert few.rms == pytest.approx(many.rms, rel=0.15)


def test_a_check_finds_the_noise_of_the_solution_itself():
    def squared_error(found, made):
        return refined_gloss_check(found, made.light, made.model, 4 * made.patches, rays=512).rms ** 2

    noisy = [strong_gloss(rays=64, seed=seed) for seed in range(6)]
    added = np.mean([squared_error(*one) for one in noisy]) - squared_error(*strong_gloss(rays=4096))
    # On quarters a check raises squares by 4/3, those of noise as well.
    noise = np.sqrt(np.mean([found.noise**2 for found, _ in noisy]))
    assert np.sqrt(3 / 4 * added) == pytest.approx(noise, rel=0.2)
