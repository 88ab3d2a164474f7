"""The planner: honest estimates, the cheapest model, refusals."""

import numpy as np
import pytest

from sim.errors import SimulationError
from sim.form_factors import form_factors
from sim.geometry.adaptive_patches import coarsest_patches
from sim.geometry.crossings import cut_where_crossed
from sim.light.lighting import make_test_lighting
from sim.planning.check import refined_check, squared_at_points
from sim.planning.methods import MOST_SHADOW_S, SHADOW_S, bounces_needed
from sim.planning.plan import plan
from sim.planning.simulation import Model, simulate
from sim.scenes.catalogue import SURFACES
from sim.scenes.cluttered import corner_with_ball, random_corner
from sim.scenes.gridded import corner, paper_room

HONEST = [
    ("paper-room", 3.0),
    ("paper-room", 1.2),
    ("corner", 3.0),
    ("corner", 0.5),
    ("room-with-box", 3.0),
    ("sloped-room", 2.0),
]


def planned(name, tolerance, **options):
    return plan(SURFACES[name].build(), tolerance, options.pop("light", SURFACES[name].light), **options)


def checked(made, most_patches=6000):
    simulation = simulate(made.cells, made.light, made.model)
    return 100 * refined_check(simulation, made.light, made.model, most_patches).rms


@pytest.mark.parametrize(("name", "tolerance"), HONEST)
def test_the_actual_error_lies_between_the_tolerance_and_a_tenth_of_it(name, tolerance):
    made = planned(name, tolerance)
    assert made.error_percent <= tolerance
    assert tolerance / 10 <= checked(made) <= tolerance


@pytest.mark.parametrize("light", ["floor", "projector"])
def test_the_plan_is_honest_in_either_light(light):
    assert 0.2 <= checked(planned("paper-room", 2.0, light=light)) <= 2.0


def test_a_furnace_needs_a_patch_a_face_whatever_the_tolerance():
    made = planned("furnace", 0.01)
    assert made.patches == 6
    simulation = simulate(made.cells, made.light, made.model)
    assert simulation.B == pytest.approx(1.0)


def test_the_refined_check_finds_the_known_error_of_constant_cells():
    # A black floor under a small lit ceiling gets what the closed form gives each cell: refining agrees.
    made = planned("corner", 2.0)
    simulation = simulate(made.cells, made.light, made.model)
    once = refined_check(simulation, made.light, made.model, 4 * made.patches)
    twice = refined_check(simulation, made.light, made.model, 16 * made.patches)
    assert twice.patches == 4 * once.patches
    assert once.rms == pytest.approx(twice.rms, rel=0.1)


def test_a_tighter_tolerance_costs_more_patches_and_bounces():
    loose, tight = planned("paper-room", 4.0), planned("paper-room", 1.5)
    assert tight.patches > 2 * loose.patches
    assert tight.bounces > loose.bounces
    assert tight.peak_mb > loose.peak_mb


def test_occlusion_is_planned_only_where_something_stands_in_the_way_and_as_well_as_needed(monkeypatch):
    monkeypatch.setattr("sim.planning.methods.RAY_S", 1.0)
    assert planned("paper-room", 3.0).model.visibility == "none"
    assert planned("room-with-box", 4.0).model.visibility == "fair"
    assert planned("room-with-box", 0.99, light="uniform").model.visibility == "exact"


def test_rays_are_planned_where_exact_shadows_take_longer_and_the_plan_stays_honest(monkeypatch):
    monkeypatch.setitem(SHADOW_S, "fair", 1e-5)
    monkeypatch.setitem(MOST_SHADOW_S, "fair", 1e-5)
    made = planned("room-with-box", 2.5)
    assert (made.model.method, made.model.visibility) == ("rays", "rays")
    assert any("rays each" in reason for reason in made.reasons)
    assert made.error_percent <= 2.5
    assert 0.25 <= checked(made, most_patches=1) <= 2.5


def test_a_mesh_of_many_facets_is_planned_on_its_own_facets():
    scene = corner_with_ball(600)
    made = plan(scene, 6.0, "uniform")
    assert made.patches == scene.n_patches
    assert made.model.method == "rays"
    assert 0.6 <= checked(made, most_patches=1) <= 6.0


