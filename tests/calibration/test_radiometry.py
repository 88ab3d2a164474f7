"""Response curves and noise from synthetic measurements that were not made with the fitted formulae."""

from collections.abc import Callable

import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.radiometry.black_level import fit_black_level
from calibration.radiometry.camera_response import fit_camera_response
from calibration.radiometry.pattern_response import fit_pattern_response, sinusoid_terms
from calibration.radiometry.photon_transfer import (
    fit_camera_noise,
    fit_photon_transfer,
    joined,
    linearised,
    transfer_points,
)
from calibration.radiometry.response import (
    Response,
    ideal_levels,
    ideal_slope,
    light_of_levels,
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


def test_the_unit_of_light_is_that_of_full_scale() -> None:
    first, second = exposed(exponential, SWEEP)
    response = fit_camera_response((first + second) / 2, SWEEP, FULL_SCALE_DN)
    assert (response.levels[-1], response.linear[-1]) == (FULL_SCALE_DN, 1)


def test_exposures_come_in_any_order_and_unit() -> None:
    first, second = exposed(hyperbolic, SWEEP)
    mean = (first + second) / 2
    straight = fit_camera_response(mean, SWEEP, FULL_SCALE_DN)
    turned = fit_camera_response(mean[::-1], 1000 * SWEEP[::-1], FULL_SCALE_DN)
    assert turned.linear == pytest.approx(straight.linear, abs=5e-4)


def test_a_sweep_without_usable_samples_is_refused() -> None:
    with pytest.raises(CalibrationError, match="0 groups of usable samples at 0 exposures"):
        fit_camera_response(np.full((3, 500), 2.0), [1, 2, 4], FULL_SCALE_DN)


def test_exposures_that_the_camera_did_not_make_are_noticed() -> None:
    first, _ = exposed(linear, SWEEP)
    with pytest.raises(CalibrationError, match=r"a gamma of 0\.2, cameras have 0\.33 to 3\.6: the exposures"):
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


def test_a_single_brightness_at_eight_exposures_tells_a_tone_curve_roughly() -> None:
    levels, exposures = swept(srgb), np.arange(1, 9)
    light = light_of_levels(fit_camera_response(levels, exposures, FULL_SCALE_DN), levels[:, 0])
    assert 8 * light / light[-1] == pytest.approx(exposures, rel=0.03)


def s_curve(x: np.ndarray) -> np.ndarray:
    """A power law with contrast added, as consumer cameras have it."""
    y = x ** (1 / 2.2)
    return 0.8 * y + 0.2 * y * y * (3 - 2 * y)


TONES: dict[str, Curve] = {
    "linear": linear,
    "compressed": hyperbolic,
    "srgb": srgb,
    "gamma 1.8": lambda x: x ** (1 / 1.8),
    "gamma 3": lambda x: x ** (1 / 3),
    "gamma 0.5": lambda x: x**2,
    "s": s_curve,
}
COARSE_FULL_WELL_E = 16000.0


def webcam(
    curve: Curve, *, seed: int, brightest: float = 0.85, unsteady: float = 0.005
) -> tuple[np.ndarray, np.ndarray]:
    """(16, 3000) digital numbers of 8 bits, black level 5, noise cut off below it, light that changes a little."""
    rng = np.random.default_rng(seed)
    exposures = np.repeat(SWEEP, 2)
    light = np.outer(exposures * (1 + unsteady * rng.normal(size=16)), brightest * rng.uniform(0.0, 0.9, 3000))
    electrons = rng.poisson(light * COARSE_FULL_WELL_E) + rng.normal(0, READ_NOISE_E, light.shape)
    return np.rint(5 + 250 * curve(np.clip(electrons / COARSE_FULL_WELL_E, 0, 1))), exposures


@pytest.mark.parametrize("name", TONES)
def test_any_tone_curve_of_eight_bits_is_undone_within_its_errors(name: str) -> None:
    curve = TONES[name]
    levels, exposures = webcam(curve, seed=len(name))
    response = fit_camera_response(levels - 5, exposures, 250, black_sigma_dn=0.3)
    light = np.linspace(0.03, 0.8, 30)
    at = 250 * curve(light)
    error = light_of_levels(response, at) - light
    assert np.abs(error).max() < 0.008
    assert response.sigma is not None
    sigma = np.interp(at, response.levels, response.sigma)
    assert sigma.max() < 0.01
    if name != "s":  # its bend near white lies beyond the brightest level
        assert (np.abs(error) < 3 * sigma).all()
    assert (np.diff(response.linear) > 0).all()


def test_the_stated_errors_of_the_curve_are_those_of_many_repeats() -> None:
    scores = []
    for seed in range(8):
        levels, exposures = webcam(TONES["gamma 1.8"], seed=seed, unsteady=0.01)
        response = fit_camera_response(levels - 5, exposures, 250, black_sigma_dn=0.3)
        light = np.array([0.05, 0.2, 0.5])
        at = 250 * light ** (1 / 1.8)
        assert response.sigma is not None
        scores.append((light_of_levels(response, at) - light) / np.interp(at, response.levels, response.sigma))
    assert (np.abs(scores) < 3).all()
    assert np.sqrt(np.mean(np.square(scores))) > 0.4


def test_a_tone_curve_that_moves_between_exposures_is_what_is_said() -> None:
    levels, exposures = webcam(linear, seed=1)
    share = (levels - 5) / 250
    gamma = np.where(np.arange(16) % 4 < 2, 1.0, 2.2)[:, None]
    with pytest.raises(CalibrationError, match="tone curve moves from frame to frame"):
        fit_camera_response(250 * np.maximum(share, 0) ** (1 / gamma), exposures, 250)


def test_light_that_jumps_between_exposures_is_what_is_said() -> None:
    levels, exposures = webcam(linear, seed=1, unsteady=0.3)
    with pytest.raises(CalibrationError, match=r"light changes by \d+ % .* automatic exposure"):
        fit_camera_response(levels - 5, exposures, 250)


@pytest.mark.parametrize("name", ["linear", "srgb", "gamma 3"])
def test_noise_is_judged_after_the_curve_is_undone(name: str) -> None:
    levels, exposures = webcam(TONES[name], seed=2, unsteady=0)
    response = fit_camera_response(levels - 5, exposures, 250, black_sigma_dn=0.3)
    noise = fit_camera_noise(levels - 5, exposures, response)
    assert noise.gain_e_per_dn == pytest.approx(COARSE_FULL_WELL_E / 250, rel=0.05)
    assert abs(noise.gain_e_per_dn - COARSE_FULL_WELL_E / 250) < 4 * noise.gain_sigma_e_per_dn
    assert noise.read_noise_e < 3 * READ_NOISE_E


def test_noise_needs_frames_of_equal_exposure() -> None:
    levels, exposures = webcam(linear, seed=2)
    response = fit_camera_response(levels - 5, exposures, 250)
    with pytest.raises(CalibrationError, match="0 groups of pixels"):
        fit_camera_noise(levels[::2] - 5, exposures[::2], response)


def test_rounding_is_taken_out_where_noise_is_smaller_than_a_step() -> None:
    rng = np.random.default_rng(8)
    light = rng.uniform(10, 240, 400_000)
    sigma = np.sqrt(light / 3000)
    first, second = (np.rint(light + sigma * rng.normal(size=light.size)) for _ in range(2))
    straight = Response(np.array([0.0, 255.0]), np.array([0.0, 1.0]), 0.0)
    points = linearised(transfer_points(first, second), straight)
    assert fit_photon_transfer(points).gain_e_per_dn == pytest.approx(3000, rel=0.05)


def test_the_black_level_is_that_at_exposure_0() -> None:
    rng = np.random.default_rng(3)
    levels = np.rint(64 + 40 * SWEEP[:, None] * rng.uniform(0, 1, 2000) + rng.normal(0, 1.5, (8, 2000)))
    black = fit_black_level(levels, SWEEP)
    assert not black.is_clipped
    assert abs(black.offset_dn - 64) < 3 * black.sigma_dn < 0.5


def test_the_black_level_of_a_camera_that_cuts_noise_off_is_its_lowest() -> None:
    rng = np.random.default_rng(3)
    share = np.maximum(rng.normal(0, 4e-4, (8, 2000)) + 2e-4 * SWEEP[:, None], 0)
    black = fit_black_level(np.rint(5 + 250 * share ** (1 / 2.2)), SWEEP)
    assert black.is_clipped
    assert black.offset_dn == 5


@pytest.mark.parametrize("name", ["linear", "srgb", "gamma 3", "gamma 0.5", "s"])
def test_sinusoids_alone_tell_the_response(name: str) -> None:
    rng = np.random.default_rng(4)
    shifts, phase, albedo = 2 * np.pi * np.arange(6) / 6, rng.uniform(0, 2 * np.pi, 2000), rng.uniform(0.3, 0.95, 2000)
    light = 0.02 + albedo * (0.5 + 0.48 * np.cos(phase + shifts[:, None]))
    levels = np.rint(255 * TONES[name](np.clip(rng.poisson(8000 * light) / 8000, 0, 1)))
    response = fit_pattern_response(levels, sinusoid_terms(shifts), 255)
    judged = np.linspace(0.05, 0.93, 50)
    found = np.interp(255 * TONES[name](judged), response.levels, response.linear)
    error = np.polyval(np.polyfit(found, judged, 1), found) - judged
    assert np.abs(error).max() < 0.02


def test_known_patterns_of_any_kind_tell_the_response() -> None:
    rng = np.random.default_rng(4)
    shown, albedo = rng.uniform(0, 1, (6, 2000)), rng.uniform(0.3, 0.95, 2000)
    levels = np.rint(255 * srgb(0.03 + albedo * shown))
    response = fit_pattern_response(levels, np.stack([np.ones_like(shown), shown], axis=-1), 255)
    judged = np.linspace(0.05, 0.93, 50)
    found = np.interp(255 * srgb(judged), response.levels, response.linear)
    assert np.polyval(np.polyfit(found, judged, 1), found) == pytest.approx(judged, abs=0.02)


def test_patterns_that_tell_nothing_are_refused_and_named() -> None:
    rng = np.random.default_rng(4)
    levels, shown = rng.uniform(0, 255, (6, 500)), rng.uniform(0, 1, (6, 500))
    known = np.stack([np.ones_like(shown), shown], axis=-1)
    with pytest.raises(CalibrationError, match="not the patterns they are called"):
        fit_pattern_response(levels, known, 255)
    with pytest.raises(CalibrationError, match="3 pictures and 3 terms"):
        fit_pattern_response(levels[:3], sinusoid_terms([0, 2, 4]), 255)
    with pytest.raises(CalibrationError, match="at least 0"):
        fit_pattern_response(levels / 255, known, 255)


def test_an_ideal_camera_keeps_0_and_full_scale() -> None:
    first, second = exposed(hyperbolic, SWEEP)
    response = fit_camera_response((first + second) / 2, SWEEP, FULL_SCALE_DN)
    assert ideal_levels(response, np.array([0.0, FULL_SCALE_DN])) == pytest.approx([0, FULL_SCALE_DN], abs=0.05)
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
