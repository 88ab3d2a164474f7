"""``rig simulate``: what it says before and after."""

import json

import numpy as np
import pytest

from rig.cli.app import run_command
from rig.errors import UsageError
from rig.offline.mesh_file import MeshOptions
from rig.offline.simulate import SimulationRequest, reflectances_of, run_simulate, tolerance_of
from rig.terminal import silent
from sim.scenes.catalogue import SURFACES

SQUARE_ROOM = """
v 0 0 0
v 2000 0 0
v 2000 2000 0
v 0 2000 0
v 0 0 2000
v 2000 0 2000
v 2000 2000 2000
v 0 2000 2000
f 1 2 3 4
f 5 8 7 6
f 1 5 6 2
f 2 6 7 3
f 3 7 8 4
f 4 8 5 1
"""


@pytest.mark.parametrize("scene", SURFACES)
def test_every_scene_is_planned_simulated_and_measured(scene):
    steps = []
    result = run_simulate(
        SimulationRequest(scene=scene, tolerance=4.0), lambda label, done, total: steps.append((label, done, total))
    ).as_json()
    json.dumps(result, allow_nan=False)
    assert set(result["plan"]) >= {"patches", "method", "visibility", "solver", "channels", "bounces", "reasons"}
    assert set(result["estimated"]) == {"error", "seconds", "peak_mb"}
    assert result["estimated"]["error"] <= 4.0
    assert result["actual"]["residual"] < 1e-5
    assert result["actual"]["energy_balance"] < 1e-4
    assert result["actual"]["closure_max"] < (0.05 if result["plan"]["visibility"] in ("fair", "rays") else 1e-6)
    assert steps[0] == ("plan", 0, 1)
    assert steps[-1] == ("simulate", 1, 1)


def test_the_check_says_what_the_error_was():
    actual = run_simulate(SimulationRequest(scene="corner", tolerance=2.0), silent, check=True).actual
    assert 0.2 <= actual.error <= 2.0 < actual.error_max
    assert actual.refined_patches > 4


def test_the_memory_estimate_is_of_the_right_size():
    result = run_simulate(SimulationRequest(scene="paper-room", tolerance=1.0), silent)
    assert 0.7 < result.actual.peak_mb / result.estimated.peak_mb < 1.4


def test_a_mesh_file_is_planned_like_a_library_scene(tmp_path):
    # The faces are seen from inside: corners run clockwise seen from outside.
    (tmp_path / "room.obj").write_text(SQUARE_ROOM, encoding="utf-8")
    request = SimulationRequest(
        scene=str(tmp_path / "room.obj"), tolerance=3.0, reflectance=(0.6,), mesh=MeshOptions(unit="mm")
    )
    result = run_simulate(request, silent, check=True)
    assert result.plan.method == "closed_form"
    assert result.plan.light == "floor"
    assert 0.3 <= result.actual.error <= 3.0


def test_a_limit_of_time_takes_the_smallest_tolerance_that_fits():
    coarse = run_simulate(SimulationRequest(scene="corner", tolerance=1.0, seconds=0.5), silent)
    fine = run_simulate(SimulationRequest(scene="corner", tolerance=1.0, seconds=8.0), silent)
    assert fine.tolerance < coarse.tolerance
    assert fine.estimated.error < coarse.estimated.error


@pytest.mark.parametrize(("seconds", "what"), [(0.0, "must be above 0"), (1e-9, "the limit is 1e-09 s")])
def test_a_time_in_which_nothing_can_be_done_is_refused(seconds, what):
    with pytest.raises(UsageError, match=what):
        run_simulate(SimulationRequest(scene="corner", tolerance=1.0, seconds=seconds), silent)


def test_a_limit_of_time_and_a_tolerance_exclude_each_other():
    with pytest.raises(UsageError, match="leave --tolerance"):
        tolerance_of(1.0, None, 2.0)


def test_grey_levels_are_of_255():
    assert tolerance_of(None, 2.55) == pytest.approx(1.0)
    assert tolerance_of(0.5, None) == 0.5
    assert tolerance_of(None, None) == 1.0
    with pytest.raises(UsageError, match="give one"):
        tolerance_of(1.0, 1.0)


def test_the_command_line_prints_the_plan_before_and_the_figures_after(capsys):
    assert run_command(["simulate", "corner", "--grey-levels", "8", "--reflectance", "0.5,0.5,0.4", "--check"]) == 0
    printed = capsys.readouterr().out
    assert printed.index("2 different colours") < printed.index("expected: ") < printed.index("actual")
    assert "error" in printed.split("actual")[1]


def test_lights_differ():
    lit = [
        run_simulate(SimulationRequest(scene="paper-room", tolerance=3.0, light=light), silent).plan
        for light in ("floor", "uniform")
    ]
    assert lit[0].patches > lit[1].patches == 6


@pytest.mark.parametrize("text", ["0.7,abc", "1.2", "-0.1"])
def test_reflectances_that_are_none_are_refused(text):
    with pytest.raises(UsageError, match="--reflectance"):
        reflectances_of(text)


def test_an_unknown_scene_names_those_there_are():
    with pytest.raises(UsageError, match="paper-room, corner, furnace, room-with-box"):
        run_simulate(SimulationRequest(scene="cathedral", tolerance=1.0), silent)


def test_an_impossible_tolerance_is_refused_with_advice():
    with pytest.raises(UsageError, match="try a tolerance of"):
        run_simulate(SimulationRequest(scene="paper-room", tolerance=1e-4), silent)
    with pytest.raises(UsageError, match="above 0"):
        run_simulate(SimulationRequest(scene="paper-room", tolerance=-1.0), silent)
    with pytest.raises(UsageError, match="finite number"):
        run_simulate(SimulationRequest(scene="paper-room", tolerance=np.nan), silent)
