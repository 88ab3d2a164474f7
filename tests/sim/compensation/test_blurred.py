"""Compensation through a projector's blur: against general solvers, its certificate, and who knows of the blur."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from sim.compensation import compensate
from sim.compensation.box_least_squares import BoxProblem
from sim.compensation.split_transport import as_shown, split_transport_of
from sim.form_factors import form_factors
from sim.geometry.optics import Lens, Pose
from sim.light.colour import ColourTransport
from sim.light.picture_blur import PictureBlur
from sim.light.transport import LightTransport
from sim.light.transport_of_scene import coaxial_transport
from sim.scenes.gridded import room

SHAPE = (15, 20)
LENS = Lens.from_horizontal_field_of_view(SHAPE[1], SHAPE[0], 90.0)
POSE = Pose.look_at((0.5, 0.5, 1.0), (2.0, 2.0, 1.0))


def seen_through(variance_px2: float | None, reflectance: float = 0.6) -> LightTransport:
    """A room whose projector blurs so much, twice as much at its right side."""
    scene = room((2.0, 2.0, 2.0), 0.5, reflectance)
    sharp = coaxial_transport(scene, form_factors(scene), LENS, POSE)
    if variance_px2 is None:
        return sharp
    variance = np.broadcast_to(variance_px2 * np.linspace(1, 2, SHAPE[1])[:, None], (*SHAPE, 2))
    blur = PictureBlur(variance_px2=variance, chosen=np.ones(LENS.n_pixels, bool))
    return LightTransport(
        sharp.direct_matrix, sharp.emission, sharp.radiosity, sharp.view, pixel_patch=sharp.pixel_patch, blur=blur
    )


def picture(seed: int, transport: LightTransport, smooth: float = 0.3) -> np.ndarray:
    """A target with fine detail, some of it out of the projector's range."""
    white = transport @ np.ones(LENS.n_pixels)
    return white * np.clip(0.5 + smooth * np.random.default_rng(seed).normal(size=LENS.n_pixels), 0.02, 1.0)


@pytest.mark.parametrize("variance_px2", [0.2, 0.8])
def test_the_optimum_through_blur_is_that_of_a_general_solver(variance_px2: float) -> None:
    transport = seen_through(variance_px2)
    target = picture(1, transport)
    reference = lsq_linear(transport @ np.eye(LENS.n_pixels), target, (0, 1), tol=1e-13, max_iter=1000)
    best = np.sqrt(2 * reference.cost / LENS.n_pixels)
    ours = compensate("bounded", transport, target)
    assert best * (1 - 1e-9) <= ours.residual_rms <= 1.005 * best
    assert ours.notes["optimal_rms_at_least"] <= best * (1 + 1e-9)


def test_asked_for_more_than_the_usual_it_is_found_to_one_in_a_million() -> None:
    transport = seen_through(0.2)
    target = picture(2, transport)
    reference = lsq_linear(transport @ np.eye(LENS.n_pixels), target, (0, 1), tol=1e-13, max_iter=1000)
    ours = compensate("bounded", transport, target, tolerance=1e-6, limit=200)
    assert ours.notes["gap"] <= 1e-6
    assert ours.residual_rms == pytest.approx(np.sqrt(2 * reference.cost / LENS.n_pixels), rel=1e-6)


def test_the_gap_bounds_what_any_image_can_gain_through_blur() -> None:
    transport = seen_through(0.8)
    target = picture(3, transport)
    reference = lsq_linear(transport @ np.eye(LENS.n_pixels), target, (0, 1), tol=1e-13, max_iter=1000)
    shown = as_shown(split_transport_of(transport))
    problem = BoxProblem(transport=shown, target=target[:, None], lower=0.0, upper=1.0)
    for p in np.random.default_rng(4).uniform(size=(20, LENS.n_pixels, 1)):
        state = problem.at(p)
        assert state.objective - state.gap <= reference.cost <= state.objective


@pytest.mark.parametrize("name", ["exact", "bounded", "perceptual"])
def test_a_picture_that_would_be_blurred_is_sharpened(name: str) -> None:
    transport = seen_through(0.3)
    target = picture(5, transport, smooth=0.1)
    unaware = compensate(name, seen_through(None), target).projector_image
    aware = compensate(name, transport, target)
    left = np.sqrt(np.mean((transport @ unaware - target) ** 2))
    assert aware.residual_rms < 0.7 * left
    assert aware.predicted == pytest.approx(transport @ aware.projector_image)


@pytest.mark.parametrize("name", ["none", "direct", "dual", "reverse_radiosity", "series", "tikhonov"])
def test_published_methods_take_the_picture_for_sharp_and_are_told_what_is_seen(name: str) -> None:
    transport, sharp = seen_through(0.5), seen_through(None)
    target = picture(6, transport)
    blurred, plain = compensate(name, transport, target), compensate(name, sharp, target)
    assert np.array_equal(blurred.projector_image, plain.projector_image)
    assert blurred.predicted == pytest.approx(transport @ plain.projector_image)


def test_every_channel_of_a_colour_projector_is_sharpened() -> None:
    bands = [seen_through(0.3, reflectance) for reflectance in (0.7, 0.5, 0.3)]
    mixing = np.array([[0.9, 0.08, 0.02], [0.06, 0.8, 0.1], [0.0, 0.12, 0.7]])
    transport = ColourTransport(bands, mixing)
    target = np.stack([picture(7 + b, band, 0.1) * mixing[b].sum() for b, band in enumerate(bands)], axis=1)
    dense = transport @ np.eye(transport.shape[1])
    reference = lsq_linear(dense, target.ravel(), (0, 1), tol=1e-13, max_iter=1000)
    ours = compensate("bounded", transport, target, tolerance=1e-5, limit=60)
    assert ours.residual_rms == pytest.approx(np.sqrt(2 * reference.cost / target.size), rel=1e-3)


def test_the_adjoint_is_the_transpose_with_blur() -> None:
    view = as_shown(split_transport_of(seen_through(0.7)))
    x, y = np.random.default_rng(8).normal(size=(2, LENS.n_pixels, 1))
    assert np.vdot(view.forward(x), y) == pytest.approx(np.vdot(x, view.adjoint(y)), rel=1e-10)


def test_sharpening_raises_what_blur_takes_and_no_more_than_it_was_told() -> None:
    view = as_shown(split_transport_of(seen_through(0.4)))
    p = np.random.default_rng(9).uniform(size=(LENS.n_pixels, 1))
    errors = [np.linalg.norm(view.blurred(view.sharpened(p, steps)) - p) for steps in (0, 1, 2, 4)]
    assert errors == sorted(errors, reverse=True)
    assert np.linalg.norm(view.sharpened(p, 2)) <= 3 * np.linalg.norm(p)
    assert np.array_equal(split_transport_of(seen_through(0.4)).sharpened(p, 2), p)
