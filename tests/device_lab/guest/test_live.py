"""Live pictures on a real display driver: its cable is pulled, and the program is ended from outside.

Runs in a device lab machine: `python tests/device_lab/machine.py 'python -m pytest THIS'`.
"""

import signal
from pathlib import Path

import numpy as np

from rig.devices.clock import SystemClock
from rig.devices.kms.find import choose_output, list_outputs
from rig.devices.kms.readback import Readback
from rig.errors import DeviceError
from rig.live.sources.camera import CameraSource
from tests.contract.lab import display_output, load_module
from tests.device_lab.guest.vivid_camera import ID, MODULE
from tests.device_lab.live_show import live_show
from tests.device_lab.waiting import GENEROUS_S, wait_until

AWAY_S = 3.0
"""Longer than a show goes without asking for its display, also on an emulated processor."""


def is_coloured(output: str) -> bool:
    """Whether the test pattern is on an output: the kernel's console is grey; also false for one that is off."""
    readback = Readback(output)
    try:
        readback.open()
        return bool((np.ptp(readback.picture().astype(int), axis=2) > 40).mean() > 0.2)
    except DeviceError:
        return False
    finally:
        readback.close()


def test_a_pulled_cable_is_waited_for_and_the_output_is_dark_after_the_end(tmp_path: Path) -> None:
    output, clock = display_output("vkms"), SystemClock()
    status = choose_output(output, list_outputs()).folder / "status"
    with live_show("kms", output, tmp_path) as show:
        wait_until(lambda: is_coloured(output), "the picture", poll_s=0.1)
        status.write_text("off")
        clock.wait_until_s(clock.now_s() + AWAY_S)
        status.write_text("on")
        wait_until(lambda: is_coloured(output), "the picture", poll_s=0.1)
        result = show.end(signal.SIGTERM)
    assert not is_coloured(output)
    assert result["unplugged"] >= 1
    assert result["frames"] > 1
    assert result["out_of_order"] == 0
    assert [note.split(":")[0] for note in result["notes"] if "plugged" in note][:2] == ["unplugged", "replugged"]


def test_a_camera_gives_colour_pictures_of_a_size_that_covers_the_projector() -> None:
    load_module(*MODULE.split())
    source = CameraSource(ID, (480, 640), SystemClock())
    source.open()
    try:
        pictures = [source.read(GENEROUS_S) for _ in range(2)]
        shapes = {picture.pixels.shape for picture in pictures if picture is not None}
        spread = max(
            int(np.ptp(picture.pixels.astype(int), axis=2).max()) for picture in pictures if picture is not None
        )
    finally:
        source.close()
    assert len(shapes) == 1
    height, width, channels = shapes.pop()
    assert height >= 480
    assert width >= 640
    assert channels == 3
    assert spread > 100
