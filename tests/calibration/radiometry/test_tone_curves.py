"""Curves that bend at both ends, shoulders, and what is said of levels that no frame measured."""

from collections.abc import Callable

import numpy as np
import pytest

from calibration.arrays import FloatArray
from calibration.radiometry.camera_response import fit_camera_response
from calibration.radiometry.light_groups import grouped_by_light
from calibration.radiometry.photon_transfer import TransferPoints, fit_camera_noise, fit_photon_transfer
from calibration.radiometry.response import Response, light_of_levels
from calibration.radiometry.tone_curve import KNOTS, STANDARDS, shoulder, tone_curve

SWEEP = np.repeat([1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 0.75, 1.0, 1.15, 1.35, 1.7, 2.2], 2)
LIGHT = np.array([0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 0.9])
FULL_WELL_E = 12000.0


def in_s(y: FloatArray) -> FloatArray:
    """Darker below, brighter above."""
    return np.asarray(0.7 * y + 0.3 * y * y * (3 - 2 * y))


def srgb(light: FloatArray) -> FloatArray:
    """IEC 61966-2-1."""
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055)


def rec709(light: FloatArray) -> FloatArray:
    """ITU-R BT.709."""
    return np.where(light < 0.018, 4.5 * light, 1.099 * np.maximum(light, 1e-9) ** 0.45 - 0.099)


TONES: dict[str, Callable[[FloatArray], FloatArray]] = {
    "S": in_s,
    "S on sRGB": lambda light: in_s(srgb(light)),
    "S on a power": lambda light: in_s(light**0.5),
    "shoulder": lambda light: srgb(light * 1.7 / (1 + 0.7 * light)),
}


def frames(tone: Callable[[FloatArray], FloatArray], bits: int, seed: int) -> FloatArray:
    """(22, 6000) levels above a black level of 2; the brightest pixels reach 0.8 of full scale at exposure 1."""
    random = np.random.default_rng(seed)
    places = np.linspace(0, 1, 4001)
    brightest = np.interp(0.8, tone(places), places)
    light = brightest * np.clip(np.exp(random.normal(-1, 0.5, 6000)), 0.05, 1)
    electrons = random.poisson(np.outer(SWEEP, light) * FULL_WELL_E) + random.normal(0, 4.0, (len(SWEEP), 6000))
    top = 2.0**bits - 3
    return np.asarray(np.rint(2 + top * tone(np.clip(electrons / FULL_WELL_E, 0, 1))) - 2)


@pytest.mark.parametrize("bits", [8, 12])
@pytest.mark.parametrize("kind", list(TONES))
def test_a_curve_that_bends_at_both_ends_is_found_within_its_stated_error(kind: str, bits: int) -> None:
    for seed in range(2):
        top = 2.0**bits - 3
        response = fit_camera_response(frames(TONES[kind], bits, seed), SWEEP, top, black_dn=2.0)
        at = top * TONES[kind](LIGHT)
        assert response.sigma is not None
        error = light_of_levels(response, at) - LIGHT
        assert np.abs(error / np.interp(at, response.levels, response.sigma)).max() < 3
        assert np.abs(error / LIGHT).max() < 0.012


@pytest.mark.parametrize("standard", range(2), ids=["sRGB", "Rec. 709"])
def test_a_standard_is_summed_up_to_its_own_formula(standard: int) -> None:
    tone = (srgb, rec709)[standard]
    light = np.linspace(0.005, 1, 200)
    found = np.exp(tone_curve(np.zeros(len(KNOTS)), STANDARDS[standard]).log_light_of(tone(light)))
    np.testing.assert_allclose(found, light, rtol=2e-3 if standard else 1e-4)  # Rec. 709 has a step of 0.3 %
    assert np.abs(found - light).max() < 3e-5


