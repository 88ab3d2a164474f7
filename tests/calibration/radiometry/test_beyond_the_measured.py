"""What is said of a camera's curve between the brightest level that was measured and full scale."""

import numpy as np
import pytest

from calibration.arrays import FloatArray
from calibration.radiometry.camera_response import fit_camera_response
from calibration.radiometry.light_groups import grouped_by_light
from calibration.radiometry.response import light_of_levels

SWEEP = np.repeat([1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 0.75, 1.0, 1.1], 2)
FULL_WELL_E = 14600.0
GAMMA, COMPRESSION = 2.4, 0.06


def toned(light: FloatArray) -> FloatArray:
    """A sensor that saturates a little, behind a power law."""
    return np.asarray((light * (1 + COMPRESSION) / (1 + COMPRESSION * light)) ** (1 / GAMMA))


def frames(brightness: FloatArray, seed: int) -> FloatArray:
    """(16, N) levels of 8 bits above a black level that is known to a tenth."""
    random = np.random.default_rng(seed)
    light = np.minimum(np.outer(SWEEP, brightness), 1.2)
    electrons = random.poisson(light * FULL_WELL_E) + random.normal(0, 4.0, light.shape)
    return np.rint(5 + 250 * np.minimum(toned(np.maximum(electrons / FULL_WELL_E, 0)), 1.0)) - 5.0


@pytest.mark.parametrize("brightest", [0.12, 0.25, 0.5])
def test_the_stated_errors_grow_with_what_was_not_measured(brightest: float) -> None:
    light = np.array([0.05, 0.1, 0.3, 0.6, 0.9])
    scores = []
    for seed in range(4):
        levels = frames(brightest * np.random.default_rng([seed, 1]).uniform(0.05, 1.0, 6000), seed)
        response = fit_camera_response(levels, SWEEP, 250.0, black_sigma_dn=0.1)
        at = 250 * toned(light)
        assert response.sigma is not None
        scores.append((light_of_levels(response, at) - light) / np.interp(at, response.levels, response.sigma))
    assert np.abs(scores).max() < 3


def test_a_few_bright_pixels_are_measured_up_to_where_they_clip() -> None:
    random = np.random.default_rng(5)
    brightness = 0.15 * random.uniform(0.05, 1.0, 12000)
    brightness[:72] = random.uniform(1.0, 2.0, 72)  # half of what one group of the brightest would be
    groups = grouped_by_light(frames(brightness, 7), SWEEP, 250.0)
    assert groups.brightest > 0.7


def test_without_usable_groups_nothing_is_measured() -> None:
    groups = grouped_by_light(np.full((16, 500), 250.0), SWEEP, 250.0)
    assert groups.brightest == 0.0
