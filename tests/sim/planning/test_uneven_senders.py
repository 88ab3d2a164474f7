"""What senders of one number change, from rays, against solutions whose senders are sixteenths."""

from dataclasses import replace

import numpy as np
import pytest

from sim import _kernel
from sim.form_factors.sampled import tree_of
from sim.geometry.adaptive_patches import coarsest_patches
from sim.geometry.mesh import Mesh
from sim.light.lighting import Emission, Lighting, emission, make_test_lighting
from sim.planning.linear_light import Senders, variation_within
from sim.planning.sampled.pieces import cuts_of
from sim.planning.sampled.uneven_senders import UnevenSenders
from sim.planning.simulation import Model, simulate
from sim.scenes.cluttered import random_corner
from sim.threads import set_threads

RAYS = Model(method="rays", visibility="rays", residual=1e-6, sampling=1e-3)


def rms_of(cells, one, other):
    return float(np.sqrt(cells.areas @ (one * other) / cells.areas.sum()))


def true_shift(cells, light):
    """RMS of what light between sixteenths brings over that between patches, each of one number, free of noise."""
    fine = cells.quarters().quarters()
    share, change = fine.areas.reshape(16, -1) / cells.areas, []
    for seed in (1, 2):
        model = replace(RAYS, seed=seed)
        light_of_fine, light_of_cells = (simulate(one, light, model).irradiance[:, 0] for one in (fine, cells))
        change.append(cells.reflectance * ((share * light_of_fine.reshape(16, -1)).sum(axis=0) - light_of_cells))
    return rms_of(cells, *change)


@pytest.mark.parametrize("name", ["uniform", "projector"])
def test_shadows_and_the_lamps_edges_within_senders_change_receivers_by_what_sixteenths_say(name):
    cells = coarsest_patches(random_corner(0, 150))
    light = make_test_lighting(name, cells)
    lit, own = emission(cells, light), np.arange(cells.n_patches)
    B = simulate(cells, light, RAYS).B[:, 0]
    seen = variation_within(cells, own, Senders.even(cells, B), rays=32, stream=5)
    senders = UnevenSenders(cells=cells, light=light, lit=lit, pieces=seen.pieces)
    one, other = (cells.reflectance * shift for shift in senders.shifts(256, 3))
    # The truth has the bounces after it, too.
    assert 0.6 * true_shift(cells, light) < rms_of(cells, one, other) < 1.3 * true_shift(cells, light)


def landings(cells, stream=3, rays=64):
    """What rays of all patches meet, where, and what the nearest of 16 places there has: numbers of their own."""
    tree, rows = tree_of(cells), np.arange(cells.n_patches)
    places = np.ascontiguousarray(cells.sixteenths().centres.reshape(16, -1, 3).swapaxes(0, 1))
    values = np.arange(16.0 * cells.n_patches).reshape(-1, 16)
    met, sampled = (np.empty((cells.n_patches, rays), np.int32) for _ in range(2))
    landed_m, has = np.empty((*met.shape, 3)), np.empty(met.shape)
    tree.land(rows, stream, places, values, met=met, landed=landed_m, has=has)
    tree.sample(rows, stream, 0, sampled)
    return met, sampled, places, landed_m, has


def test_rays_land_on_what_they_meet_and_bring_what_the_nearest_place_there_has():
    cells = coarsest_patches(random_corner(2, 300))
    met, sampled, places, landed_m, has = landings(cells)
    assert (met == sampled).all()
    assert 0.2 < (met >= 0).mean() < 1
    assert (has[met < 0] == 0).all()
    assert (landed_m[met < 0] == 0).all()
    on, points_m = met[met >= 0], landed_m[met >= 0]
    off_plane_m = ((points_m - cells.centres[on]) * cells.normals[on]).sum(axis=1)
    assert np.abs(off_plane_m).max() < 1e-5 * np.ptp(cells.vertices)
    squared = ((places[on] - points_m[:, None]) ** 2).sum(axis=2)
    assert (has[met >= 0] == 16 * on + squared.argmin(axis=1)).all()


