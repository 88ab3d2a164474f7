"""`rig devices` and `rig profile new` on real kernel drivers: vivid, an emulated USB camera, vkms."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from rig import open_rig
from rig.cli.app import run_command
from rig.devices.kms.master import master_is_free
from rig.devices.usb.permissions import udev_rule
from rig.devices.v4l2.find import find_cameras
from rig.emulated.usbip.attach import attach
from rig.emulated.uvc.camera import UvcCamera
from rig.profile.schema import load_profile
from tests.device_lab.guest.rights import as_nobody
from tests.device_lab.programs import output_of
from tests.device_lab.waiting import wait_until
from tests.rig.emulated.numbered_pictures import PatternSource

Capture = pytest.CaptureFixture[str]
USB_ID, VIVID_ID = "usb-1209:0001-LAB7", "platform:vivid-000"


@pytest.fixture(scope="module", autouse=True)
def plugged_in() -> Iterator[None]:
    """A USB camera, a camera of the kernel's own, and a display."""
    output_of("modprobe", "-a", "vhci-hcd", "uvcvideo", "vkms")
    output_of("modprobe", "vivid", "n_devs=1", "node_types=0x1", "num_inputs=1", "input_types=0")
    with attach(UvcCamera(source=PatternSource(), serial="LAB7", name="Lab camera")):
        wait_until(lambda: {camera.device_id for camera in find_cameras()} >= {USB_ID, VIVID_ID}, "both cameras")
        yield


def answer(capsys: Capture, *words: str, status: int = 0) -> dict[str, Any]:
    capsys.readouterr()
    got = run_command([*words, "--json"])
    said = capsys.readouterr()
    assert got == status, said.err
    return json.loads(said.out) if said.out else {"error": said.err}


def test_cameras_and_outputs_are_listed_with_what_they_can_do(capsys: Capture) -> None:
    found = answer(capsys, "devices")
    assert found["problems"] == []
    cameras = {camera["device_id"]: camera for camera in found["cameras"]}
    usb, vivid = cameras[USB_ID], cameras[VIVID_ID]
    assert (usb["driver"], usb["serial"], usb["usb_speed_mbps"]) == ("uvcvideo", "LAB7", 480.0)
    assert usb["error"] is None
    assert 0 < usb["exposure_range_s"][0] < usb["exposure_range_s"][1]
    assert 'pixel_format = "GREY"' in usb["profile"]
    assert vivid["warnings"] == ["has no control of its exposure time"]
    assert len({one["pixel_format"] for one in vivid["formats"]}) > 20
    (output,) = (one for one in found["outputs"] if one["connector"] == "Virtual-1")
    assert (output["status"], output["master_free"]) == ("connected", True)
    assert {"width_px": 1024, "height_px": 768} in [
        {key: mode[key] for key in ("width_px", "height_px")} for mode in output["modes"]
    ]


def test_a_user_who_may_not_open_a_camera_sees_it_with_a_rule_to_paste(capsys: Capture) -> None:
    with as_nobody():
        found = answer(capsys, "devices")
    (usb,) = (camera for camera in found["cameras"] if camera["device_id"] == USB_ID)
    assert "you may not open it" in usb["error"]
    assert udev_rule(0x1209, 0x0001) in usb["error"]
    assert [output["master_free"] for output in found["outputs"]] == [None] * len(found["outputs"])


def test_several_cameras_are_not_guessed_between(tmp_path: Path, capsys: Capture) -> None:
    said = answer(capsys, "profile", "new", str(tmp_path / "lab.toml"), status=2)["error"]
    assert USB_ID in said
    assert VIVID_ID in said
    assert list(tmp_path.iterdir()) == []


def test_a_new_profile_is_valid_and_opens_the_rig(tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / "lab.toml"
    result = answer(capsys, "profile", "new", str(path), "--camera", USB_ID)
    assert (result["driver"], result["output"]) == ("kms", "Virtual-1")
    assert "scale.baseline_m" in result["to_measure"]
    assert answer(capsys, "profile", "check", str(path))["files"][0]["ok"]
    profile = load_profile(path)
    assert profile.projector.shape == (768, 1024)
    with open_rig(profile) as rig:
        assert rig.camera.shape == profile.camera.shape
        assert not master_is_free(Path("/dev/dri/card0"))
    assert master_is_free(Path("/dev/dri/card0"))
