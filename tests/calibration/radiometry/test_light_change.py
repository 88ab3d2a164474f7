"""Light that changes between exposures and between frames: told apart, and neither counted as measured more often."""

import numpy as np
import pytest

from calibration.radiometry.camera_response import fit_camera_response
from calibration.radiometry.light_change import ChangeSpread, likeliest_change
from calibration.radiometry.response import light_of_levels

TWICE = np.repeat(np.arange(300), 2)
EXPOSURES = np.repeat([1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 0.75, 1.0, 1.1], 2)


def drawn(shared: float, own: float, seed: int) -> np.ndarray:
    """Changes of two frames for each of 300 exposures."""
    random = np.random.default_rng(seed)
    return random.normal(0, shared, 300)[TWICE] + random.normal(0, own, len(TWICE))


@pytest.mark.parametrize(("shared", "own"), [(0.01, 0.002), (0.002, 0.01), (0.0, 0.003)])
def test_what_exposures_share_is_told_from_what_is_a_frames_own(shared: float, own: float) -> None:
    change = drawn(shared, own, seed=4)
    found = likeliest_change(np.outer(change, change), TWICE)
    assert found.own == pytest.approx(own, rel=0.1)
    assert found.shared == pytest.approx(shared, rel=0.2, abs=0.0012)


def test_without_repeats_all_of_it_is_a_frames_own() -> None:
    change = drawn(0.01, 0.002, seed=5)[::2]
    found = likeliest_change(np.outer(change, change), np.arange(300))
    assert found.shared == 0
    assert found.own == pytest.approx(np.hypot(0.01, 0.002), rel=0.1)


def test_a_repeat_of_an_exposure_says_nothing_new_of_what_both_share() -> None:
    pair = np.array([0, 0])
    once = np.linalg.inv(ChangeSpread(shared=0.01, own=1e-4).precision(pair))
    mean = np.full(2, 0.5)
    assert np.sqrt(mean @ once @ mean) == pytest.approx(0.01, rel=1e-3)


def off_by_the_same_in_both_frames(seed: int) -> np.ndarray:
    """(16, 3000) levels of a straight sensor whose exposures are 0.5 % off, the same in both frames of each."""
    random = np.random.default_rng(seed)
    real = EXPOSURES * np.repeat(1 + random.normal(0, 0.005, 8), 2)
    electrons = random.poisson(np.minimum(np.outer(real, random.uniform(0.05, 0.95, 3000)), 1.0) * 30000)
    return np.minimum(np.rint(electrons * 4000 / 30000), 4000)


def test_the_curves_stated_error_holds_where_exposures_are_off_alike_in_all_their_frames() -> None:
    light = np.array([0.1, 0.3, 0.6])
    scores = []
    for seed in range(16):
        response = fit_camera_response(off_by_the_same_in_both_frames(seed), EXPOSURES, 4000)
        assert response.sigma is not None
        at = 4000 * light
        scores.append((light_of_levels(response, at) - light) / np.interp(at, response.levels, response.sigma))
    size = np.sqrt(np.mean(np.square(scores)))
    assert 0.4 < size < 1.3  # 1.8 where each frame counts as a measurement of its own
    assert (np.abs(scores) < 3).mean() > 0.95
