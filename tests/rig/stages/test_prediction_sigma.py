"""What errors of response curves make of a predicted picture."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.radiometry.response import Response
from rig.stages.linear_light import RadiometricCalibration
from rig.stages.prediction import curve_sigma

LEVELS = np.linspace(0.0, 255.0, 256)
LIGHT = LEVELS / 255
CODES = np.arange(256.0)


def calibration(camera_sigma: np.ndarray, projector_sigma: float = 0.0) -> RadiometricCalibration:
    projector = Response(CODES, CODES / 255, 0.0, np.full(256, projector_sigma))
    return RadiometricCalibration(
        reference_exposure_s=0.02,
        offset_dn=0.0,
        full_scale_dn=255,
        camera=Response(LEVELS, LIGHT, 0.0, camera_sigma),
        projector=(projector,),
        gain_e_per_dn=10.0,
        read_noise_dn=1.0,
        black={},
        mixing=np.eye(1),
        balance=np.ones(1),
    )


IN_WHITE = np.array([[0.4, 0.6]])


def test_a_unit_that_nobody_knows_is_no_error_for_white_has_it_too() -> None:
    """A curve may be known to 15 % of its light, as where a lamp's drift and an exposure look alike."""
    found = curve_sigma(calibration(0.15 * LIGHT), 0, 0.3 * IN_WHITE, IN_WHITE)
    assert found == pytest.approx(np.zeros((1, 2)), abs=1e-9)


def test_errors_of_the_curve_between_a_picture_and_white_count() -> None:
    bent = 0.02 * LIGHT * np.sqrt(1 - LIGHT)
    value = 0.25 * IN_WHITE
    found = curve_sigma(calibration(bent), 0, value, IN_WHITE)
    expected = 0.02 * value * np.sqrt(IN_WHITE - value)
    assert found == pytest.approx(expected, rel=0.01)


def test_the_projectors_curve_is_wrong_by_as_much_of_white() -> None:
    found = curve_sigma(calibration(np.zeros(256), 0.004), 0, 0.5 * IN_WHITE, IN_WHITE)
    assert found == pytest.approx(0.004 * IN_WHITE)


def test_where_hardly_any_white_arrives_the_error_stays_as_small() -> None:
    nothing = np.array([[0.0, -1e-4]])
    found = curve_sigma(calibration(0.02 * LIGHT, 0.004), 0, np.full((1, 2), 1e-3), nothing)
    assert (found < 1e-3).all()
