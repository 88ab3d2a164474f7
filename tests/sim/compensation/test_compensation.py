"""Compensation strategies: exactness, optimality, and what they refuse."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from scipy.sparse import csr_array, diags_array

from sim.compensation import STRATEGIES, compensate
from sim.compensation.strategies.paper import required_emission
from sim.errors import SimulationError
from sim.form_factors import form_factors
from sim.geometry.optics import Lens, Pose
from sim.light.transport_of_scene import LightTransport, coaxial_transport, physical_transport
from sim.scenes.gridded import paper_room, room

LENS = Lens.from_horizontal_field_of_view(64, 48, 100.0)
POSE = Pose.look_at((1.2, 1.2, 1.2), (2.2, 2.2, 1.2))


def _transport(reflectance=0.7, convention="paper", rule="pixel_mean", lens=LENS, ceiling=True):
    scene = paper_room(ceiling, reflectance)
    return coaxial_transport(scene, form_factors(scene), lens, POSE, convention=convention, emission_rule=rule)


def _picture(transport, seed=0):
    """A target between a fifth and all of what half white gives, rough in space."""
    rng = np.random.default_rng(seed)
    return rng.uniform(0.2, 1.0, transport.shape[0]) * (transport @ np.full(transport.shape[1], 0.5))


CASES = [
    (0.7, "paper", "pixel_mean"),
    (0.7, "physical", "area"),
    (0.3, "paper", "area"),
    (0.9, "physical", "area"),
]


@pytest.mark.parametrize(("reflectance", "convention", "rule"), CASES)
def test_bounded_is_never_worse_than_any_other(reflectance, convention, rule):
    transport = _transport(reflectance, convention, rule)
    for seed in range(3):
        target = _picture(transport, seed)
        residual = {name: compensate(name, transport, target).residual_rms for name in STRATEGIES}
        assert residual["bounded"] <= min(residual.values()) * (1 + 1e-3)


@pytest.mark.parametrize(("reflectance", "convention", "rule"), CASES)
def test_bounded_meets_the_optimality_conditions_and_its_certificate(reflectance, convention, rule):
    transport = _transport(reflectance, convention, rule)
    target = _picture(transport)
    solution = compensate("bounded", transport, target, tolerance=1e-6)
    gradient = transport.T @ (solution.predicted - target)
    inside = (solution.projector_image > 1e-9) & (solution.projector_image < 1 - 1e-9)
    scale = np.abs(transport.T @ target).max()
    assert np.abs(gradient[inside]).max() < 1e-4 * scale
    assert gradient[solution.projector_image <= 0].min(initial=0) > -1e-4 * scale
    assert gradient[solution.projector_image >= 1].max(initial=0) < 1e-4 * scale
    assert solution.notes["optimal_rms_at_least"] == pytest.approx(solution.residual_rms, rel=1e-5)


def test_bounded_agrees_with_a_general_solver():
    scene = room((2.0, 2.0, 2.0), 0.5, 0.8)
    lens = Lens.from_horizontal_field_of_view(12, 9, 90.0)
    pose = Pose.look_at((0.5, 0.5, 1.0), (2.0, 2.0, 1.0))
    transport = coaxial_transport(scene, form_factors(scene), lens, pose)
    target = np.random.default_rng(5).uniform(0.0, 1.5, lens.n_pixels)
    T = transport @ np.eye(lens.n_pixels)
    reference = lsq_linear(T, target, (0, 1), tol=1e-12)
    ours = compensate("bounded", transport, target, tolerance=1e-8)
    assert ours.residual_rms == pytest.approx(np.sqrt(2 * reference.cost / target.size), rel=1e-6)
    assert np.abs(ours.projector_image - reference.x).max() < 1e-3


@pytest.mark.parametrize("name", ["exact", "bounded"])
@pytest.mark.parametrize(("reflectance", "convention", "rule"), CASES)
def test_an_image_that_the_projector_can_give_is_given_exactly(name, reflectance, convention, rule):
    transport = _transport(reflectance, convention, rule)
    p = np.random.default_rng(7).uniform(0.1, 0.9, transport.shape[1])
    solution = compensate(name, transport, transport @ p)
    assert np.abs(solution.predicted - transport @ p).max() < 1e-8 * (transport @ p).max()
    assert not solution.clipped.any()


def test_uniform_grey_comes_out_exact_where_the_papers_rule_misses_by_twenty():
    transport = _transport()
    grey = np.full(LENS.n_pixels, 70.0)
    error = {
        name: np.abs(compensate(name, transport, grey, lower=0.0, upper=255.0).predicted - grey).mean()
        for name in ("paper", "exact", "bounded")
    }
    assert 15 < error["paper"] < 26
    assert error["exact"] < 1e-9
    assert error["bounded"] < 0.1


def test_exact_is_the_elimination_of_unlit_patches():
    # Equations 12 to 15 with E' = 0 where no pixel falls, on an image that is constant on each patch.
    transport = _transport(0.7)
    patch = transport.pixel_patch
    values = np.random.default_rng(8).uniform(30, 60, transport.radiosity.n_patches)
    target = values[patch]
    lit = np.unique(patch)
    unlit = np.setdiff1d(np.arange(transport.radiosity.n_patches), lit)
    system = np.eye(transport.radiosity.n_patches) - 0.7 * transport.radiosity.form_factors.matrix
    B_unlit = np.linalg.solve(system[np.ix_(unlit, unlit)], -system[np.ix_(unlit, lit)] @ values[lit])
    E = np.zeros(len(system))
    E[lit] = system[np.ix_(lit, lit)] @ values[lit] + system[np.ix_(lit, unlit)] @ B_unlit
    by_elimination = E[patch] / transport.direct_matrix.diagonal()
    solution = compensate("exact", transport, target, lower=-1e9, upper=1e9)
    assert np.allclose(solution.projector_image, by_elimination, rtol=1e-9)


def test_the_papers_rule_is_its_equations():
    transport = _transport()
    target = _picture(transport) * 255
    G = 0.7 * transport.radiosity.form_factors.matrix
    B = np.array(
        [target[transport.pixel_patch == i].mean() if (transport.pixel_patch == i).any() else 0 for i in range(576)]
    )
    E = B - G @ B
    assert np.allclose(required_emission(transport, target), E)
    k = 1234
    i = transport.pixel_patch[k]
    wanted = E[i] / transport.direct_matrix.diagonal()[k] * target[k] / B[i]
    solution = compensate("paper", transport, target, lower=0.0, upper=255.0)
    assert solution.projector_image[k] == pytest.approx(np.clip(wanted, 0, 255))


def test_direct_ignores_interreflection_and_so_is_too_bright():
    transport = _transport(convention="physical", rule="area")
    target = 0.3 * (transport.direct @ np.ones(LENS.n_pixels))
    solution = compensate("direct", transport, target)
    assert np.allclose(transport.direct @ solution.projector_image, target)
    assert (solution.predicted > target).all()


def test_none_takes_the_best_gain_or_the_one_given():
    transport = _transport()
    target = _picture(transport)
    best = compensate("none", transport, target)
    assert best.notes["gain"] * target.max() <= 1 + 1e-12
    for gain in (0.9 * best.notes["gain"], 0.97 * best.notes["gain"]):
        assert compensate("none", transport, target, gain=gain).residual_rms >= best.residual_rms
    assert np.array_equal(compensate("none", transport, target, gain=1.0).projector_image, np.clip(target, 0, 1))


@pytest.mark.parametrize("name", STRATEGIES)
def test_black_gives_black_and_pixels_that_meet_nothing_stay_dark(name):
    transport = _transport(ceiling=False)
    nothing = transport.pixel_patch < 0
    assert nothing.any()
    black = compensate(name, transport, np.zeros(LENS.n_pixels))
    assert black.projector_image.max() == 0
    target = np.where(nothing, 0.0, 0.3)
    solution = compensate(name, transport, target)
    assert solution.projector_image[nothing].max() == 0
    assert np.isfinite(solution.predicted).all()


@pytest.mark.parametrize("name", STRATEGIES)
def test_every_strategy_stays_in_range_and_predicts_what_the_transport_gives(name):
    transport = _transport(0.9, "physical", "area")
    target = 3 * _picture(transport)
    solution = compensate(name, transport, target, lower=0.1, upper=0.8)
    assert solution.projector_image.min() >= 0.1
    assert solution.projector_image.max() <= 0.8
    assert np.allclose(solution.predicted, transport @ solution.projector_image)
    assert solution.residual_rms == pytest.approx(np.sqrt(np.mean((solution.predicted - target) ** 2)))


def test_bad_input_is_refused_with_the_figures():
    transport = _transport()
    with pytest.raises(SimulationError, match=r"unknown compensation 'magic'; there are none, direct"):
        compensate("magic", transport, np.zeros(LENS.n_pixels))
    with pytest.raises(SimulationError, match="3072 camera pixels"):
        compensate("exact", transport, np.zeros(5))
    with pytest.raises(SimulationError, match="not finite"):
        compensate("exact", transport, np.full(LENS.n_pixels, np.nan))
    with pytest.raises(SimulationError, match=r"1 ... 0 is empty"):
        compensate("exact", transport, np.zeros(LENS.n_pixels), lower=1.0, upper=0.0)


@pytest.mark.parametrize("name", ["direct", "paper", "exact", "bounded"])
def test_a_camera_elsewhere_is_refused_with_advice(name):
    scene = paper_room()
    beside = Pose.look_at((1.6, 1.0, 1.3), (2.4, 2.2, 1.1))
    transport = physical_transport(scene, form_factors(scene), LENS, POSE, camera_lens=LENS, camera_pose=beside)
    with pytest.raises(SimulationError, match="resample the camera to the projector's view"):
        compensate(name, transport, np.zeros(LENS.n_pixels))


def test_bounded_says_how_good_it_is_when_its_steps_run_out():
    transport = _transport()
    target = 2 * _picture(transport)
    early, late = (compensate("bounded", transport, target, limit=limit) for limit in (0, 60))
    assert early.notes["short_of_optimum"] > 1e-3 > late.notes["short_of_optimum"]
    assert early.residual_rms * (1 - early.notes["short_of_optimum"]) <= late.residual_rms


@pytest.mark.parametrize("reflectance", [0.3, 0.8, 0.95])
def test_bounded_copes_with_pixels_of_very_unequal_and_no_brightness(reflectance):
    clean = _transport(reflectance, "physical", "area")
    rng = np.random.default_rng(9)
    diagonal = clean.direct_matrix.diagonal() * np.exp(rng.normal(0, 0.5, LENS.n_pixels))
    diagonal[rng.random(LENS.n_pixels) < 0.05] = 0
    diagonal[rng.random(LENS.n_pixels) < 0.02] *= 1e-6
    direct = csr_array(diags_array(diagonal))
    transport = LightTransport(direct, clean.emission, clean.radiosity, clean.view, pixel_patch=clean.pixel_patch)
    target = _picture(clean)
    residual = {name: compensate(name, transport, target) for name in STRATEGIES}
    assert residual["bounded"].notes["short_of_optimum"] <= 0.01
    assert residual["bounded"].residual_rms <= min(r.residual_rms for r in residual.values()) * 1.001
