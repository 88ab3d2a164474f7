"""The search for an exposure, and straight lines through a sweep."""

import numpy as np
import pytest

from calibration import CalibrationError
from calibration.radiometry.exposure import (
    ExposureAim,
    brightest_share,
    late_share,
    next_exposure,
    refuse_darkness,
    refuse_lateness,
)
from calibration.radiometry.linearity import fit_linearity

AIM = ExposureAim(share=0.85, accepted=(0.76, 0.9))
RANGE_S = (1e-4, 1.0)


def test_an_exposure_that_meets_the_aim_is_kept() -> None:
    assert next_exposure(0.01, 0.8, AIM, RANGE_S) is None
    assert next_exposure(0.01, 0.76, AIM, RANGE_S) is None


def test_a_dark_picture_is_exposed_longer_in_proportion() -> None:
    assert next_exposure(0.01, 0.17, AIM, RANGE_S) == pytest.approx(0.05)


def test_a_clipped_picture_says_only_that_it_is_too_bright() -> None:
    assert next_exposure(0.01, 0.99, AIM, RANGE_S) == pytest.approx(0.0025)


def test_no_light_is_not_exposed_infinitely() -> None:
    assert next_exposure(0.001, 0.0, AIM, RANGE_S) == pytest.approx(0.085)


def test_the_search_ends_where_the_camera_does() -> None:
    assert next_exposure(0.5, 0.01, AIM, RANGE_S) == 1.0
    assert next_exposure(1.0, 0.01, AIM, RANGE_S) is None
    assert next_exposure(1e-4, 1.0, AIM, RANGE_S) is None


@pytest.mark.parametrize("start_s", [1e-4, 3e-3, 0.9])
def test_the_rule_finds_the_exposure_of_a_straight_camera_in_a_few_tries(start_s: float) -> None:
    exposure_s, tries = start_s, 0
    while (chosen_s := next_exposure(exposure_s, min(exposure_s / 0.02, 1.0), AIM, RANGE_S)) is not None:
        exposure_s, tries = chosen_s, tries + 1
    assert AIM.met_by(exposure_s / 0.02)
    assert tries <= 6


def test_the_brightest_channel_counts_and_glints_do_not() -> None:
    pixels = np.full((100, 100, 3), 100, np.uint16)
    pixels[..., 1] = 2000
    pixels[0, :9] = 4095
    assert brightest_share(pixels, 4095) == pytest.approx(2000 / 4095)


def test_a_small_glare_may_clip_so_that_the_rest_can_be_decoded() -> None:
    pixels = np.full((100, 100, 1), 90, np.uint16)
    pixels[:2, :25] = 255
    assert brightest_share(pixels, 255) == pytest.approx(1.3 * 90 / 255)


def test_a_projector_whose_light_does_not_arrive_is_refused() -> None:
    black = np.full((20, 20, 1), 64, np.uint16)
    with pytest.raises(CalibrationError, match=r"only 10\.0 dn brighter.*the limit is 41 dn"):
        refuse_darkness(black + 10, black, full_scale_dn=4095, exposure_s=0.01)
    refuse_darkness(black + 100, black, full_scale_dn=4095, exposure_s=0.01)


def test_photographs_that_show_the_picture_before_are_refused_by_their_black() -> None:
    black = [np.full((20, 20, 1), 64 + swell, np.uint16) for swell in (3, 0, 1, 3)]
    white = np.full((20, 20, 1), 1064, np.uint16)
    refuse_lateness(late_share(black, white), "black", "white")
    late = late_share([black[0] + 500, *black[1:]], white)
    assert late == pytest.approx(0.5, abs=0.01)
    with pytest.raises(CalibrationError, match=r"black after white is still 50 % that of white.*Raise projector\.lat"):
        refuse_lateness(late, "black", "white")


def test_white_after_black_is_as_late_as_it_is_dark() -> None:
    black = np.full((20, 20, 1), 64, np.uint16)
    white = [black + light for light in (700, 1000, 1000, 1000)]
    assert late_share(white, black) == pytest.approx(0.3)
    assert late_share([black] * 4, black) == 0


def test_a_straight_line_has_no_residual_and_a_known_slope() -> None:
    times_s = np.arange(1.0, 9.0)
    line = fit_linearity(times_s, 300 * times_s + 5)
    assert (line.slope, line.intercept) == pytest.approx((300, 5))
    assert line.residual_share == pytest.approx(0, abs=1e-12)
    assert line.r_squared == pytest.approx(1)


def test_the_error_of_the_slope_is_that_of_many_repeats() -> None:
    random, times_s = np.random.default_rng(1), np.arange(20.0)
    fits = [fit_linearity(times_s, 10 * times_s + random.normal(0, 2, 20)) for _ in range(400)]
    assert np.mean([fit.slope_sigma for fit in fits]) == pytest.approx(np.std([fit.slope for fit in fits]), rel=0.1)


def test_a_curve_shows_as_residual() -> None:
    times_s = np.linspace(0.1, 1, 10)
    line = fit_linearity(times_s, times_s * 1.5 / (1 + 0.5 * times_s))
    assert 0.03 < line.residual_share < 0.1
    assert line.r_squared < 0.998