def test_rays_land_at_the_same_bits_on_any_number_of_threads_and_any_instructions(restored):
    cells = coarsest_patches(random_corner(2, 300))
    found = []
    for count, name in ((1, "baseline"), (2, _kernel.best_instruction_set())):
        set_threads(count)
        _kernel.set_instruction_set(name)
        found.append(landings(cells))
    assert all((one == other).all() for one, other in zip(*found, strict=True))


def test_senders_that_are_even_change_nothing():
    cells = coarsest_patches(random_corner(1, 150))
    light = make_test_lighting("uniform", cells)
    even = np.zeros((16, cells.n_patches))
    senders = UnevenSenders(cells=cells, light=light, lit=emission(cells, light), pieces=(even, even))
    assert all((shift == 0).all() for shift in senders.shifts(16, 0))


def test_a_lamp_that_lights_half_a_patch_shifts_what_stands_beside_that_half_by_its_exact_factor():
    # A wall beside a floor of 2 m, of which the half next to the wall is lit: the floor's mean is half of that.
    floor = [[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]]
    wall = [[0, 0, 0], [0, 2, 0], [0, 2, 0.5], [0, 0, 0.5]]
    vertices = np.array([floor, wall], dtype=float)
    cells = coarsest_patches(Mesh(name="two", vertices=vertices, reflectance=np.array([0.8, 0.5])))
    half = Lighting(
        name="half",
        description="half",
        irradiance=lambda points, _n, _r: (points[:, 0] < 1.0) * (np.abs(points[:, 2]) < 1e-6),
    )
    half_lit = Emission(np.array([0.5, 0.0]), np.array([0.25, 0.0]))
    even = np.zeros((16, 2))
    shifts = UnevenSenders(cells=cells, light=half, lit=half_lit, pieces=(even, even)).shifts(1 << 14, 1)
    halves = np.array(
        [[[0, 0, 0], [1, 0, 0], [1, 2, 0], [0, 2, 0]], [[1, 0, 0], [2, 0, 0], [2, 2, 0], [1, 2, 0]], wall]
    )
    exact = simulate(
        coarsest_patches(Mesh(name="three", vertices=halves.astype(float), reflectance=np.array([0.8, 0.8, 0.5]))),
        make_test_lighting("uniform", cells),
        Model(method="polygon", visibility="none", residual=1e-9),
    ).factors.matrix[2]
    expected = 0.8 * (0.5 * exact[0] - 0.5 * exact[1])
    assert [shift[1] for shift in shifts] == pytest.approx([expected] * 2, rel=0.03)


def test_even_light_is_cut_nowhere_and_uneven_light_where_a_cut_takes_most_away() -> None:
    """A patch with a hundred times the squared variation of the others is cut twice before these are cut once."""
    varies = np.array([100.0, 1.0, 1.0, 0.0, -1.0])
    assert cuts_of(varies, 0.3).tolist() == [1, 0, 0, 0, 0], "a quarter of 100 is left, and 2 of the others"
    assert cuts_of(varies, 0.125).tolist() == [2, 0, 0, 0, 0]
    assert cuts_of(np.ones(8), 0.9).sum() == 2, "each takes 3/4 of an eighth away"


def test_one_look_cuts_no_finer_than_its_measurement_tells() -> None:
    """An eighth of the variation stays, however little may be left: what pieces of pieces have nobody has measured."""
    varies = np.random.default_rng(2).lognormal(0, 2, 500)
    assert (cuts_of(varies, 1e-6) == cuts_of(varies, 1 / 8)).all()
    levels = cuts_of(varies, 1 / 8)
    left = (varies * 0.25**levels).sum() / varies.sum()
    assert 0.1 < left <= 1 / 8
    assert varies[levels == 2].min() > 10 * varies[levels == 0].max(), "of four pieces each has a sixteenth"
