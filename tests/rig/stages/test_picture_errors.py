"""Figures of a picture's error, against constants, an independent library, and brute force."""

import numpy as np
import pytest
from skimage.color import deltaE_ciede2000, rgb2lab

from rig.stages.picture_errors import (
    best_gain,
    colour_difference,
    contrast,
    grey_difference,
    perceived_errors,
    picture_errors,
)

SHAPE = (20, 30)
EVERYWHERE = np.ones(SHAPE, dtype=bool)


def ramp() -> np.ndarray:
    return np.linspace(10, 200, SHAPE[0] * SHAPE[1]).reshape(SHAPE)


def test_a_picture_that_is_as_wanted_has_no_error():
    errors = perceived_errors(ramp(), ramp(), EVERYWHERE)
    assert errors.as_json() == {
        **dict.fromkeys(("mean", "sd", "max", "rms", "bias", "delta_e_2000", "mean_at_best_gain"), 0.0),
        **dict.fromkeys(("ssim", "best_gain"), pytest.approx(1.0)),
    }


def test_an_offset_is_bias_and_mean_and_leaves_no_deviation():
    errors = picture_errors(ramp() - 7, ramp(), EVERYWHERE)
    assert errors.mean == errors.rms == errors.max == pytest.approx(7)
    assert errors.bias == pytest.approx(-7)
    assert errors.sd == pytest.approx(0, abs=1e-9)


def test_what_is_outside_the_mask_does_not_count_even_if_it_is_no_number():
    shown, mask = ramp() + 3, EVERYWHERE.copy()
    shown[:5], mask[:5] = np.nan, False
    errors = perceived_errors(shown, ramp(), mask)
    assert errors.mean == pytest.approx(3)
    assert np.isfinite(list(errors.as_json().values())).all()


def test_the_difference_of_greys_is_that_of_the_general_formula():
    """CIEDE2000 of a library, for Lab colours made here from light by the definition of L*."""
    levels = np.linspace(0, 255, 40)

    def lab(light: np.ndarray) -> np.ndarray:
        relative = light / 255
        lightness = np.where(relative > 216 / 24389, 116 * np.cbrt(relative) - 16, relative * 24389 / 27)
        return np.stack([lightness, np.zeros_like(light), np.zeros_like(light)], axis=-1)

    first, second = np.meshgrid(levels, levels)
    assert grey_difference(first, second) == pytest.approx(deltaE_ciede2000(lab(first), lab(second)), abs=1e-9)


def test_the_best_gain_is_the_best_of_many():
    rng = np.random.default_rng(3)
    shown, wanted = rng.uniform(0, 255, 400), rng.uniform(0, 255, 400)
    tried = np.linspace(0.05, 3, 20_001)
    errors = np.abs(tried[:, None] * shown - wanted).mean(axis=1)
    assert best_gain(shown, wanted) == pytest.approx(tried[errors.argmin()], abs=2e-4)


def test_a_black_picture_has_no_best_gain():
    assert best_gain(np.zeros(5), np.ones(5)) == 1.0


def test_contrast_is_light_over_dark_and_none_without_both():
    wanted = np.where(np.arange(30) < 10, 255.0, 0.0) * np.ones(SHAPE)
    shown = np.where(wanted > 0, 200.0, 25.0)
    assert contrast(shown, wanted, EVERYWHERE) == pytest.approx(8)
    assert contrast(shown, ramp(), EVERYWHERE) is None
    assert contrast(np.where(wanted > 0, 200.0, 0.0), wanted, EVERYWHERE) is None


def coloured(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0, 300, (20, 30, 3))


def test_the_difference_of_colours_is_that_of_their_srgb_codes() -> None:
    """Light above white included; scikit-image takes codes, so the light is coded first."""
    first, second = (coloured(seed).reshape(-1, 3) for seed in (1, 2))

    def lab(light: np.ndarray) -> np.ndarray:
        share = light / 255
        codes = np.where(share <= 0.0031308, 12.92 * share, 1.055 * share ** (1 / 2.4) - 0.055)
        return rgb2lab(codes)

    assert colour_difference(first, second) == pytest.approx(deltaE_ciede2000(lab(first), lab(second)), abs=0.03)


def test_neutral_colours_differ_as_greys_do() -> None:
    first, second = (coloured(seed)[..., :1].reshape(-1, 1) for seed in (3, 4))
    in_colour = colour_difference(first.repeat(3, axis=1), second.repeat(3, axis=1))
    assert in_colour == pytest.approx(grey_difference(first[:, 0], second[:, 0]), abs=1e-6)


def test_errors_of_three_bands_are_means_over_all() -> None:
    wanted = np.random.default_rng(5).uniform(50, 200, (20, 30, 3))
    shown = wanted + np.array([3.0, 0.0, -6.0])
    mask = np.zeros((20, 30), bool)
    mask[5:15, 5:25] = True
    shown[~mask] = np.nan
    errors = perceived_errors(shown, wanted, mask)
    assert errors.mean == pytest.approx(3)
    assert errors.bias == pytest.approx(-1)
    assert errors.max == pytest.approx(6)
    assert 0.9 < errors.ssim < 1
    assert errors.delta_e_2000 > 0.5
