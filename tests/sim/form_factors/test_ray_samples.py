"""Rays of patches: how many there are, and what their moments tell."""

import numpy as np
import pytest

from sim.form_factors.sampled import RaySample
from sim.scenes.cluttered import corner_with_ball
from sim.scenes.gridded import paper_room


def test_light_that_is_the_same_everywhere_has_no_moments_by_few_rays_as_well():
    room = paper_room()
    sample = RaySample(surface=room)
    sample.lengthen(16)
    sizes = np.sqrt(room.areas)[:, None]
    assert np.abs(sample.moment_halves(np.ones(room.n_patches)).mean / sizes).max() < 1e-9
    # Uneven light has some.
    uneven = np.arange(room.n_patches) % 2.0
    assert np.abs(sample.moment_halves(uneven).mean / sizes).max() > 1e-4


def test_every_row_gets_the_rays_that_are_wanted_of_it_and_no_more():
    surface = corner_with_ball(500)
    random = np.random.default_rng(5)
    sample = RaySample(surface=surface)
    sample.lengthen(2 ** random.integers(5, 9, surface.n_patches))
    wanted = np.maximum(sample.rays, 2 ** random.integers(5, 12, surface.n_patches))
    sample.lengthen(wanted)
    assert np.array_equal(sample.rays, wanted)
    # They are the ones that it would have had at once.
    other = RaySample(surface=surface)
    other.lengthen(wanted)
    light = random.random(surface.n_patches)
    assert sample.halves(light).mean == pytest.approx(other.halves(light).mean, rel=1e-12)
