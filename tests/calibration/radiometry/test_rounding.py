"""Means of whole numbers: what rounding added to them is known, or its uncertainty is."""

import numpy as np
import pytest

from calibration.radiometry.black_level import fit_black_level
from calibration.radiometry.camera_response import fit_camera_response
from calibration.radiometry.light_groups import LightBesides, rounding_bias
from calibration.radiometry.response import light_of_levels


@pytest.mark.parametrize("count", [30, 300, 5000])
@pytest.mark.parametrize("width_dn", [0.03, 0.1, 0.2, 0.3, 0.5])
def test_means_are_as_far_off_as_is_said_however_narrow_the_levels_are(width_dn: float, count: int) -> None:
    random = np.random.default_rng(round(1000 * width_dn) + count)
    true = random.uniform(3, 6, 400)
    levels = np.rint(true[:, None] + width_dn * random.normal(size=(400, count)))
    mean, variance = levels.mean(axis=1), levels.var(axis=1)
    found = rounding_bias(mean, variance, count)
    sigma = np.sqrt(found.variance + variance / count)
    off = np.abs(mean - found.bias_dn - true) / np.maximum(sigma, 1e-9)
    assert np.mean(off < 3) > 0.98
    assert off.max() < 4.5
    assert np.sqrt(np.mean(off**2)) > 0.4, "and not much less than is said"


def test_a_mean_half_way_between_two_numbers_is_not_taken_for_well_known() -> None:
    """Levels at 4.57 give or take 0.1 are rounded to 5 three times of four: their variance is that of a wide spread."""
    levels = np.rint(4.57 + 0.1 * np.random.default_rng(3).normal(size=4000))
    assert levels.mean() - 4.57 > 0.15
    found = rounding_bias(levels.mean(), levels.var(), levels.size)
    sigma = float(np.sqrt(found.variance))
    assert levels.mean() - found.bias_dn == pytest.approx(4.57, abs=2 * sigma)
    assert 0.03 < sigma < 0.1


def test_levels_that_are_all_alike_tell_half_a_number_either_way() -> None:
    found = rounding_bias([7.0, 7.0], [0.0, 0.0], [50, 5000])
    assert found.bias_dn == pytest.approx([0.0, 0.0], abs=1e-9)
    assert np.sqrt(found.variance) == pytest.approx([0.2, 0.2], abs=0.06)


def test_wide_levels_are_left_as_they_are() -> None:
    found = rounding_bias([7.3, 120.4], [0.7, 900.0], 1000)
    assert np.abs(found.bias_dn).max() < 1e-3
    assert found.variance.max() < 1e-6


@pytest.mark.parametrize("black_dn", [4.5, 4.57, 4.75, 5.0, 5.3])
def test_the_black_of_a_quiet_camera_of_eight_bits_is_as_far_off_as_is_said(black_dn: float) -> None:
    """Its noise is a tenth of a digital number; room light of a few makes the exposures differ."""
    random = np.random.default_rng(round(100 * black_dn))
    exposures_s = np.repeat([3e-4, 6e-4, 1.2e-3, 2.4e-3, 4.8e-3, 9.6e-3], 2)
    room = random.uniform(600, 900, 4000)
    light = exposures_s[:, None] * room
    levels = np.rint(black_dn + light + np.hypot(0.1, np.sqrt(light / 90)) * random.normal(size=light.shape))
    found = fit_black_level(levels, exposures_s)
    assert abs(found.offset_dn - black_dn) < 3 * found.sigma_dn
    assert found.sigma_dn < 0.15


@pytest.mark.parametrize("black_dn", [3.36, 4.22, 4.84, 7.38, 7.62])
def test_the_dark_end_of_a_curve_is_as_far_off_as_is_said_wherever_black_lies_between_two_numbers(
    black_dn: float,
) -> None:
    """Levels above black are no whole numbers, but those that were rounded are: a quiet camera of eight bits."""
    random = np.random.default_rng(round(100 * black_dn))
    exposures_s = np.repeat(0.02 * np.array([1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 0.75, 1.0, 1.3]), 2)
    white = np.exp(random.uniform(np.log(300), np.log(12000), 8000))

    def frames(light: np.ndarray) -> np.ndarray:
        levels = light + np.hypot(0.08, np.sqrt(light / 95)) * random.normal(size=light.shape)
        return np.clip(np.rint(black_dn + levels), 0, 255)

    black = fit_black_level(frames(0.002 * white * exposures_s[:, None]), exposures_s)
    above = frames(white * exposures_s[:, None]) - black.offset_dn
    room = LightBesides(dark=np.zeros(len(white)), in_step=black.in_step)
    full_dn = 255 - black.offset_dn
    curve = fit_camera_response(above, exposures_s, full_dn, black_dn=black.offset_dn, room=room)
    assert curve.sigma is not None
    light = np.array([0.01, 0.02, 0.05])
    level = black_dn + light * (255 - black_dn) - black.offset_dn
    error = light_of_levels(curve, level) - light
    assert np.abs(error / np.interp(level, curve.levels, curve.sigma)).max() < 3
    assert np.abs(error).max() < 2e-4
