"""Response curves and noise from synthetic measurements that were not made with the fitted formulae."""

from collections.abc import Callable

import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.radiometry.photon_transfer import fit_photon_transfer, joined, linearised, transfer_points
from calibration.radiometry.response import (
    Response,
    codes_from_linear,
    fit_camera_response,
    fit_channel_responses,
    fit_projector_response,
    ideal_levels,
    ideal_slope,
    light_of_levels,
    linear_from_codes,
)

FULL_SCALE_DN = 4031.0
FULL_WELL_E = 32000.0
READ_NOISE_E = 6.0
SWEEP = np.array([1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 0.75, 1.0, 1.1])
Curve = Callable[[np.ndarray], np.ndarray]


def linear(x: np.ndarray) -> np.ndarray:
    return x


def exponential(x: np.ndarray) -> np.ndarray:
    """A sensor that saturates softly."""
    return (1 - np.exp(-0.25 * x)) / (1 - np.exp(-0.25))


def hyperbolic(x: np.ndarray) -> np.ndarray:
    return 1.1 * x / (1 + 0.1 * x)


def expanding(x: np.ndarray) -> np.ndarray:
    return np.sinh(0.6 * x) / np.sinh(0.6)


def exposed(curve: Curve, exposures: np.ndarray, n: int = 4000, seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Two frames (K, N) above black: all brightnesses, with shot noise, read noise and rounding."""
    rng = np.random.default_rng(seed)
    brightness = rng.uniform(0.05, 0.95, n)
    light = np.minimum(np.outer(exposures, brightness), 1.0)
    electrons = rng.poisson(light * FULL_WELL_E, (2, *light.shape)) + rng.normal(0, READ_NOISE_E, (2, *light.shape))
    levels = np.rint(FULL_SCALE_DN * curve(np.clip(electrons / FULL_WELL_E, 0, None)))
    return levels[0], np.minimum(levels[1], FULL_SCALE_DN)


@pytest.mark.parametrize("curve", [linear, exponential, hyperbolic, expanding])
def test_the_camera_curve_makes_levels_proportional_to_light(curve: Curve) -> None:
    first, second = exposed(curve, SWEEP)
    response = fit_camera_response(np.minimum((first + second) / 2, FULL_SCALE_DN), SWEEP, FULL_SCALE_DN)
    light = np.linspace(0.01, 0.95, 200)
    found = np.interp(FULL_SCALE_DN * curve(light), response.levels, response.linear)
    scale = np.sum(found * light) / np.sum(light**2)
    assert np.abs(found / scale - light).max() < 0.003
    assert response.rms < 0.01


def test_the_unit_of_light_is_that_of_weak_light() -> None:
    first, second = exposed(exponential, SWEEP)
    response = fit_camera_response((first + second) / 2, SWEEP, FULL_SCALE_DN)
    slope = response.linear[1] / (response.levels[1] / FULL_SCALE_DN)
    assert slope == pytest.approx(1, abs=0.01)


def test_exposures_come_in_any_order_and_unit() -> None:
    first, second = exposed(hyperbolic, SWEEP)
    mean = (first + second) / 2
    straight = fit_camera_response(mean, SWEEP, FULL_SCALE_DN)
    turned = fit_camera_response(mean[::-1], 1000 * SWEEP[::-1], FULL_SCALE_DN)
    assert turned.linear == pytest.approx(straight.linear, abs=2e-4)


def test_a_sweep_without_usable_samples_is_refused() -> None:
    with pytest.raises(CalibrationError, match="0 pairs of usable samples, at least 100"):
        fit_camera_response(np.full((3, 500), 2.0), [1, 2, 4], FULL_SCALE_DN)


def test_exposures_that_the_camera_did_not_make_are_noticed() -> None:
    first, _ = exposed(linear, SWEEP)
    with pytest.raises(CalibrationError, match="does not rise"):
        fit_camera_response(first, SWEEP**0.2, FULL_SCALE_DN)


@pytest.mark.parametrize("rounds", [0, 5])
def test_gain_and_read_noise_come_from_two_frames_of_the_same_light(rounds: int) -> None:
    first, second = exposed(linear, SWEEP, n=40000)
    noise = fit_photon_transfer(transfer_points(first, second, range_dn=(0, 0.9 * FULL_SCALE_DN)), rounds=rounds)
    assert noise.gain_e_per_dn == pytest.approx(FULL_WELL_E / FULL_SCALE_DN, rel=0.02)
    # Rounding adds 1/12 dn² to each frame.
    expected_dn = np.sqrt((READ_NOISE_E * FULL_SCALE_DN / FULL_WELL_E) ** 2 + 1 / 12)
    assert noise.read_noise_dn == pytest.approx(expected_dn, abs=0.35)


def test_the_stated_error_of_the_gain_is_that_of_many_repeats() -> None:
    fits = [fit_photon_transfer(transfer_points(*exposed(linear, SWEEP, seed=seed))) for seed in range(12)]
    errors = [abs(fit.gain_e_per_dn - FULL_WELL_E / FULL_SCALE_DN) / fit.gain_sigma_e_per_dn for fit in fits]
    assert max(errors) < 4
    assert np.mean([fit.chi2 for fit in fits]) < 3


@pytest.mark.parametrize("curve", [exponential, hyperbolic, expanding])
def test_a_curve_and_rounding_are_taken_out_of_the_photon_transfer(curve: Curve) -> None:
    first, second = exposed(curve, SWEEP, n=40000)
    response = fit_camera_response((first + second) / 2, SWEEP, FULL_SCALE_DN)
    points = transfer_points(first, second, range_dn=(-np.inf, 0.9 * FULL_SCALE_DN))
    transfer = fit_photon_transfer(linearised(points, response))
    assert transfer.gain_e_per_dn == pytest.approx(FULL_WELL_E / FULL_SCALE_DN, rel=0.03)
    assert transfer.read_noise_e == pytest.approx(READ_NOISE_E, rel=0.05)
    assert transfer.chi2 < 1
    assert fit_photon_transfer(points).chi2 > 3


def test_groups_of_several_pairs_count_as_one() -> None:
    first, second = exposed(linear, SWEEP)
    parts = [transfer_points(a, b, bins=4) for a, b in zip(first, second, strict=True)]
    assert joined(parts).signals.tolist() == [signal for part in parts for signal in part.signals]
    assert len(joined([]).signals) == 0


def swept(curve: Curve) -> np.ndarray:
    """(8, 200) levels of one brightness at eight exposures."""
    return FULL_SCALE_DN * np.outer(curve(0.8 * np.arange(1, 9) / 8), np.ones(200))


def srgb(x: np.ndarray) -> np.ndarray:
    return np.where(x < 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def test_the_curve_of_a_camera_that_encodes_srgb_is_undone() -> None:
    levels, exposures = swept(srgb), np.arange(1, 9)
    light = light_of_levels(fit_camera_response(levels, exposures, FULL_SCALE_DN), levels[:, 0])
    assert 8 * light / light[-1] == pytest.approx(exposures, rel=1e-3)


def test_a_gamma_without_any_slope_at_zero_is_refused_and_named() -> None:
    with pytest.raises(CalibrationError, match="gamma"):
        fit_camera_response(swept(lambda x: x ** (1 / 2.2)), np.arange(1, 9), FULL_SCALE_DN)


def test_an_ideal_camera_keeps_0_and_full_scale() -> None:
    first, second = exposed(hyperbolic, SWEEP)
    response = fit_camera_response((first + second) / 2, SWEEP, FULL_SCALE_DN)
    assert ideal_levels(response, np.array([0.0, FULL_SCALE_DN])) == pytest.approx([0, FULL_SCALE_DN])
    levels = np.linspace(10, 3900, 50)
    slope = (ideal_levels(response, levels + 1) - ideal_levels(response, levels - 1)) / 2
    assert ideal_slope(response, levels) == pytest.approx(slope, rel=0.01)
    assert ideal_levels(response, np.array([-20.0])) == pytest.approx(
        -20 * ideal_slope(response, np.array([0.0])), rel=0.01
    )


def test_frames_without_shot_noise_are_named() -> None:
    rng = np.random.default_rng(4)
    light = rng.uniform(100, 3000, (1, 20000))
    frames = light + rng.normal(size=(2, *light.shape)) * (5 - light / 1000)
    with pytest.raises(CalibrationError, match="noise does not grow"):
        fit_photon_transfer(transfer_points(frames[0], frames[1], range_dn=(0, 3900)))


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
