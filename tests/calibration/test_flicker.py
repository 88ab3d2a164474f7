"""Room light that swells with the mains: seen in frames of darkness, and left out by exposures of whole periods."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.radiometry.flicker import is_third, room_light_hz, swell_of_means, whole_periods

FULL_SCALE_DN, EXPOSURE_S = 4095.0, 0.013
SHAPE = (60, 80, 1)


def dark_frames(hz, swell_dn, *, rate_hz=30.0, noise_dn=3.0, slope_dn=0.0):
    """Eight frames that one after the other are shot without any being lost."""
    random = np.random.default_rng(5)
    middles_s = np.arange(8) / rate_hz + EXPOSURE_S / 2 + 0.0021
    light = 200 + swell_dn * np.sin(2 * np.pi * hz * middles_s) + slope_dn * np.arange(8)
    return [random.normal(level, noise_dn, SHAPE) for level in light], middles_s


@pytest.mark.parametrize(("hz", "rate_hz"), [(100.0, 30.0), (100.0, 59.94), (120.0, 25.0), (120.0, 29.0)])
def test_a_swelling_lamp_is_found_with_its_frequency(hz, rate_hz):
    assert room_light_hz(*dark_frames(hz, 4.0, rate_hz=rate_hz), FULL_SCALE_DN) == hz


@pytest.mark.parametrize(
    "frames",
    [
        dark_frames(100.0, 0.0),
        dark_frames(100.0, 0.05),
        dark_frames(120.0, 4.0, rate_hz=30.0),
        dark_frames(100.0, 0.0, slope_dn=2.0),
    ],
    ids=["still", "less than noise", "at one phase in all frames", "daylight that grows"],
)
def test_what_does_not_swell_in_the_frames_is_no_lamp(frames):
    assert room_light_hz(*frames, FULL_SCALE_DN) is None


@pytest.mark.parametrize(
    ("wanted_s", "hz", "chosen_s"),
    [(0.0234, 100.0, 0.02), (0.0298, 100.0, 0.03), (0.0298, 120.0, 0.025), (0.009, 100.0, None), (0.01, 100.0, 0.01)],
)
def test_an_exposure_holds_as_many_whole_periods_as_white_allows(wanted_s, hz, chosen_s):
    found = whole_periods(wanted_s, hz, (1e-4, 2.0))
    assert found == (chosen_s if chosen_s is None else pytest.approx(chosen_s))


def test_an_exposure_that_the_camera_cannot_do_is_not_chosen():
    assert whole_periods(0.0234, 100.0, (1e-4, 0.015)) is None
    assert whole_periods(0.0234, 100.0, (0.021, 1.0)) is None


@pytest.mark.parametrize(("swell_hz", "rate_hz"), [(100.0, 30.0), (100.0, 59.94), (120.0, 25.0), (120.0, 29.0)])
def test_the_mean_of_three_photographs_a_third_of_a_period_apart_sees_no_swell(swell_hz, rate_hz):
    first_s, whole_frames = 0.0171, np.arange(40) / rate_hz
    middles_s = [first_s]
    for nth in (1, 2):
        late = next(t for t in middles_s[-1] + whole_frames[1:] if is_third(t, first_s, nth, swell_hz))
        middles_s.append(late)
    light = np.sin(2 * np.pi * swell_hz * np.array(middles_s))
    assert abs(light.mean()) < 0.2 * np.ptp(light)
    assert not is_third(middles_s[1], first_s, 2, swell_hz)


def test_frames_at_one_phase_are_no_thirds_of_a_period():
    assert not any(is_third(0.01 + k / 25, 0.01, 1, 100.0) for k in range(20))


def test_what_is_left_of_a_swell_is_told_by_means_of_three():
    thirds = np.array([10.0, 13.0, 8.0])
    assert swell_of_means(np.tile(thirds, 2)) == pytest.approx(0.0, abs=1e-9)
    assert swell_of_means(np.array([*thirds, 10.0, 13.0, 11.0])) == pytest.approx(1.0)
