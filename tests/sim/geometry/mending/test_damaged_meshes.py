"""Damaged meshes get an answer that says what was wrong, and none grows light; all hundred: benchmarks/."""

import pytest

from tests.sim.geometry.mending.answers import answer_to
from tests.sim.geometry.mending.damaged_meshes import damaged

SOLVED = (1, 3, 13, 18, 19, 27, 30, 34, 36, 40, 76, 79, 97, 100, 7086)
REFUSED = (0, 4, 5, 6, 9, 16, 24, 60, 70, 74, 94)


@pytest.mark.parametrize("seed", SOLVED)
def test_a_damaged_mesh_is_mended_says_so_and_creates_no_light(seed):
    answer = answer_to(damaged(seed), tolerance_percent=5.0)
    assert answer.faults == ()
    assert answer.outcome == "solved"
    assert 0 < answer.light_share <= 1.001


@pytest.mark.parametrize("seed", REFUSED)
def test_what_cannot_be_mended_is_refused_with_its_cause(seed):
    answer = answer_to(damaged(seed), tolerance_percent=5.0)
    assert answer.faults == ()


def test_the_same_seed_is_the_same_mesh():
    assert (damaged(3).points == damaged(3).points).all()
