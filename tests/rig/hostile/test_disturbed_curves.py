"""Frames of white that a camera's curve is found from, and somebody or something that changes a few of them."""

from functools import partial

import numpy as np
import pytest

from calibration.errors import CalibrationError
from rig.stages.light.levels import light_of_levels, refuse_disturbed_sweeps, refuse_late_white
from rig.stages.linear_light import LightImage

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


def in_places(levels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(F, N) levels with the camera's black, and what that is while the projector is black."""
    return 64 + levels.reshape(len(levels), -1), np.full((len(levels) // 2, levels[0].size), 64.0)


def test_a_first_photograph_of_white_that_still_shows_black_is_refused_with_latency() -> None:
    levels = sweeps()
    levels[0] *= 0.7
    with pytest.raises(CalibrationError, match=r"white after black is still 30 % that of black.*Raise projector\.lat"):
        refuse_late_white(*in_places(levels))


def test_a_lamp_that_warms_up_or_pulses_is_not_late() -> None:
    warming, pulsing = sweeps(), sweeps()
    warming *= np.linspace(0.85, 1, 6)[[0, 5, 1, 4, 2, 3], None, None]
    pulsing *= np.array([0.7, 1.0, 1.0, 0.87, 0.97, 1.0])[:, None, None]
    for levels in (warming, pulsing, np.zeros_like(warming)):
        refuse_late_white(*in_places(levels))


def test_noise_of_hardly_any_light_is_not_late() -> None:
    for seed in range(20):
        noise = np.random.default_rng(seed).normal(0, 4.0, (6, *SHAPE))
        refuse_late_white(*in_places(1e-4 * sweeps(noise_dn=0.0) + noise))


def test_frames_without_any_light_are_left_to_others() -> None:
    refuse_disturbed_sweeps(np.zeros((6, *SHAPE)), EXPOSURES_S, FULL_DN)


LEVELS = {"level-064": 0.05, "level-191": 0.5, "level-128": 0.2, "level-032": 0.01}


def photographed(share: float) -> LightImage:
    """Walls that have a share of white's light."""
    light = np.full((*SHAPE, 1), share, np.float32)
    return LightImage(light, np.full_like(light, 1e-6), np.zeros(light.shape, bool))


@pytest.mark.parametrize(("odd", "is_late"), [(0.4, True), (0.05, False)])
def test_a_part_of_a_picture_that_the_one_before_explains_is_called_late_before_anybody_is_blamed(
    odd: float, is_late: bool
) -> None:
    pictures = {name: photographed(share) for name, share in LEVELS.items()}
    pictures["level-128"].value[40:, :30] = odd
    loads = {name: partial(lambda picture: picture, picture) for name, picture in pictures.items()}
    with pytest.raises(CalibrationError, match=r"1 of 4 pictures .*\(level-128\)") as refused:
        light_of_levels(loads, photographed(1.0), np.ones(SHAPE, bool))
    assert ("raise projector.latency_s" in str(refused.value)) == is_late
    assert "Somebody or something stood in the light" in str(refused.value)
