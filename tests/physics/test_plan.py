"""The planner: measured error law, cheapest model, refusals."""

import numpy as np
import pytest

from sim.errors import SimulationError
from sim.form_factors import form_factors
from sim.plan import bounces_needed, difference_rms, measured_law, plan, standard_light
from sim.radiosity import Radiosity
from sim.scenes import LIBRARY


def _solved(scene):
    return Radiosity(form_factors(scene), scene.reflectance).solve(standard_light(scene))


@pytest.mark.parametrize("name", ["paper-room", "corner", "furnace"])
def test_the_plan_meets_its_tolerance_against_a_much_finer_solution(name):
    planned = plan(name, 1.0)
    coarse, fine = LIBRARY[name](planned.patch_size_m), LIBRARY[name](planned.patch_size_m / 4)
    error = 100 * difference_rms(coarse, _solved(coarse), fine, _solved(fine))
    assert error < 1.2
    assert planned.error_percent <= 1.0


def test_a_tighter_tolerance_costs_more_patches_and_bounces():
    loose, tight = plan("paper-room", 1.5), plan("paper-room", 0.6)
    assert tight.patches > loose.patches
    assert tight.bounces > loose.bounces
    assert tight.peak_mb > loose.peak_mb


def test_rays_are_planned_only_where_something_stands_in_the_way():
    assert plan("paper-room", 2.0).visibility == "none"
    assert plan("room-with-box", 3.0).visibility == "rays"


def test_the_planned_bounces_carry_the_light_that_matters():
    scene = LIBRARY["paper-room"](0.8)
    G = 0.7 * form_factors(scene).matrix
    E = standard_light(scene)
    term, total = E, E.copy()
    for _ in range(bounces_needed(0.7, 1.0)):
        term = G @ term
        total += term
    assert np.abs(_solved(scene) - total).max() < 0.01 * E.max()


def test_the_error_law_falls_with_the_patch_size():
    law = measured_law(LIBRARY["paper-room"], 0.8)
    assert 0.5 < law.order < 1.5
    assert law.error_percent(0.4) < law.error_percent(0.8)
    assert law.patch_size_m(law.error_percent(0.3)) == pytest.approx(0.3)


def test_what_does_not_fit_is_refused_with_a_tolerance_that_does():
    with pytest.raises(SimulationError, match=r"the limit is 100 MB; try a tolerance of ([\d.]+) %") as refused:
        plan("paper-room", 0.1, memory_limit_mb=100.0)
    advised = float(str(refused.value).split("tolerance of ")[1].split(" ")[0])
    assert plan("paper-room", advised * 1.05, memory_limit_mb=100.0).peak_mb <= 100.0


def test_unknown_scenes_and_tolerances_are_refused():
    with pytest.raises(SimulationError, match="paper-room, corner, furnace, room-with-box"):
        plan("cathedral", 1.0)
    with pytest.raises(SimulationError, match="above 0"):
        plan("corner", 0.0)
