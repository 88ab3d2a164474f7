"""A projector's codes become light and come back: curves of one channel and of three, dither, and their errors."""

import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.radiometry.response import (
    Response,
    codes_from_linear,
    fit_channel_responses,
    fit_projector_response,
    light_sigma,
    linear_from_codes,
)


def projector(codes: np.ndarray) -> np.ndarray:
    """Gamma 2.2 with an S-shape, as projectors' picture modes have it."""
    x = codes / 255.0
    bent = x + 0.25 * 0.3 * x * (1 - x) * (2 * x - 1)
    return bent**2.2


def test_three_channels_have_their_own_curves_out_of_grey_pictures() -> None:
    codes = np.unique(np.rint(np.linspace(0, 255, 17)).astype(int))
    light = np.stack([(codes / 255) ** gamma for gamma in (1.9, 2.2, 2.6)], axis=1)
    mixing = np.array([[0.8, 0.15, 0.05], [0.1, 0.8, 0.1], [0.05, 0.2, 0.75]])
    responses = fit_channel_responses(codes, light @ mixing.T, mixing)
    for response, gamma in zip(responses, (1.9, 2.2, 2.6), strict=True):
        every = np.arange(256, dtype=np.uint8)
        assert linear_from_codes(response, every) == pytest.approx((every / 255) ** gamma, abs=2e-3)


@pytest.mark.parametrize("count", [17, 33])
def test_the_projector_curve_is_right_between_the_measured_codes(count: int) -> None:
    rng = np.random.default_rng(6)
    codes = np.unique(np.rint(np.linspace(0, 255, count)).astype(int))
    measured = projector(codes) + rng.normal(0, 5e-4, len(codes))
    response = fit_projector_response(codes, measured)
    every = np.arange(256)
    error = linear_from_codes(response, every.astype(np.uint8)) - projector(every)
    assert np.abs(error).max() < 0.003
    assert (np.diff(response.linear) >= 0).all()
    assert response.linear[0] == 0
    assert response.linear[-1] == 1


def test_light_that_falls_while_codes_rise_is_refused() -> None:
    with pytest.raises(CalibrationError, match=r"the limit is 0\.02"):
        fit_projector_response([0, 64, 128, 255], [0, 0.5, 0.3, 1.0])


@pytest.fixture
def response() -> Response:
    codes = np.arange(0, 256, 15)
    return fit_projector_response(codes, projector(codes))


def test_codes_survive_the_way_to_light_and_back(response: Response) -> None:
    codes = np.arange(256, dtype=np.uint8).reshape(16, 16)
    assert np.array_equal(codes_from_linear(response, linear_from_codes(response, codes).astype(np.float64)), codes)


def test_without_dither_the_nearest_code_is_chosen(response: Response) -> None:
    light = np.linspace(0, 1, 1000)
    shown = linear_from_codes(response, codes_from_linear(response, light)).astype(np.float64)
    table = linear_from_codes(response, np.arange(256, dtype=np.uint8)).astype(np.float64)
    nearest = np.abs(table[None, :] - light[:, None]).min(axis=1)
    assert np.abs(shown - light) == pytest.approx(nearest, abs=1e-7)


def test_dither_makes_the_mean_right_and_repeats_with_its_seed(response: Response) -> None:
    light = np.full((300, 300), 0.00312)
    codes = codes_from_linear(response, light, dither_seed=2)
    assert linear_from_codes(response, codes).mean() == pytest.approx(0.00312, rel=2e-3)
    assert len(np.unique(codes)) == 2
    assert np.array_equal(codes, codes_from_linear(response, light, dither_seed=2))


def test_light_beyond_white_and_below_black_is_clipped(response: Response) -> None:
    assert codes_from_linear(response, np.array([-0.3, 1.7])).tolist() == [0, 255]


@pytest.mark.parametrize("gamma", [1.8, 2.2, 2.6])
@pytest.mark.parametrize("s_shape", [0.0, 0.4])
def test_a_projector_curve_is_off_between_its_codes_by_no_more_than_three_of_its_sigmas(gamma, s_shape):
    def light(codes):
        x = codes / 255
        return (1 - s_shape) * x**gamma + s_shape * x * x * (3 - 2 * x)

    codes = np.rint(np.linspace(0, 255, 9))
    found = fit_projector_response(codes, light(codes))
    error = np.abs(found.linear - light(np.arange(256)))
    assert (error <= 3 * found.sigma + 5e-4).all()
    assert found.sigma.max() < 0.006


def test_light_sigma_goes_between_the_curves_own_and_is_the_residual_where_it_has_none():
    known = Response(np.array([0.0, 1.0, 2.0]), np.array([0.0, 0.5, 1.0]), 0.01, np.array([0.0, 0.004, 0.002]))
    assert light_sigma(known, np.array([0.25, 0.75])) == pytest.approx([0.002, 0.003])
    unknown = Response(known.levels, known.linear, 0.01)
    assert light_sigma(unknown, np.array([0.25, 0.75])) == pytest.approx([0.01, 0.01])
