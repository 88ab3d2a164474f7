"""Patches for rays: when more of them are too many."""

import pytest

from sim.errors import SimulationError
from sim.planning.sampled.patches import check_course

GOAL = 0.04


def test_light_that_jumps_within_all_patches_is_refused_before_it_takes_hours_with_a_tolerance_that_does_not():
    # Five times the patches halve the error, hardly: 0.04 would take some 700,000.
    with pytest.raises(SimulationError, match=r"2,500 still 28 %.*about 691,000.*try a tolerance of 46 %"):
        check_course((500, 0.5), (2500, 0.285), GOAL)


@pytest.mark.parametrize("now", [(2500, 0.039), (1500, 0.4), (2500, 0.1)], ids=["reached", "just begun", "soon there"])
def test_patches_that_get_there_go_on(now):
    check_course((500, 0.5), now, GOAL)
