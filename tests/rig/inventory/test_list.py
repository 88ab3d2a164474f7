"""What is plugged in is listed completely, and one device that cannot be asked hides no other."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import pytest

from rig.devices.genicam.describe import GenicamAbilities
from rig.devices.genicam.find import FoundGenicam
from rig.devices.gphoto2.find import FoundStill
from rig.devices.kms.master import master_is_free
from rig.devices.protocols import ExposureRange
from rig.devices.v4l2.controls import exposure_range_of
from rig.errors import DeviceBusy, DeviceError, DeviceForbidden, UsageError
from rig.inventory.choose import best_camera_mode, best_output_mode, fixed_controls
from rig.inventory.list import THIS_MACHINE, Finders, list_devices
from rig.inventory.tables import print_devices
from rig.profile.tables import CameraProfile, ProjectorProfile
from tests.rig.inventory.found_devices import (
    EXPOSURE,
    GAIN,
    MONO,
    Abilities,
    Camera,
    Control,
    Format,
    Mode,
    Monitor,
    Output,
    UsbDevice,
    finders,
)

WEBCAM = Camera(
    "usb-046d:082d-AB12", Path("/dev/video2"), "HD Pro Webcam C920", serial="AB12", vendor_id=0x046D, product_id=0x082D
)
SECOND = Camera("usb-1209:0001-A", Path("/dev/video1"), "vivid", vendor_id=0x1209, product_id=0x0001, serial="A")


def listed(name: str | None = None, finders: Finders = THIS_MACHINE) -> dict[str, Any]:
    """The answer as programs get it."""
    return json.loads(json.dumps(list_devices(name, finders).as_json(), allow_nan=False))


def refuse(*_: object) -> Any:
    raise DeviceForbidden("/dev/video1: you may not open it")


def test_the_answer_is_plain_data() -> None:
    usb = (UsbDevice(0x0451, 0x6401, "LCR"),)
    found = listed(finders=finders(monitors=lambda: (Monitor(),), usb_devices=lambda: usb))
    assert found["cameras"][0]["formats"][0]["pixel_format"] == "MJPG"
    assert found["cameras"][0]["controls"][0]["name"] == "exposure_time_absolute"
    assert found["outputs"][0]["modes"][1]["refresh_rate_hz"] == 59.81


def test_the_lines_to_paste_are_valid_in_a_profile() -> None:
    found = listed(finders=finders())
    camera = tomllib.loads("\n".join(found["cameras"][0]["profile"]))["camera"][0]
    projector = tomllib.loads("\n".join(found["outputs"][0]["profile"]))["projector"][0]
    assert camera["device_id"] == "usb-2bb8:0001-0007"
    checked = CameraProfile.model_validate({**camera, "exposure_s": 0.01, "hfov_deg": 60.0})
    assert (checked.shape, checked.full_scale_dn, checked.exposure_range_s) == ((960, 1280, 1), 255, (1e-4, 0.2))
    shown = ProjectorProfile.model_validate({**projector, "latency_s": 0.1, "hfov_deg": 40.0})
    assert (shown.driver, shown.output, shown.shape) == ("kms", "HDMI-A-1", (1080, 1920))


def test_a_camera_that_may_not_be_opened_is_shown_with_its_error_beside_the_others() -> None:
    def describe(node: Path) -> Abilities:
        return refuse() if node == SECOND.node else MONO

    cameras = listed(finders=finders(cameras=lambda: (SECOND, Camera()), describe=describe))["cameras"]
    assert cameras[0]["error"].startswith("/dev/video1: you may not open it")
    assert 'ATTRS{idVendor}=="1209"' in cameras[0]["error"]
    assert cameras[0]["profile"] == []
    assert cameras[1]["error"] is None
    assert cameras[1]["profile"]


@pytest.mark.parametrize("kind", ["cameras", "outputs", "monitors", "usb_devices"])
def test_a_whole_kind_that_cannot_be_listed_is_a_problem_and_hides_nothing_else(kind: str) -> None:
    def fail() -> Any:
        raise DeviceError("the driver is broken")

    found = listed(finders=finders(**{kind: fail}))
    assert [problem.partition(": ")[2] for problem in found["problems"]] == ["the driver is broken"]
    assert bool(found["cameras"]) == (kind != "cameras")
    assert bool(found["outputs"]) == (kind != "outputs")


def test_a_broken_link_of_the_operating_system_is_no_crash() -> None:
    def fail(node: Path) -> Any:
        raise OSError(19, "No such device")

    found = listed(finders=finders(describe=fail, master_is_free=fail))
    assert "No such device" in found["cameras"][0]["error"]
    assert "No such device" in found["outputs"][0]["error"]


def test_a_slow_usb_port_and_a_missing_exposure_control_are_warnings() -> None:
    usb = (UsbDevice(0x2BB8, 0x0001, "0007", warning="runs at 480 Mbit/s but can do 5000"),)
    dull = Abilities(MONO.formats, (GAIN,))
    camera = listed(finders=finders(usb_devices=lambda: usb, describe=lambda node: dull))["cameras"][0]
    assert camera["warnings"] == ["runs at 480 Mbit/s but can do 5000", "has no control of its exposure time"]
    assert camera["exposure_range_s"] is None
    assert not any(line.startswith("exposure_range_s") for line in camera["profile"])


def test_a_card_that_a_desktop_drives_is_told() -> None:
    free, held = (
        listed(finders=finders(master_is_free=lambda card, is_free=is_free: is_free))["outputs"][0]
        for is_free in (True, False)
    )
    assert (free["master_free"], free["warnings"]) == (True, [])
    assert 'driver = "window"' in held["warnings"][0]


def test_what_is_no_graphics_card_is_neither_free_nor_held(tmp_path: Path) -> None:
    assert master_is_free(tmp_path / "card9") is None
    (tmp_path / "card0").touch()
    assert master_is_free(tmp_path / "card0") is None


def test_an_output_without_a_projector_has_no_lines_to_paste() -> None:
    output = Output(status="disconnected", edid_id=None, monitor_name=None, modes=())
    assert listed(finders=finders(outputs=lambda: (output,)))["outputs"][0]["profile"] == []


def test_two_outputs_of_one_name_are_told_apart_by_their_card() -> None:
    twins = (Output(), Output(card=Path("/dev/dri/card1")))
    found = listed(finders=finders(outputs=lambda: twins))["outputs"]
    assert [one["output"] for one in found] == ["card0:HDMI-A-1", "card1:HDMI-A-1"]


def test_known_models_are_named() -> None:
    found = listed(finders=finders(cameras=lambda: (WEBCAM, Camera())))
    assert [camera["known_as"] for camera in found["cameras"]] == ["Logitech C920", None]


def test_a_projector_controller_on_usb_is_known_by_its_ids() -> None:
    usb = (UsbDevice(0x1D6B, 2), UsbDevice(0x0451, 0x6401, "LCR"))
    (controller,) = listed(finders=finders(usb_devices=lambda: usb))["controllers"]
    assert controller["name"] == "Texas Instruments DLP LightCrafter 4500"
    assert (controller["usb_id"], controller["serial"]) == ("0451:6401", "LCR")


@pytest.mark.parametrize("name", ["usb-2bb8:0001-0007", "/dev/video0", "ocam"])
def test_a_name_keeps_the_devices_that_it_means(name: str) -> None:
    found = listed(name, finders(cameras=lambda: (SECOND, Camera())))
    assert [camera["device_id"] for camera in found["cameras"]] == ["usb-2bb8:0001-0007"]
    assert found["outputs"] == []


def test_a_name_of_nothing_is_refused_with_what_is_there() -> None:
    with pytest.raises(UsageError, match=r"no device is called 'basler'; there are: oCam-1MGN-U, HDMI-A-1"):
        listed("basler", finders())


def test_people_see_the_ids_the_choice_and_the_errors(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "160")

    def describe(node: Path) -> Abilities:
        return refuse() if node == SECOND.node else MONO

    print_devices(list_devices(finders=finders(cameras=lambda: (SECOND, Camera()), describe=describe)))
    said = capsys.readouterr().out
    assert "GREY 1280x960" in said
    assert "0.1 … 200" in said
    assert "vivid: /dev/video1: you may not open it" in said
    assert 'device_id = "usb-2bb8:0001-0007"' in said
    assert 'output = "HDMI-A-1"' in said
    assert "YUYV" not in said


def test_details_show_every_format_control_and_mode(capsys: pytest.CaptureFixture[str]) -> None:
    print_devices(list_devices(finders=finders(monitors=lambda: (Monitor(),))), details=True)
    said = capsys.readouterr().out
    for word in ("YUYV", "MJPG", "exposure_time_absolute", "gain", "1280 x 800", "preferred", "HDMI-1"):
        assert word in said


def test_nothing_plugged_in_is_no_error(capsys: pytest.CaptureFixture[str]) -> None:
    print_devices(list_devices(finders=finders(cameras=lambda: (), outputs=lambda: ())))
    assert capsys.readouterr().out.count("none") == 2


def one_format(name: str, *, size: tuple[int, int] = (640, 480), rates_hz: tuple[float, ...] = (30.0,)) -> Format:
    return Format(name, *size, rates_hz)


@pytest.mark.parametrize(
    ("offered", "chosen"),
    [
        (("MJPG", "YUYV", "GREY"), "GREY"),
        (("GREY", "Y10"), "Y10"),
        (("Y12", "Y16 ", "GREY"), "Y16"),
        (("MJPG", "YUYV"), "YUYV"),
        (("MJPG", "RGGB"), "RGGB"),
        (("H264", "MJPG"), "MJPG"),
    ],
)
def test_the_rawest_grey_format_is_chosen(offered: tuple[str, ...], chosen: str) -> None:
    mode = best_camera_mode([one_format(name) for name in offered])
    assert mode is not None
    assert mode.pixel_format == chosen


def test_no_usable_format_is_no_choice() -> None:
    assert best_camera_mode([one_format("H264")]) is None


def test_the_largest_size_is_chosen_unless_it_is_a_slide_show() -> None:
    mode = best_camera_mode(MONO.formats)
    assert mode is not None
    assert (mode.width_px, mode.height_px, mode.frame_rate_hz) == (1280, 960, 45.0)
    slow = best_camera_mode([one_format("GREY", rates_hz=(2.0,)), one_format("GREY", size=(320, 240), rates_hz=(1.0,))])
    assert slow is not None
    assert slow.width_px == 640


@pytest.mark.parametrize(("offered", "chosen"), [((120.0, 60.0, 30.0), 60.0), ((200.0, 100.0), 100.0), ((), None)])
def test_the_rate_is_the_highest_that_a_projector_can_follow(offered: tuple[float, ...], chosen: float | None) -> None:
    mode = best_camera_mode([one_format("GREY", rates_hz=offered)])
    assert mode is not None
    assert mode.frame_rate_hz == chosen


def test_an_exposure_in_lines_has_no_seconds() -> None:
    assert exposure_range_of([EXPOSURE]) == (1e-4, 0.2)
    assert exposure_range_of([Control("exposure", 0x00980911, 4, 1000, 100, 100)]) is None
    assert exposure_range_of([]) is None


def test_controls_are_fixed_where_they_add_least() -> None:
    reading = Control("contrast", 0x00980901, 0, 9, 5, 5, is_settable=False)
    pan = Control("pan_absolute", 0x009A0908, -9, 9, 0, 3)
    fixed = fixed_controls([*MONO.controls, reading, pan])
    assert {name: value for name, (value, _) in fixed.items()} == {"gain": 4, "brightness": 0, "focus_absolute": 35}


@pytest.mark.parametrize(
    ("limits", "step", "chosen"), [((72, 500), 1, 100), ((150, 300), 1, 150), ((1, 90), 1, 90), ((72, 500), 20, 92)]
)
def test_gamma_is_as_linear_as_the_camera_allows(limits: tuple[int, int], step: int, chosen: int) -> None:
    gamma = Control("gamma", 0x00980910, *limits, 220, 220, step=step)
    assert fixed_controls([gamma]) == {"gamma": (chosen, "linear, or nearest to it")}


def test_the_preferred_mode_of_a_display_is_its_own() -> None:
    first, second = Mode(800, 600, 60.0, False), Mode(1024, 768, 60.0, True)
    assert best_output_mode([first, second]) is second
    assert best_output_mode([first]) is first
    assert best_output_mode([]) is None


def test_industrial_and_still_cameras_are_listed_with_their_lines() -> None:
    gige = FoundGenicam(
        device_id="gige-22334455",
        vendor="Basler",
        model="acA1300",
        serial="22334455",
        address="192.168.7.9",
        aravis_id="Basler-22334455",
    )
    still = FoundStill("Nikon DSC D750", "usb:001,004")
    able = GenicamAbilities(
        pixel_formats=("BayerRG12", "BayerRG8"),
        width_px=1280,
        height_px=960,
        frame_rate_hz=41.5,
        exposure_range_s=ExposureRange(1e-5, 2.0),
    )
    asked = finders(genicam=lambda: (gige,), stills=lambda: (still,), describe_genicam=lambda _: able)
    found = list_devices(finders=asked)
    assert [one.device_id for one in found.bus_cameras] == ["gige-22334455", "usb:001,004"]
    settings = tomllib.loads("\n".join(found.bus_cameras[0].profile))["camera"][0]
    assert settings == {
        "name": "camera",
        "driver": "genicam",
        "device_id": "gige-22334455",
        "pixel_format": "BayerRG12",
        "width_px": 1280,
        "height_px": 960,
        "channels": 3,
        "mosaic": "RGGB",
        "bit_depth": 12,
        "frame_rate_hz": 41.5,
        "exposure_range_s": [1e-5, 2.0],
    }
    assert 'device_id = "usb:001,004"' in found.bus_cameras[1].profile
    assert list_devices("192.168.7.9", asked).bus_cameras == (found.bus_cameras[0],)


def test_an_industrial_camera_that_another_program_holds_is_listed_with_why() -> None:
    gige = FoundGenicam(device_id="gige-1", vendor="A", model="B", serial="1", address="192.168.7.9", aravis_id="A-1")

    def busy(_: FoundGenicam) -> GenicamAbilities:
        raise DeviceBusy("camera gige-1 is controlled by another program; close that")

    (listed,) = list_devices(finders=finders(genicam=lambda: (gige,), describe_genicam=busy)).bus_cameras
    assert listed.error == "camera gige-1 is controlled by another program; close that"
    assert 'device_id = "gige-1"' in listed.profile
