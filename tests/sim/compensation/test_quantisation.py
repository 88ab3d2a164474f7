"""Projector images in 256 levels: unbiased with a seed, nearest without, and what that costs."""

import numpy as np
import pytest

from sim.compensation import compensate
from sim.compensation.quantisation import GAMMA_2_2, quantise, to_codes
from sim.errors import SimulationError
from sim.form_factors import form_factors
from sim.geometry.optics import Lens, Pose
from sim.light.colour import ColourTransport
from sim.light.transport_of_scene import coaxial_transport
from sim.scenes.gridded import room

LENS = Lens.from_horizontal_field_of_view(48, 36, 90.0)


def _transport():
    scene = room((2.0, 2.0, 2.0), 0.5, 0.7)
    return coaxial_transport(scene, form_factors(scene), LENS, Pose.look_at((0.5, 0.5, 1.0), (2.0, 2.0, 1.0)))


@pytest.mark.parametrize("light", [0.0, 0.0003, 0.01, 0.4, 0.9999, 1.0])
def test_dither_is_right_on_average_and_within_a_level(light):
    count = 200_000
    shown = GAMMA_2_2[to_codes(np.full(count, light), seed=3)]
    step = np.diff(GAMMA_2_2)[np.clip(np.searchsorted(GAMMA_2_2, light) - 1, 0, 254)]
    assert abs(shown.mean() - light) <= 4 * step / 2 / np.sqrt(count)
    assert np.abs(shown - light).max() <= step


def test_rounding_takes_the_nearest_level():
    light = np.random.default_rng(1).uniform(size=1000)
    nearest = GAMMA_2_2[np.abs(GAMMA_2_2[:, None] - light).argmin(axis=0)]
    assert GAMMA_2_2[to_codes(light)] == pytest.approx(nearest)


def test_levels_themselves_are_kept_and_the_range_is_not_left():
    assert np.array_equal(to_codes(GAMMA_2_2, seed=5), np.arange(256))
    assert to_codes(np.array([-1.0, 2.0]), seed=5).tolist() == [0, 255]


def test_a_seed_gives_the_same_codes_again_and_another_others():
    light = np.random.default_rng(2).uniform(size=500)
    assert np.array_equal(to_codes(light, seed=1), to_codes(light, seed=1))
    assert not np.array_equal(to_codes(light, seed=1), to_codes(light, seed=2))


def test_dither_keeps_the_light_of_the_patches_where_rounding_loses_it():
    # A dark even picture between two levels: rounding shifts every pixel the same way.
    transport = _transport()
    dark = np.full(LENS.n_pixels, 0.7 * GAMMA_2_2[20] + 0.3 * GAMMA_2_2[21])
    wanted = (transport @ dark).mean()
    rounded, dithered = (quantise(transport, transport @ dark, dark, seed=seed).predicted for seed in (None, 4))
    assert abs(dithered.mean() - wanted) < 0.1 * abs(rounded.mean() - wanted)


def test_the_residual_is_that_of_the_codes():
    transport = _transport()
    target = transport @ np.random.default_rng(6).uniform(0.1, 0.9, LENS.n_pixels)
    exact = compensate("exact", transport, target)
    ours = quantise(transport, target, exact.projector_image, seed=7)
    assert ours.codes.dtype == np.uint8
    assert ours.predicted == pytest.approx(transport @ GAMMA_2_2[ours.codes])
    assert ours.residual_rms == pytest.approx(np.sqrt(np.mean((ours.predicted - target) ** 2)))
    # The exact image left nothing, so all that is left is what the levels add.
    assert ours.added_rms == pytest.approx(ours.residual_rms, rel=1e-6)
    assert 0 < ours.added_rms < 0.01 * target.max()


def test_colour_images_are_quantised_channel_by_channel():
    transport = ColourTransport((_transport(), _transport()), [[0.9, 0.1], [0.1, 0.9]])
    p = np.random.default_rng(8).uniform(size=(LENS.n_pixels, 2))
    ours = quantise(transport, transport.forward(p), p, seed=9)
    assert ours.codes.shape == ours.predicted.shape == p.shape


@pytest.mark.parametrize(
    ("levels", "image"),
    [
        (np.arange(10), np.zeros(LENS.n_pixels)),
        (GAMMA_2_2[::-1], np.zeros(LENS.n_pixels)),
        (np.zeros(256), np.zeros(LENS.n_pixels)),
        (np.full(256, np.nan), np.zeros(LENS.n_pixels)),
        (GAMMA_2_2, np.zeros(3)),
    ],
)
def test_levels_and_images_that_do_not_fit_are_refused(levels, image):
    with pytest.raises(SimulationError, match=r"levels of shape|projector image of shape"):
        quantise(_transport(), np.zeros(LENS.n_pixels), image, levels=levels)