def test_facets_that_others_pierce_are_cut_until_the_plan_is_honest():
    made = plan(random_corner(1, 300), 1.5, "uniform")
    assert made.patches > random_corner(1, 300).n_patches
    assert 0.15 <= checked(made, most_patches=1) <= 1.5


def test_things_that_pierce_each_other_are_cut_where_they_do_and_noise_cuts_nothing():
    scene = random_corner(1, 530)
    made = plan(scene, 1.0, "uniform")
    # Cut in quarters until their light was linear, and until noise was small, there were 58,847.
    assert made.patches < 3 * scene.n_patches
    check = refined_check(simulate(made.cells, made.light, made.model), made.light, made.model, 16 * made.patches)
    assert 0.1 < 100 * check.rms < 1.0


def test_where_sixteenths_do_not_fit_rays_tell_of_steps_within_quarters_what_they_would():
    made = plan(random_corner(1, 150), 4.0, "uniform")
    simulation = simulate(made.cells, made.light, made.model)
    by_points, on_sixteenths = (
        refined_check(simulation, made.light, made.model, most).rms for most in (0, 16 * made.patches)
    )
    assert 0.97 * on_sixteenths < by_points < 1.2 * on_sixteenths


def test_an_error_at_sixteenths_is_the_same_whatever_rays_tell_it():
    cells, _ = cut_where_crossed(coarsest_patches(random_corner(6, 300)))
    light = make_test_lighting("uniform", cells)
    model = Model(method="rays", visibility="rays", residual=1e-6, sampling=1e-3, linear=True)
    coarse, finer = (simulate(each, light, model) for each in (cells, cells.quarters()))
    ours = coarse.irradiance_at(finer.cells.quarters().quarters())
    means = finer.irradiance, finer.irradiance
    squared = [squared_at_points((finer, finer), means, ours, sampling=0.0, seed=10 * k)[0] for k in range(5)]
    # By the first sixteen rays a sixteenth they differ by 11 %, and at a fifth of this error by half.
    assert np.std(squared) < 0.04 * np.mean(squared)


def test_light_that_changes_within_facets_gets_slopes_before_facets_are_cut():
    loose, tight = (plan(corner_with_ball(600), tolerance, "uniform") for tolerance in (6.0, 1.0))
    assert (loose.model.linear, tight.model.linear) == (False, True)
    assert tight.patches < 1.2 * loose.patches
    assert checked(tight, most_patches=1) <= 1.0


def test_the_closed_form_is_planned_for_rectangles_and_polygons_for_the_rest():
    assert planned("paper-room", 5.0).model.method == "closed_form"
    assert planned("sloped-room", 5.0).model.method == "polygon"


def test_rays_are_planned_in_a_room_where_planning_by_exact_factors_takes_longer_and_keep_their_tolerance():
    made = planned("paper-room", 1.0)
    assert made.model.method == "rays"
    assert 0.1 <= checked(made) <= 1.0


def test_rays_that_do_not_fit_in_memory_are_not_planned():
    assert planned("paper-room", 1.2).model.method == "rays"
    assert planned("paper-room", 1.2, memory_limit_mb=2.0).model.method == "closed_form"


def test_rays_at_a_tight_tolerance_are_planned_in_the_memory_that_they_take():
    # Exact factors need some 3,300 patches of the room for this, 90 MB; by rays light is linear within 1,700.
    made = planned("paper-room", 0.3, memory_limit_mb=500.0)
    assert made.model.method == "rays"
    assert made.peak_mb < 150


def test_a_first_solution_is_made_where_it_is_cheap_beside_rays_and_tells_that_few_patches_will_do():
    # Light in a sphere is nearly even: its 320 facets do for what takes rooms some 30,000 patches.
    made = planned("sphere", 0.1)
    assert (made.model.method, made.patches) == ("polygon", 320)
    assert checked(made) <= 0.1


