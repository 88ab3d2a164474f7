"""``rig simulate``: what it says before and after."""

import json

import pytest

from rig.errors import UsageError
from rig.workflows.simulate import run_simulate


@pytest.mark.parametrize("scene", ["paper-room", "corner", "furnace", "room-with-box"])
def test_every_scene_is_planned_simulated_and_measured(scene):
    steps = []
    result = run_simulate(scene, 3.0, lambda label, done, total: steps.append((label, done, total)))
    json.dumps(result)
    assert set(result["plan"]) >= {
        "patches",
        "method",
        "visibility",
        "solver",
        "channels",
        "bounces",
        "reasons",
    }
    assert result["estimated"]["error"] <= 3.0
    assert result["actual"]["residual"] < 1e-10
    assert result["actual"]["energy_balance"] < 1e-9
    assert result["actual"]["closure_max"] < (0.02 if scene == "room-with-box" else 1e-10)
    assert steps[0][1] == 0
    assert steps[-1][1] == steps[-1][2]


def test_the_memory_estimate_is_of_the_right_size():
    result = run_simulate("paper-room", 0.6, lambda *step: None)
    assert 0.5 < result["actual"]["peak_mb"] / result["estimated"]["peak_mb"] < 1.5


def test_an_unknown_scene_names_those_there_are():
    with pytest.raises(UsageError, match="paper-room, corner, furnace, room-with-box"):
        run_simulate("cathedral", 1.0, lambda *step: None)


def test_an_impossible_tolerance_is_refused_with_advice():
    with pytest.raises(UsageError, match="try a tolerance of"):
        run_simulate("paper-room", 1e-4, lambda *step: None)
    with pytest.raises(UsageError, match="above 0"):
        run_simulate("paper-room", -1.0, lambda *step: None)