@pytest.mark.parametrize("bits", [8, 12])
@pytest.mark.parametrize("tone", [srgb, rec709], ids=["sRGB", "Rec. 709"])
def test_a_camera_that_follows_a_standard_is_told_from_black_to_white(
    tone: Callable[[FloatArray], FloatArray], bits: int
) -> None:
    """Each curve bends sharply at 2 to 4 % of its levels, between two knots; and saturates a little on its own."""
    light = np.concatenate([[0.005, 0.01, 0.02, 0.03], LIGHT])
    for seed in range(2):
        top, camera = 2.0**bits - 3, lambda y: tone(1.05 * y / (1 + 0.05 * y))
        response = fit_camera_response(frames(camera, bits, seed), SWEEP, top, black_dn=2.0)
        at = top * camera(light)
        assert response.sigma is not None
        error, sigma = light_of_levels(response, at) - light, np.interp(at, response.levels, response.sigma)
        assert np.abs(error / sigma).max() < 3
        assert np.abs(error / light).max() < 0.006
        assert np.median(sigma / light) < 0.002


def test_exposures_beyond_the_first_that_clips_measure_a_tone_curve_to_its_end() -> None:
    levels = frames(srgb, 8, 3)
    short = SWEEP <= 1.3
    assert grouped_by_light(levels[short], SWEEP[short], 253.0).brightest < 0.9
    assert grouped_by_light(levels, SWEEP, 253.0).brightest > 0.94


def test_what_begins_to_bend_may_bend_on_where_nothing_was_measured() -> None:
    known = 1e-8 * np.eye(len(KNOTS))
    straight, bending = np.zeros(len(KNOTS)), np.maximum(KNOTS - 0.5, 0)
    for measured in (0.7, 0.9):
        off = shoulder(bending, known, measured)
        assert (off[measured >= KNOTS] == 0).all()
        assert (np.diff(off[measured <= KNOTS]) > 0).all()
        assert off[-1] > 4 * shoulder(straight, known, measured)[-1] > 0


def test_a_slope_within_its_own_error_is_no_bend() -> None:
    unsure = 0.1 * np.eye(len(KNOTS))
    np.testing.assert_array_equal(
        shoulder(np.maximum(KNOTS - 0.5, 0), unsure, 0.9), shoulder(np.zeros(len(KNOTS)), unsure, 0.9)
    )


def test_scatter_that_repeats_share_counts_as_often_as_there_are_exposures() -> None:
    groups = grouped_by_light(frames(in_s, 12, 1), SWEEP, 4093.0)
    rows = np.random.default_rng(2).normal(size=(len(SWEEP) // 2, groups.y.shape[1]))
    shared = groups.scatter(np.repeat(rows, 2, axis=0) * np.sqrt(groups.variance))
    assert shared.means < groups.usable.sum() * 0.6
    assert shared.within < 0.05 * shared.between
    opposed = groups.scatter(np.tile([1.0, -1.0], len(SWEEP) // 2)[:, None] * np.sqrt(groups.variance))
    assert opposed.between < 0.05 * opposed.within


def test_frames_in_which_much_clips_say_nothing_of_noise() -> None:
    """A camera that compresses blocks takes the noise from those beside clipped pixels."""
    random = np.random.default_rng(4)
    light = random.uniform(0.02, 1.0, 20000)
    exposures = np.repeat([0.25, 0.5, 0.9, 2.0], 2)
    electrons = random.poisson(np.outer(exposures, light) * FULL_WELL_E).astype(np.float64)
    electrons[6:] = np.round(electrons[6:], -3)  # what is left of it
    levels = np.minimum(electrons / FULL_WELL_E, 1) * 4000
    straight = Response(np.array([0.0, 4000.0]), np.array([0.0, 1.0]), 0.0, np.array([0.0, 0.0]))
    found = fit_camera_noise(levels, exposures, straight)
    assert found.gain_e_per_dn == pytest.approx(FULL_WELL_E / 4000, rel=0.03)


def test_a_line_that_would_fall_below_nothing_near_black_does_not_rest_on_the_darkest_group() -> None:
    signals = np.concatenate([np.linspace(1, 8, 20), np.linspace(20, 180, 12)])
    variances = 0.012 * signals + np.where(signals < 10, 0.03, -0.1)
    found = fit_photon_transfer(TransferPoints(signals, variances, np.full(len(signals), 500.0)), rounds=3)
    assert 1 / found.gain_e_per_dn == pytest.approx(0.012, rel=0.4)