def test_many_patches_with_occluders_are_compressed_and_the_plan_stays_honest(monkeypatch):
    monkeypatch.setattr("sim.planning.methods.RAY_S", 1.0)
    monkeypatch.setattr("sim.planning.cost.FEWEST_COMPRESSED", 150)
    monkeypatch.setattr("sim.planning.cost.COMPRESSED_PATCH_S", 1e-9)
    made = planned("room-with-box", 2.0)
    assert made.model.compression == pytest.approx(0.01)
    assert any("compressed" in reason for reason in made.reasons)
    assert any("rays where a pair is partly hidden" in reason for reason in made.reasons)
    assert 0.2 <= checked(made) <= 2.0


def test_a_convex_scene_is_compressed_only_where_its_matrix_does_not_fit():
    roomy, tight = (planned("paper-room", 1.2, memory_limit_mb=limit) for limit in (4096, 2.0))
    assert roomy.model.compression is None
    assert tight.model.compression is not None
    assert checked(tight) <= 1.2


def test_equal_reflectances_share_a_solve_and_the_brightest_sets_the_patches():
    grey = plan(paper_room(), 3.0, reflectances=(0.7, 0.7, 0.7))
    coloured = plan(paper_room(), 3.0, reflectances=(0.2, 0.7, 0.5))
    assert grey.channels == 1
    assert coloured.channels == 3
    assert coloured.patches == grey.patches
    B = simulate(coloured.cells, coloured.light, coloured.model).B
    assert B.shape == (coloured.patches, 3)
    assert (B[:, 0] >= B[:, 1]).all()
    assert (B[:, 1] >= B[:, 2]).all()


def test_a_black_room_needs_no_bounce():
    made = plan(paper_room(reflectance=0.0), 1.0, "floor")
    assert made.bounces == 0
    assert made.patches == 6


def test_the_planned_bounces_carry_the_light_that_matters():
    scene = paper_room(patch_size_m=0.8)
    factors = form_factors(scene)
    E = (scene.region == 0) * 0.7
    term, total = E, E.copy()
    for _ in range(bounces_needed(0.7, 1.0)):
        term = 0.7 * factors.apply(term)
        total += term
    exact = np.linalg.solve(np.eye(scene.n_patches) - 0.7 * factors.matrix, E)
    assert 1e-5 < np.abs(exact - total).max() < 0.01 * E.max()


def test_no_power_gets_lost_with_openings_and_without():
    for scene in (corner(), paper_room()):
        made = plan(scene, 3.0, "floor")
        exact = Model(method=made.model.method, visibility=made.model.visibility, residual=1e-12)
        assert simulate(made.cells, made.light, exact).energy_balance < 1e-10


def test_the_memory_estimate_is_that_of_the_matrix_and_little_more(monkeypatch):
    monkeypatch.setattr("sim.planning.methods.RAY_S", 1.0)
    made = planned("paper-room", 1.0)
    matrix_mb = 8 * made.patches**2 / 1e6
    assert matrix_mb < made.peak_mb < 1.2 * matrix_mb + 2


def test_what_does_not_fit_is_refused_with_a_tolerance_that_does():
    with pytest.raises(SimulationError, match=r"8 MB hold [\d,]+; try a tolerance of ([\d.]+) %") as refused:
        planned("paper-room", 0.3, memory_limit_mb=8.0)
    advised = float(str(refused.value).split("tolerance of ")[1].split(" ")[0])
    assert planned("paper-room", advised, memory_limit_mb=8.0).peak_mb <= 8.0


def test_a_tolerance_that_no_machine_could_meet_is_refused_at_once():
    with pytest.raises(SimulationError, match="try a tolerance of"):
        planned("paper-room", 1e-4)


@pytest.mark.parametrize("tolerance", [0.0, -1.0, float("nan")])
def test_tolerances_not_above_0_are_refused(tolerance):
    with pytest.raises(SimulationError, match=r"above 0|give a finite number"):
        planned("corner", tolerance)


def test_a_light_that_is_not_there_is_refused():
    with pytest.raises(SimulationError, match="unknown light"):
        plan(corner(), 1.0, "sun")


def test_every_standard_light_is_known():
    for entry in SURFACES.values():
        assert entry.light in ("projector", "floor", "uniform")
    assert make_test_lighting("uniform", planned("furnace", 1.0).cells).name == "uniform"
