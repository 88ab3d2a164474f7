"""Room light in step with the camera adds the same to every frame: it passes for black, and for a bent curve."""

import numpy as np
import pytest

from calibration.arrays import FloatArray
from calibration.radiometry.black_level import fit_black_level
from calibration.radiometry.camera_response import fit_camera_response
from calibration.radiometry.light_groups import LightBesides
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
    assert abs(black.offset_dn - BLACK_DN) < 2 * black.sigma_dn < 2.0


def test_without_light_on_black_nothing_is_in_step() -> None:
    levels = frames(np.zeros((8, 3000)), seed=3)
    assert fit_black_level(levels, EXPOSURES_S).sigma_dn < 0.05


@pytest.mark.parametrize("seed", [7, 8, 9])
def test_steady_room_light_is_seen_to_be_steady_and_costs_black_nothing(seed: int) -> None:
    levels = frames(np.repeat(ROOM_DN_PER_S * EXPOSURES_S[:, None], 3000, axis=1), seed)
    black = fit_black_level(levels, EXPOSURES_S)
    swell_of_a_tenth_dn = ROOM_DN_PER_S * 0.1 / (2 * np.pi * SWELL_HZ)
    assert black.sigma_dn < 0.5 * swell_of_a_tenth_dn
    assert np.abs(black.in_step.swell).max() < 0.5
    assert abs(black.offset_dn - BLACK_DN) < 3 * black.sigma_dn


def test_exposures_of_whole_periods_have_no_swell_in_them() -> None:
    whole_s = np.array([0.05, 0.1, 0.15, 0.2])
    black = fit_black_level(frames(np.repeat(room_light_dn(whole_s)[:, None], 3000, axis=1), seed=10), whole_s)
    assert abs(black.offset_dn - BLACK_DN) < 3 * black.sigma_dn < 1.0
    assert np.diag(black.in_step.covariance)[1:].min() > 0.5


@pytest.mark.parametrize("begun_rad", [0.0, 1.0, 2.0, 3.0, 4.0, 5.0])
def test_the_phase_at_which_frames_begin_does_not_matter(begun_rad: float) -> None:
    light = room_light_dn(EXPOSURES_S, begun_rad)
    black = fit_black_level(frames(np.repeat(light[:, None], 3000, axis=1), seed=11), EXPOSURES_S)
    assert abs(black.offset_dn - BLACK_DN) < 3 * black.sigma_dn


@pytest.mark.parametrize("seed", [4, 5, 6])
def test_weak_light_is_right_where_frames_of_white_have_the_same_swell(seed: int) -> None:
    room = room_light_dn(EXPOSURES_S)
    black = fit_black_level(frames(np.repeat(room[:, None], 3000, axis=1), seed), EXPOSURES_S)
    times = np.repeat(EXPOSURES_S, 2)
    projected = np.outer(times / EXPOSURES_S[-2], FULL_DN * np.random.default_rng(seed).uniform(0.02, 0.8, 4000))
    levels = np.minimum(frames(projected + np.repeat(room, 2)[:, None], seed + 10), BLACK_DN + FULL_DN)
    dark = np.full(4000, room[-1] + BLACK_DN - black.offset_dn)
    response = fit_camera_response(
        levels - black.offset_dn, times, FULL_DN, room=LightBesides(dark=dark, in_step=black.in_step)
    )
    assert response.sigma is not None
    weak = np.array([0.01, 0.02, 0.05])
    at = FULL_DN * weak + BLACK_DN - black.offset_dn
    error = light_of_levels(response, at) - weak
    assert (np.abs(error) < 3 * np.interp(at, response.levels, response.sigma)).all()


SHORT_S = 0.007 * np.array([1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 0.75, 1.0, 1.1])
"""Exposures that end before a swell of 120 Hz has."""


def swelling_dn(seconds: FloatArray, begun_rad: float) -> FloatArray:
    """Room light of 1 dn a second that swells by a tenth at 120 Hz."""
    turns = 2 * np.pi * 120.0
    return np.asarray(seconds + 0.1 * (np.cos(begun_rad) - np.cos(begun_rad + turns * seconds)) / turns)


@pytest.mark.parametrize(("begun_rad", "bent"), [(1.6, 0.0), (0.4, 0.08), (3.0, 0.08), (4.7, 0.0)])
def test_a_curve_is_not_bent_by_room_light_that_swells_while_exposures_grow(begun_rad: float, bent: float) -> None:
    random = np.random.default_rng(5)
    shown = FULL_DN * random.uniform(0.02, 0.75, 4000) ** 2 / 0.75
    room = FULL_DN / SHORT_S[-2] * random.uniform(0.02, 0.06, 4000)

    def photographed(seconds: FloatArray, white: float) -> FloatArray:
        light = (
            np.outer(seconds / SHORT_S[-2], white * shown) + np.outer(swelling_dn(seconds, begun_rad), room)
        ) / FULL_DN
        return np.minimum(
            np.rint(BLACK_DN + FULL_DN * light * (1 + bent) / (1 + bent * light) + random.normal(0, 3.0, light.shape)),
            BLACK_DN + FULL_DN,
        )

    darkness = photographed(SHORT_S, 0.0)
    black = fit_black_level(darkness, SHORT_S)
    times = np.repeat(SHORT_S, 2)
    levels = photographed(times, 1.0) - black.offset_dn
    told = LightBesides(dark=darkness[-1] - black.offset_dn, in_step=black.in_step)
    response = fit_camera_response(levels, times, FULL_DN, room=told)
    assert response.sigma is not None
    light = np.array([0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8])
    at = FULL_DN * light * (1 + bent) / (1 + bent * light) + BLACK_DN - black.offset_dn
    error = light_of_levels(response, at) - light
    assert (np.abs(error) < 3 * np.interp(at, response.levels, response.sigma)).all()
    assert np.abs(error).max() < 0.001
