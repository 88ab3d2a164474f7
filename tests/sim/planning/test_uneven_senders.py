"""What senders of one number change, from rays, against solutions whose senders are sixteenths."""

from dataclasses import replace

import numpy as np
import pytest

from sim.geometry.adaptive_patches import coarsest_patches
from sim.geometry.mesh import Mesh
from sim.light.lighting import Emission, Lighting, emission, make_test_lighting
from sim.planning.linear_light import Senders, variation_within
from sim.planning.sampled.uneven_senders import UnevenSenders
from sim.planning.simulation import Model, simulate
from sim.scenes.cluttered import random_corner

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
