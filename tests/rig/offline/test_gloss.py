"""``rig simulate`` with gloss: of all patches or of a file; whether matte is enough, and what is refused."""

import json

import numpy as np
import pytest
import trimesh

from rig.cli.app import run_command
from rig.errors import UsageError
from rig.offline.gloss import NOISE_SHARE, lobes_for, summary_of_gloss, with_gloss
from rig.offline.simulate import SimulationRequest, plan_simulation, run_simulate
from rig.terminal import silent
from sim.light.lighting import PlacedProjector
from sim.planning.gloss import gloss_of_cells
from sim.planning.plan import plan
from sim.scenes.catalogue import SURFACES


def simulated(**request):
    return run_simulate(SimulationRequest(**({"scene": "paper-room", "tolerance": 3.0} | request)), silent)


def test_a_little_gloss_is_matte_enough_and_the_plan_says_by_how_much_it_is_wrong():
    result = simulated(reflectance=(0.5,), gloss=0.01, roughness=0.5)
    gloss = result.plan.gloss
    assert not gloss.needed
    assert 0 < gloss.matte_between < gloss.matte_seen < 1.0
    assert gloss.matte_error == result.estimated.error < 3.0
    assert "enough for 3 %" in result.plan.reasons[-1]
    matte = simulated(reflectance=(0.5,))
    assert matte.plan.gloss is None
    assert result.estimated.seconds < 3 * matte.estimated.seconds + 0.1


def test_much_gloss_is_simulated_and_keeps_the_tolerance():
    request = SimulationRequest(scene="paper-room", tolerance=3.0, reflectance=(0.5,), gloss=0.2, roughness=0.2)
    result = run_simulate(request, silent, check=True)
    json.dumps(result.as_json(), allow_nan=False)
    assert result.plan.gloss.needed
    assert max(result.plan.gloss.matte_seen, result.plan.gloss.matte_highlight) > 3.0
    assert "lobes by rays" in result.plan.reasons[-1]
    assert result.plan.gloss.bend > 1
    assert result.plan.patches > 1.2 * simulated(reflectance=(0.5,)).plan.patches
    assert result.tolerance == 3.0
    assert result.estimated.error <= 3.0
    assert 0.3 < result.actual.error < 3.0
    assert result.actual.residual < 1e-4


@pytest.fixture(scope="module")
def noisy():
    """A checked result with noisy lobes, and what was told of its progress."""
    told = []
    request = SimulationRequest(scene="paper-room", tolerance=7.0, reflectance=(0.3,), gloss=0.5, roughness=0.2)
    result = run_simulate(request, lambda label, done, total: told.append((label, done / total)), check=True)
    return result, told


def test_the_noise_of_the_lobes_rays_is_in_the_error_that_is_stated(noisy):
    result, _ = noisy
    assert 1.0 < result.actual.noise < 1.3 * result.plan.gloss.noise
    assert result.plan.gloss.noise < result.estimated.error < 7.0
    assert result.actual.error < result.estimated.error
    assert result.actual.refined_noise > 1.0


@pytest.mark.parametrize("label", ["try lobes", "trace lobes", "check against a refined solution"])
def test_progress_is_told_while_lobes_are_tried_traced_and_checked(noisy, label):
    shares = [share for one, share in noisy[1] if one == label]
    assert len(shares) >= 4
    assert shares == sorted(shares)
    assert shares[-1] <= 1.0


def test_the_number_of_rays_that_were_sent_is_that_of_the_plan_or_more(noisy):
    result, _ = noisy
    assert result.as_json()["actual"]["lobe_rays"] >= result.plan.gloss.rays >= 32


def test_a_smaller_tolerance_takes_the_rays_that_its_noise_needs():
    wide, narrow = (lobes_at(tolerance) for tolerance in (8.0, 1.0))
    assert narrow.rays > 2 * wide.rays
    assert wide.noise < NOISE_SHARE * 8.0
    assert narrow.noise == pytest.approx(NOISE_SHARE * 1.0, rel=0.2)


def lobes_at(tolerance):
    scene = with_gloss(SURFACES["paper-room"].build(), 0.5, 0.2, (0.3,))
    made = plan(scene.as_matte, 8.0, "projector")
    allowed = NOISE_SHARE * tolerance
    summary = summary_of_gloss(scene, made, memory_mb=1000.0, allowed=allowed)
    return lobes_for(summary, gloss_of_cells(made.cells, scene.surface, scene.gloss), allowed, tolerance)


def test_a_tolerance_that_the_most_rays_do_not_reach_is_refused_before_they_are_sent():
    with pytest.raises(UsageError, match=r"0.02 % with gloss: .* pairs of rays .* noise, 0.0086 % is allowed; try"):
        lobes_at(0.02)


def test_noise_beyond_what_is_allowed_is_refused(monkeypatch):
    monkeypatch.setattr("sim.planning.gloss.MOST_PAIRS", 1 << 14)
    request = SimulationRequest(scene="paper-room", tolerance=5.0, reflectance=(0.3,), gloss=0.5, roughness=0.2)
    with pytest.raises(UsageError, match=r"5 % with gloss: .* noise, 2.1 % is allowed; try a tolerance of"):
        run_simulate(request, silent)


