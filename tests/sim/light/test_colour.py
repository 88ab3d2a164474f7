"""Colour transports: channels mix once at the projector, bands bounce on their own."""

import numpy as np
import pytest

from sim.errors import SimulationError
from sim.form_factors import form_factors
from sim.geometry.optics import Lens, Pose
from sim.light.colour import ColourTransport
from sim.light.transport_of_scene import coaxial_transport
from sim.scenes.gridded import room

LENS = Lens.from_horizontal_field_of_view(12, 9, 90.0)
MIXING = np.array([[0.9, 0.08, 0.02], [0.06, 0.8, 0.1], [0.0, 0.12, 0.7]])


def _band(reflectance, lens=LENS):
    scene = room((2.0, 2.0, 2.0), 0.5, reflectance)
    return coaxial_transport(scene, form_factors(scene), lens, Pose.look_at((0.5, 0.5, 1.0), (2.0, 2.0, 1.0)))


BANDS = tuple(_band(reflectance) for reflectance in (0.8, 0.6, 0.3))


def test_each_band_sees_the_mixed_channels_through_its_own_transport():
    transport = ColourTransport(BANDS, MIXING)
    p = np.random.default_rng(1).uniform(size=(LENS.n_pixels, 3))
    c = transport.forward(p)
    for b, band in enumerate(BANDS):
        light = sum(MIXING[b, q] * p[:, q] for q in range(3))
        assert np.allclose(c[:, b], band @ light)


def test_as_an_operator_it_takes_flat_images_with_channels_last():
    transport = ColourTransport(BANDS, MIXING)
    p = np.random.default_rng(2).uniform(size=(LENS.n_pixels, 3))
    assert transport.shape == (3 * LENS.n_pixels, 3 * LENS.n_pixels)
    assert np.array_equal((transport @ p.ravel()).reshape(-1, 3), transport.forward(p))


def test_the_adjoint_is_the_transpose():
    transport = ColourTransport(BANDS, MIXING)
    rng = np.random.default_rng(3)
    x, y = rng.normal(size=(2, LENS.n_pixels, 3))
    assert np.vdot(transport.forward(x), y) == pytest.approx(np.vdot(x, transport.adjoint(y)), rel=1e-12)
    assert np.vdot(transport @ x.ravel(), y) == pytest.approx(np.vdot(x, transport.T @ y.ravel()), rel=1e-12)


def test_one_band_of_mixing_one_is_the_grey_transport():
    transport = ColourTransport(BANDS[:1], [[1.0]])
    p = np.random.default_rng(4).uniform(size=LENS.n_pixels)
    assert np.array_equal(transport.forward(p[:, None])[:, 0], BANDS[0] @ p)


@pytest.mark.parametrize(
    ("bands", "mixing", "words"),
    [
        ((), np.eye(0), "no band"),
        (BANDS, np.eye(2), r"shape \(2, 2\) for 3 bands"),
        (BANDS, np.full((3, 3), np.nan), "9 values of the mixing not finite"),
        (BANDS, np.ones((3, 3)), "two channels look alike"),
        ((BANDS[0], _band(0.5, Lens.from_horizontal_field_of_view(8, 6, 90.0))), np.eye(2), "different shapes"),
    ],
)
def test_bands_and_mixing_that_do_not_fit_are_refused(bands, mixing, words):
    with pytest.raises(SimulationError, match=words):
        ColourTransport(bands, mixing)


def test_bands_of_different_geometry_are_refused():
    scene = room((2.0, 2.0, 2.0), 0.5, 0.5)
    elsewhere = Pose.look_at((1.0, 0.5, 1.0), (2.0, 2.0, 1.0))
    other = coaxial_transport(scene, form_factors(scene), LENS, elsewhere)
    with pytest.raises(SimulationError, match="different patches"):
        ColourTransport((BANDS[0], other), np.eye(2))
