"""The certified optimum against general solvers, in colour and with weights; its certificate; adjusted targets."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from skimage.color import rgb2lab

from sim.compensation import STRATEGIES, compensate
from sim.compensation.box_least_squares import BoxProblem
from sim.compensation.inverse import Inverse
from sim.compensation.split_transport import split_transport_of
from sim.compensation.strategies.perceptual import XYZ_FROM_LINEAR_SRGB, lab_metric
from sim.form_factors import form_factors
from sim.geometry.optics import Lens, Pose
from sim.light.colour import ColourTransport
from sim.light.transport_of_scene import coaxial_transport
from sim.scenes.gridded import room

LENS = Lens.from_horizontal_field_of_view(12, 9, 90.0)
POSE = Pose.look_at((0.5, 0.5, 1.0), (2.0, 2.0, 1.0))
MIXING = np.array([[0.9, 0.08, 0.02], [0.06, 0.8, 0.1], [0.0, 0.12, 0.7]])


def _grey(reflectance=0.8):
    scene = room((2.0, 2.0, 2.0), 0.5, reflectance)
    return coaxial_transport(scene, form_factors(scene), LENS, POSE)


COLOUR = ColourTransport([_grey(reflectance) for reflectance in (0.8, 0.6, 0.3)], MIXING)
DENSE = COLOUR @ np.eye(COLOUR.shape[1])


def _target(seed, shape=(LENS.n_pixels, 3)):
    return np.random.default_rng(seed).uniform(0.0, 1.5, shape)


@pytest.mark.parametrize("seed", range(3))
def test_in_colour_it_agrees_with_a_general_solver(seed):
    target = _target(seed)
    reference = lsq_linear(DENSE, target.ravel(), (0, 1), tol=1e-13, max_iter=500)
    ours = compensate("bounded", COLOUR, target)
    assert ours.residual_rms == pytest.approx(np.sqrt(2 * reference.cost / target.size), rel=1e-6)
    assert np.abs(ours.projector_image.ravel() - reference.x).max() < 2e-3


def test_in_colour_the_channels_compete_so_one_band_after_the_other_is_not_the_optimum():
    target = _target(4)
    wanted = np.stack(
        [compensate("bounded", band, target[:, b]).projector_image for b, band in enumerate(COLOUR.bands)], axis=1
    )
    apart = np.clip(wanted @ np.linalg.inv(MIXING).T, 0, 1)
    rms = np.sqrt(np.mean((COLOUR.forward(apart) - target) ** 2))
    assert compensate("bounded", COLOUR, target).residual_rms < 0.999 * rms


def test_the_gap_bounds_what_any_image_can_gain():
    target = _target(5)
    best = 0.5 * np.sum((compensate("bounded", COLOUR, target, tolerance=1e-12).predicted - target) ** 2)
    problem = BoxProblem(transport=split_transport_of(COLOUR), target=target, lower=0.0, upper=1.0)
    rng = np.random.default_rng(6)
    for _ in range(20):
        state = problem.at(rng.uniform(size=target.shape))
        assert state.objective - state.gap <= best <= state.objective


@pytest.mark.parametrize("seed", range(3))
def test_the_certificate_is_met_and_no_strategy_is_better(seed):
    target = _target(seed)
    ours = compensate("bounded", COLOUR, target)
    assert ours.notes["gap"] <= 1e-6
    assert ours.notes["kkt_residual"] <= 1e-5
    for name in STRATEGIES:
        assert compensate(name, COLOUR, target).residual_rms >= ours.residual_rms * (1 - 1e-6), name


def test_steps_that_run_out_leave_a_gap_that_says_so():
    early = compensate("bounded", COLOUR, _target(7), limit=0)
    late = compensate("bounded", COLOUR, _target(7))
    assert early.notes["gap"] > 1e-3
    assert early.residual_rms * (1 - early.notes["short_of_optimum"]) <= late.residual_rms


def test_perceptual_weights_agree_with_a_general_solver():
    target = _target(8) + 0.05
    metric = lab_metric(target / 1.5, XYZ_FROM_LINEAR_SRGB) / 1.5**2
    roots = np.linalg.cholesky(metric + 1e-12 * np.eye(3)).transpose(0, 2, 1)
    weighted = np.einsum("nbc,ncp->nbp", roots, DENSE.reshape(-1, 3, DENSE.shape[1])).reshape(DENSE.shape)
    wanted = np.einsum("nbc,nc->nb", roots, target).ravel()
    reference = lsq_linear(weighted, wanted, (0, 1), tol=1e-13, max_iter=1000)
    ours = compensate("perceptual", COLOUR, target, white=1.5)
    assert ours.notes["gap"] <= 1e-6
    assert ours.notes["delta_e_rms"] == pytest.approx(np.sqrt(2 * reference.cost / LENS.n_pixels), rel=1e-5)


def test_a_grey_transport_weighs_lightness():
    transport, target = _grey(), _target(9, LENS.n_pixels) + 0.05
    weights = 116 / 3 * target ** (-2 / 3) * 1.6 ** (-1 / 3)
    T = weights[:, None] * (transport @ np.eye(LENS.n_pixels))
    reference = lsq_linear(T, weights * target, (0, 1), tol=1e-13, max_iter=500)
    ours = compensate("perceptual", transport, target, white=1.6)
    assert ours.notes["delta_e_rms"] == pytest.approx(np.sqrt(2 * reference.cost / LENS.n_pixels), rel=1e-5)
    assert ours.residual_rms > compensate("bounded", transport, target).residual_rms


def test_the_lab_metric_measures_small_differences_of_a_colour_library():
    rng = np.random.default_rng(10)
    linear, step = rng.uniform(0.1, 0.9, (50, 3)), 1e-5 * rng.normal(size=(50, 3))
    encoded = [1.055 * np.clip(c, 0, 1) ** (1 / 2.4) - 0.055 for c in (linear, linear + step)]
    before, after = (rgb2lab(c[None])[0] for c in encoded)
    ours = np.einsum("nb,nbc,nc->n", step, lab_metric(linear, XYZ_FROM_LINEAR_SRGB), step)
    assert np.sqrt(ours) == pytest.approx(np.linalg.norm(after - before, axis=1), rel=0.01)


@pytest.mark.parametrize("transport", [_grey(), COLOUR], ids=["grey", "colour"])
def test_the_inverse_and_its_adjoint_undo_the_transport(transport):
    view = split_transport_of(transport)
    rng = np.random.default_rng(11)
    x, y = rng.normal(size=(2, *view.diagonal.shape))
    inverse = Inverse(view)
    assert inverse.apply(view.forward(x)) == pytest.approx(x, abs=1e-9)
    assert np.vdot(inverse.apply(x), y) == pytest.approx(np.vdot(x, inverse.adjoint(y)), rel=1e-9)


def test_the_inverse_iterates_where_there_are_too_many_patches(monkeypatch):
    view = split_transport_of(COLOUR)
    x = np.random.default_rng(12).normal(size=view.diagonal.shape)
    direct = Inverse(view)
    expected = direct.apply(x), direct.adjoint(x)
    monkeypatch.setattr("sim.compensation.inverse.DENSE_LIMIT", 0)
    iterated = Inverse(view)
    assert iterated.apply(x) == pytest.approx(expected[0], abs=1e-7)
    assert iterated.adjoint(x) == pytest.approx(expected[1], abs=1e-7)
    assert iterated.iterations > 1


def _fine(reflectance):
    scene = room((2.0, 2.0, 2.0), 0.5, reflectance)
    lens = Lens.from_horizontal_field_of_view(160, 120, 90.0)
    return coaxial_transport(scene, form_factors(scene), lens, POSE, convention="physical", emission_rule="area")


@pytest.mark.parametrize("name", ["bounded", "perceptual"])
def test_on_many_pixels_a_sample_starts_near_the_optimum(name):
    transport = _fine(0.8)
    target = np.random.default_rng(14).uniform(0.05, 1.5, transport.shape[0]) * np.median(
        transport @ np.ones(transport.shape[1])
    )
    start, best = (compensate(name, transport, target, limit=limit) for limit in (0, 60))
    assert best.notes["gap"] <= 1e-6 < start.notes["gap"]
    assert start.notes["optimal_rms_at_least"] <= best.notes["optimal_rms_at_least"] * (1 + 1e-9)
    error, ideal = (each.notes.get("delta_e_rms", each.residual_rms) for each in (start, best))
    assert error <= 1.01 * ideal


def test_in_colour_a_sample_starts_near_the_optimum():
    transport = ColourTransport([_fine(reflectance) for reflectance in (0.8, 0.6, 0.3)], MIXING)
    white = np.median(transport.forward(np.ones((160 * 120, 3))), axis=0)
    target = np.random.default_rng(15).uniform(0.05, 1.2, (160 * 120, 3)) * white
    start, best = (compensate("bounded", transport, target, limit=limit) for limit in (0, 60))
    assert best.notes["gap"] <= 1e-6
    assert start.residual_rms <= 1.02 * best.residual_rms


@pytest.mark.parametrize("adjustment", ["remap", "content_scale", "smooth_attenuation"])
def test_a_target_too_bright_stays_a_picture_with_an_adjusted_target(adjustment):
    transport = _grey()
    target = 3 * np.random.default_rng(13).uniform(0.5, 1.0, LENS.n_pixels)
    dull = compensate("bounded", transport, target)
    ours = compensate("bounded", transport, target, adjustment=adjustment)
    assert dull.clipped.mean() > 0.5
    assert np.corrcoef(ours.predicted, target)[0, 1] > np.corrcoef(dull.predicted, target)[0, 1]
    assert ours.residual_rms >= dull.residual_rms
    assert ours.notes["gap"] <= 1e-6


def test_smooth_attenuation_dims_only_where_it_must():
    # The right half wants more than white can give.
    transport = _grey(0.3)
    x = LENS.pixel_grid()[:, 0]
    reach = transport @ np.ones(LENS.n_pixels)
    target = reach * np.where(x < 6, 0.4, 2.0)
    shown = compensate("bounded", transport, target, adjustment="smooth_attenuation").predicted / target
    assert shown[x < 2].mean() > 0.8
    assert shown[x > 9].mean() < 0.7