def test_a_limit_of_time_counts_the_lobes(monkeypatch):
    request = {"scene": "corner", "reflectance": (0.5,), "gloss": 0.2, "roughness": 0.2, "light": "floor"}
    cheap, dear = (limited(monkeypatch, pair_s, **request) for pair_s in (1e-9, 3e-5))
    assert cheap.plan.gloss.needed
    assert dear.plan.patches < cheap.plan.patches
    assert max(cheap.estimated.seconds, dear.estimated.seconds) < 2.0


def limited(monkeypatch, pair_s, **request):
    """Planned for 2 s, where a pair of rays is expected to take so long, on a clock that stands still."""
    monkeypatch.setattr("sim.planning.gloss.PAIR_S", pair_s)
    monkeypatch.setattr("sim.planning.time_limit.time.perf_counter", lambda: 0.0)
    monkeypatch.setattr("sim.planning.time_limit.FINEST_PERCENT", 1.0)
    return plan_simulation(SimulationRequest(tolerance=1.0, seconds=2.0, **request), silent)[1]


def test_a_time_that_the_lobes_alone_would_take_is_refused_with_what_all_would_take(monkeypatch):
    monkeypatch.setattr("sim.planning.gloss.PAIR_S", 0.1)
    request = SimulationRequest(
        scene="corner", tolerance=1.0, seconds=5.0, reflectance=(0.5,), gloss=0.2, roughness=0.2, light="floor"
    )
    with pytest.raises(UsageError, match=r"16 % takes about .* s of it for the lobes of gloss, the limit is 5 s"):
        run_simulate(request, silent)


def test_lobes_are_tried_in_the_light_of_the_projector_that_was_placed(monkeypatch):
    tried = []
    monkeypatch.setattr("rig.offline.gloss.plan", lambda *given, **_: tried.append(given[2]) or plan(*given))
    placed = PlacedProjector(position_m=(0.5, 0.5, 0.5), look_at_m=(0.2, 0.2, 0.0))
    simulated(reflectance=(0.5,), gloss=0.2, roughness=0.3, projector=placed, tolerance=8.0)
    assert tried == [placed]


def test_colours_have_one_solve_each_under_gloss_too():
    result = simulated(reflectance=(0.6, 0.5, 0.4), gloss=0.2)
    assert result.plan.channels == 3
    assert result.actual.residual < 1e-4


@pytest.mark.parametrize(
    ("request_", "what"),
    [
        ({"reflectance": (0.9,), "gloss": 0.2}, "together more than 1"),
        ({"gloss": -0.1}, "--gloss: gloss -0.1"),
        ({"gloss": 0.1, "roughness": 0.0}, "a mirror is no lobe"),
        ({"roughness": 0.3}, "give --gloss too"),
        ({"gloss": float("nan")}, "it must lie in 0"),
    ],
)
def test_a_gloss_that_cannot_be_is_refused(request_, what):
    with pytest.raises(UsageError, match=what):
        simulated(**request_)


def saved_room(folder, **floor):
    """A room seen from inside, its floor of another material, as a GLB file with z upwards turned to y."""
    box = trimesh.creation.box((3.0, 2.0, 3.0))
    box.invert()
    on_floor = box.triangles_center[:, 1] < -0.99
    scene = trimesh.Scene()
    paint = {"baseColorFactor": (128, 128, 128, 255), "metallicFactor": 0.0, "roughnessFactor": 1.0}
    for name, faces, material in (
        ("floor", on_floor, paint | floor),
        ("walls", ~on_floor, {"baseColorFactor": (128, 128, 128, 255)}),
    ):
        part = trimesh.Trimesh(box.vertices, box.faces[faces], process=False)
        part.visual = trimesh.visual.TextureVisuals(material=trimesh.visual.material.PBRMaterial(name=name, **material))
        scene.add_geometry(part, geom_name=name, node_name=name)
    scene.export(folder / "room.glb")
    return str(folder / "room.glb")


def test_a_file_brings_its_gloss(tmp_path):
    result = simulated(scene=saved_room(tmp_path, metallicFactor=0.6, roughnessFactor=0.4), light="projector")
    floor = 3.0 * 3.0 / (2 * 9.0 + 4 * 6.0)
    assert result.plan.gloss.area_share == pytest.approx(floor, rel=1e-6)
    assert result.plan.gloss.needed
    overruled = simulated(scene=saved_room(tmp_path, metallicFactor=0.6), light="projector", gloss=0.0)
    assert overruled.plan.gloss is None


def test_a_file_that_states_no_metal_is_matte(tmp_path):
    path = saved_room(tmp_path, metallicFactor=None, roughnessFactor=None)
    assert simulated(scene=path, light="projector").plan.gloss is None


def test_several_colours_need_one_gloss(tmp_path):
    path = saved_room(tmp_path, metallicFactor=0.6)
    with pytest.raises(UsageError, match="several colours need one --gloss"):
        simulated(scene=path, reflectance=(0.3, 0.2))


def test_the_command_line_takes_gloss(capsys):
    arguments = [
        "simulate",
        "corner",
        "--tolerance",
        "5",
        "--reflectance",
        "0.5",
        "--gloss",
        "0.2",
        "--roughness",
        "0.2",
    ]
    assert run_command([*arguments, "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["plan"]["gloss"]["area_share"] == pytest.approx(1.0)
    assert np.isfinite(printed["actual"]["seconds"])
