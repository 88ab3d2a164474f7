"""Frames that no good camera takes: a curve that is right, or a refusal in words; never a warning, a crash or a NaN."""

import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.radiometry.black_level import fit_black_level
from calibration.radiometry.camera_response import LightBesides, fit_camera_response
from calibration.radiometry.mixing import fit_mixing
from calibration.radiometry.pattern_response import fit_pattern_response, sinusoid_terms
from calibration.radiometry.photon_transfer import fit_camera_noise

STOPS = [0.125, 0.25, 0.5, 1.0, 1.0, 2.0, 4.0, 8.0]


def swept(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Frames of black and of white (F, 2, N) at some exposures, of any sensor in any light, and its full scale."""
    full = 2.0 ** rng.integers(6, 17) - 1
    n, stops = int(rng.choice([1, 10, 300, 3000])), rng.choice(STOPS, int(rng.integers(2, 9)), replace=False)
    exposures = np.repeat(np.sort(stops), 2) * 10 ** rng.uniform(-4, 0)
    light = np.exp(rng.normal(size=n)) * 10 ** rng.uniform(-2, 2) / exposures.max() * (rng.random() > 0.1)
    gamma, well, room = rng.choice([1, 1, 0.45, 2.2]), 10 ** rng.uniform(2, 5), rng.choice([0, 0.01, 0.3])
    offset, read = rng.choice([0, 0.01, 0.1, 1.0]) * full, rng.choice([0, 1, 10])

    def frame(light: np.ndarray, exposure: float) -> np.ndarray:
        electrons = rng.poisson(np.clip(light * exposure * well, 0, 1e8)) + read * rng.normal(size=n)
        return np.clip(np.round(np.clip(electrons / well, 0, 1) ** gamma * (full - offset) + offset), 0, full)

    dark, lit = (np.array([[frame(share * light, e) for _ in (0, 1)] for e in exposures]) for share in (room, 1 + room))
    return dark, lit, exposures, full


def test_a_sensor_of_any_kind_has_a_rising_curve_or_is_refused_in_words() -> None:
    refused, sensors = 0, 100
    for seed in range(sensors):
        dark, lit, exposures, full = swept(np.random.default_rng(seed))
        try:
            black = fit_black_level(dark.mean(axis=1), exposures)
            room = LightBesides(dark=dark[-1].mean(axis=0) - black.offset_dn, in_step=black.in_step)
            above = lit - black.offset_dn
            mean, top = above.mean(axis=1), full - black.offset_dn
            curve = fit_camera_response(mean, exposures, top, black_dn=black.offset_dn, room=room)
            noise = fit_camera_noise(above[:, 0], exposures, curve)
        except CalibrationError:
            refused += 1
            continue
        assert (np.diff(curve.linear) > 0).all()
        assert np.isfinite([noise.gain_e_per_dn, noise.read_noise_dn]).all()
    assert refused < 0.95 * sensors


def test_black_where_the_sensor_clips_is_named() -> None:
    with pytest.raises(CalibrationError, match="black is where it clips"):
        fit_camera_response(np.zeros((4, 100)), [1, 2, 3, 4], 0.0)


def test_a_curve_without_any_error_leaves_nothing() -> None:
    terms = sinusoid_terms(np.arange(6))
    for seed in range(20):
        rng = np.random.default_rng(seed)
        mean, cosine, sine = rng.uniform(0.3, 0.6, 80), *(0.1 * rng.normal(size=(2, 80)))
        assert 0 <= fit_pattern_response(terms @ np.array([mean, cosine, sine]), terms, 1.0).rms < 1e-3


def test_pixels_that_one_band_does_not_see_do_not_tell_how_colours_mix() -> None:
    white = np.random.default_rng(0).uniform(0.3, 0.9, (60, 60, 3))
    white[:30, :, 2] = 0
    shares = np.array([[0.9, 0.08, 0.02], [0.05, 0.9, 0.05], [0.02, 0.08, 0.9]])
    found = fit_mixing(white, [white * share for share in shares.T], np.ones((60, 60), dtype=bool))
    np.testing.assert_allclose(found.matrix, shares, atol=1e-9)
    with pytest.raises(CalibrationError, match="0 lit pixels"):
        fit_mixing(white * [1, 1, 0], [white * share for share in shares.T], np.ones((60, 60), dtype=bool))
