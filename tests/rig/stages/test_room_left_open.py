"""A room that may stand in many ways around the devices is refused, with which place is known how badly."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import pytest

from calibration.errors import CalibrationError
from calibration.geometry.room import RoomBox
from rig.stages.geometry import check_devices_placed

CORNER = cast("RoomBox", SimpleNamespace(size_m=(5.29, 3.76, 2.71), seen=("x1", "y1", "floor")))
SIGMAS_M = {f"{who}_{axis}_m": 0.02 for who in ("camera", "projector") for axis in "xyz"} | {"baseline_m": 0.18}


def test_places_known_no_better_than_to_a_tenth_of_the_room_are_refused_by_name() -> None:
    known = r"the projector's x is known to \+- 1.67 m in a room of 5.29 m"
    with pytest.raises(CalibrationError, match=known) as caught:
        check_devices_placed(CORNER, SIGMAS_M | {"projector_x_m": 1.67, "camera_y_m": 1.19}, 0.25)
    assert "0.25 m +- 0.18 m apart" in str(caught.value)
    assert "move the camera further aside" in str(caught.value)


@pytest.mark.parametrize("sigma_m", [7.0, 1e138, float("inf"), float("nan")])
def test_what_the_points_do_not_determine_is_said_to_be_so_and_not_in_metres(sigma_m: float) -> None:
    nowhere = SIGMAS_M | {"camera_y_m": sigma_m, "baseline_m": sigma_m}
    with pytest.raises(CalibrationError, match=r"the camera's y is not determined in a room of 5\.29 m") as caught:
        check_devices_placed(CORNER, nowhere, 0.25)
    assert "0.25 m (not determined) apart" in str(caught.value)
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize("sigma_m", [0.02, 0.5])
def test_places_that_are_known_to_less_than_that_are_for_the_limits_to_judge(sigma_m: float) -> None:
    check_devices_placed(CORNER, SIGMAS_M | {"projector_x_m": sigma_m}, 0.25)


def test_axes_along_which_nobody_measured_a_wall_are_no_reason() -> None:
    guessed = {name: sigma for name, sigma in SIGMAS_M.items() if "_z_" not in name}
    check_devices_placed(CORNER, guessed, 0.25)


def test_before_one_wall_alone_there_is_no_room_to_stand_in() -> None:
    wall = cast("RoomBox", SimpleNamespace(size_m=(2.0, 2.0, 2.0), seen=("x0",)))
    check_devices_placed(wall, SIGMAS_M | {"projector_x_m": 1.67}, 0.25)
