"""Frames of white that a camera's curve is found from, and somebody or something that changes a few of them."""

import numpy as np
import pytest

from calibration.errors import CalibrationError
from rig.stages.light.levels import refuse_disturbed_sweeps

SHAPE = (60, 80)
EXPOSURES_S = np.repeat([0.001, 0.004, 0.016], 2)
FULL_DN = 4000.0


def sweeps(gamma: float = 1.0, noise_dn: float = 4.0) -> np.ndarray:
    """Two sweeps over uneven walls, the second in the opposite order, by a camera with a curve."""
    random = np.random.default_rng(9)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] / np.array(SHAPE).reshape(2, 1, 1)
    walls = 0.2 + 0.8 * np.exp(-2 * ((y - 0.6) ** 2 + (x - 0.3) ** 2))
    light = np.array([walls * exposure_s / 0.02 for exposure_s in EXPOSURES_S])
    return FULL_DN * light**gamma + random.normal(0, noise_dn, light.shape)


@pytest.mark.parametrize("gamma", [1.0, 1 / 2.2])
def test_frames_that_are_alike_pass_whatever_the_camera_s_curve(gamma: float) -> None:
    refuse_disturbed_sweeps(sweeps(gamma), EXPOSURES_S, FULL_DN)


@pytest.mark.parametrize("frame", range(6))
def test_somebody_in_either_sweep_is_refused_with_the_exposure_and_what_to_do(frame: int) -> None:
    levels = sweeps()
    levels[frame, 20:50, 30:42] *= 0.3
    with pytest.raises(CalibrationError, match=f"both exposed for {1000 * EXPOSURES_S[frame]:.2f} ms") as refused:
        refuse_disturbed_sweeps(levels, EXPOSURES_S, FULL_DN)
    assert "stood in the light" in str(refused.value)
    assert "begin a new session" in str(refused.value)


def test_bands_of_a_rolling_shutter_before_a_projector_that_pulses_are_nobody_in_the_light() -> None:
    levels = sweeps()
    rows = np.arange(SHAPE[0])[:, None]
    for k, frame in enumerate(levels):
        frame *= 1 + 0.6 * np.sin(rows / 4 + 2 * k)
    refuse_disturbed_sweeps(levels, EXPOSURES_S, FULL_DN)


def test_a_lamp_that_drifts_is_no_disturbance() -> None:
    levels = sweeps()
    levels[1::2] *= 1.05
    refuse_disturbed_sweeps(levels, EXPOSURES_S, FULL_DN)


def test_frames_without_any_light_are_left_to_others() -> None:
    refuse_disturbed_sweeps(np.zeros((6, *SHAPE)), EXPOSURES_S, FULL_DN)
