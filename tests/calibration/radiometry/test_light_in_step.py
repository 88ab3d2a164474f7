"""Room light that runs in step with the camera adds the same to every frame, and passes for the camera's black."""

import numpy as np
import pytest

from calibration.arrays import FloatArray
from calibration.radiometry.black_level import fit_black_level
from calibration.radiometry.camera_response import fit_camera_response
from calibration.radiometry.response import light_of_levels

EXPOSURES_S = 0.0864 * np.array([1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 0.75, 1.0, 1.1])
BLACK_DN, FULL_DN = 120.0, 3970.0
ROOM_DN_PER_S, SWELL, SWELL_HZ = 3100.0, 0.09, 100.0
BEGUN_RAD = 0.2
"""Of the light's swell, at the start of every frame."""


def room_light_dn(exposures_s: FloatArray, begun_rad: float = BEGUN_RAD) -> FloatArray:
    """Integral of a light that swells, of frames that begin at one phase of it."""
    turns = 2 * np.pi * SWELL_HZ
    swell = (np.cos(begun_rad) - np.cos(begun_rad + turns * exposures_s)) / turns
    return np.asarray(ROOM_DN_PER_S * (exposures_s + SWELL * swell))


def frames(light_dn: FloatArray, seed: int) -> FloatArray:
    """Whole numbers of a straight camera of 12 bits: light beside the room's, noise, black."""
    random = np.random.default_rng(seed)
    return np.rint(BLACK_DN + light_dn + random.normal(0, 2.0, light_dn.shape))


def test_the_black_level_says_that_light_in_step_may_be_in_it() -> None:
    levels = frames(np.repeat(room_light_dn(EXPOSURES_S)[:, None], 3000, axis=1), seed=2)
    black = fit_black_level(levels, EXPOSURES_S)
    assert black.in_step_dn > 0.2
    assert abs(black.offset_dn - BLACK_DN) < 2 * black.sigma_dn < 2.0


def test_without_light_on_black_nothing_is_in_step() -> None:
    levels = frames(np.zeros((8, 3000)), seed=3)
    assert fit_black_level(levels, EXPOSURES_S).sigma_dn < 0.05


@pytest.mark.parametrize("seed", [7, 8, 9])
def test_steady_room_light_is_seen_to_be_steady_and_costs_black_nothing(seed: int) -> None:
    levels = frames(np.repeat(ROOM_DN_PER_S * EXPOSURES_S[:, None], 3000, axis=1), seed)
    black = fit_black_level(levels, EXPOSURES_S)
    swell_of_a_tenth_dn = ROOM_DN_PER_S * 0.1 / (2 * np.pi * SWELL_HZ)
    assert max(black.sigma_dn, black.in_step_dn) < 0.5 * swell_of_a_tenth_dn
    assert abs(black.offset_dn - BLACK_DN) < 3 * black.sigma_dn


def test_exposures_of_whole_periods_have_no_swell_in_them() -> None:
    whole_s = np.array([0.05, 0.1, 0.15, 0.2])
    black = fit_black_level(frames(np.repeat(room_light_dn(whole_s)[:, None], 3000, axis=1), seed=10), whole_s)
    assert black.in_step_dn > 0.2
    assert abs(black.offset_dn - BLACK_DN) < 3 * black.sigma_dn < 1.0


@pytest.mark.parametrize("begun_rad", [0.0, 1.0, 2.0, 3.0, 4.0, 5.0])
def test_the_phase_at_which_frames_begin_does_not_matter(begun_rad: float) -> None:
    light = room_light_dn(EXPOSURES_S, begun_rad)
    black = fit_black_level(frames(np.repeat(light[:, None], 3000, axis=1), seed=11), EXPOSURES_S)
    assert abs(black.offset_dn - BLACK_DN) < 3 * black.sigma_dn


@pytest.mark.parametrize("seed", [4, 5, 6])
def test_frames_of_white_cannot_tell_black_better_than_frames_of_black(seed: int) -> None:
    room = room_light_dn(EXPOSURES_S)
    black = fit_black_level(frames(np.repeat(room[:, None], 3000, axis=1), seed), EXPOSURES_S)
    times = np.repeat(EXPOSURES_S, 2)
    projected = np.outer(times / EXPOSURES_S[-2], FULL_DN * np.random.default_rng(seed).uniform(0.02, 0.8, 4000))
    levels = np.minimum(frames(projected + np.repeat(room, 2)[:, None], seed + 10), BLACK_DN + FULL_DN)
    response = fit_camera_response(
        levels - black.offset_dn,
        times,
        FULL_DN,
        black_sigma_dn=black.sigma_dn,
        least_black_sigma_dn=black.in_step_dn,
    )
    assert response.sigma is not None
    weak = np.array([0.01, 0.02, 0.05])
    at = FULL_DN * weak + BLACK_DN - black.offset_dn
    error = light_of_levels(response, at) - weak
    assert (np.abs(error) < 3 * np.interp(at, response.levels, response.sigma)).all()
