"""Patches for rays: when more of them are too many."""

import numpy as np
import pytest

from sim.errors import SimulationError
from sim.form_factors.sampled import FIRST_RAYS, RaySample
from sim.geometry.adaptive_patches import coarsest_patches
from sim.light.lighting import make_test_lighting
from sim.light.sampled_light import lengthened
from sim.planning.plan import plan
from sim.planning.sampled.patches import check_course
from sim.planning.simulation import Model, simulate
from sim.scenes.catalogue import SURFACES
from sim.scenes.cluttered import corner_with_ball
from sim.scenes.gridded import paper_room

GOAL = 0.04


def test_light_that_jumps_within_all_patches_is_refused_before_it_takes_hours_with_a_tolerance_that_does_not():
    # Five times the patches halve the error, hardly: 0.04 would take some 700,000.
    with pytest.raises(SimulationError, match=r"2,500 still 28 %.*about 691,000.*try a tolerance of 46 %"):
        check_course((500, 0.5), (2500, 0.285), GOAL)


@pytest.mark.parametrize("now", [(2500, 0.039), (1500, 0.4), (2500, 0.1)], ids=["reached", "just begun", "soon there"])
def test_patches_that_get_there_go_on(now):
    check_course((500, 0.5), now, GOAL)


@pytest.mark.slow
def test_where_what_patches_send_is_cut_first_the_error_of_what_they_receive_may_wait():
    """Light sent unevenly fell from look to look, what was received was not cut yet, and a plain room was refused."""
    room = SURFACES["room-with-box"]
    made = plan(room.build(), 0.15, room.light)
    assert made.model.method == "rays"
    assert made.error_percent <= 0.15


def test_slopes_of_light_that_is_the_same_everywhere_take_no_more_rays_than_its_means():
    """Large walls between small facets: their slopes' noise was met by a hundred times the rays, and did not fall."""
    cells = coarsest_patches(corner_with_ball(200))
    box = coarsest_patches(paper_room(patch_size_m=4.8))
    light = make_test_lighting("uniform", box)
    model = Model(method="rays", visibility="rays", residual=1e-6, sampling=2e-3, linear=True)
    even = simulate(box, light, model)
    assert even.sampling_error <= 2e-3
    assert even.factors.rays.max() <= 32
    uneven = simulate(cells, make_test_lighting("uniform", cells), model)
    assert uneven.sampling_error <= 2e-3


def test_more_rays_go_where_errors_are_large():
    surface = corner_with_ball(500)
    sample = RaySample.first(surface)
    squared = np.where(surface.centres[:, 2] > np.median(surface.centres[:, 2]), 4e-4, 1e-6)
    before = float(np.sqrt(surface.areas @ squared / surface.areas.sum()))
    lengthened(sample, squared, goal=0.5 * before)
    high, low = (sample.rays[squared == value].mean() for value in (4e-4, 1e-6))
    assert high > 1.5 * low
    # An error that falls with rays^0.7 is halved by 2.7 times as many.
    assert 2 * FIRST_RAYS < high < 8 * FIRST_RAYS
