"""By how much all points of a wall are off together is measured, not a constant."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.geometry.noise import shared_error_px
from calibration.geometry.robust_fit import Fit, Priors

SHAPE = (480, 640)


def told(residual: np.ndarray, x1: np.ndarray) -> float:
    """The shared error of a fit that leaves these residuals."""
    nothing = Priors(np.zeros(1), np.zeros((1, 1)), 0.02)
    fit = Fit(z=np.zeros(1), residual=residual, priors=nothing, function=lambda z: residual, least_scale_px=0.3)
    return shared_error_px(fit, x1, np.zeros(len(x1), dtype=np.int64))


@pytest.fixture
def x1() -> np.ndarray:
    return np.random.default_rng(1).uniform((0, 0), SHAPE[::-1], (8000, 2))


def test_independent_noise_shares_next_to_nothing(x1: np.ndarray) -> None:
    assert told(np.random.default_rng(2).normal(0, 0.03, x1.shape), x1) < 0.004


def test_waves_in_the_residuals_tell_that_walls_are_off_together(x1: np.ndarray) -> None:
    noise = np.random.default_rng(2).normal(0, 0.03, x1.shape)
    waves = 0.02 * np.sin(x1 / 60)
    assert 0.02 < told(noise + waves, x1) < 0.06


def test_few_points_leave_the_usual_error(x1: np.ndarray) -> None:
    few = x1[:30]
    assert told(np.zeros_like(few), few) == 0.01
