"""Two GigE cameras of one rig: opened at once, each with its own frames, and faults are told by their names."""

import os
import socket
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from rig.capture.rig import Rig, open_rig
from rig.devices.clock import SystemClock
from rig.devices.genicam.find import list_genicam
from rig.devices.virtual.projector import VirtualDisplay
from rig.emulated.gige.camera import EmulatedGigeCamera, GigeRequest, encoded
from rig.emulated.gige.description import EmulatedSensor
from rig.profile.schema import Profile
from tests.gige import GigeRig, gige_rig, needs_aravis, plugged

pytestmark = needs_aravis

CLOCK = SystemClock()
OWN_DN = {"left": 1000, "right": 2000}
"""What each camera sees on top of the display's code."""


@dataclass
class Eye:
    """Sees the display's code, and something of its own."""

    display: VirtualDisplay
    own_dn: int
    frames: int = 0

    def expose(self, request: GigeRequest) -> bytes:
        CLOCK.wait_until_s(CLOCK.now_s() + request.exposure_s)
        pixels = np.full((*request.shape, 1), self.own_dn + int(self.display.picture().max()), np.uint16)
        self.frames += 1
        pixels[0, 0] = self.frames % 4096  # noise: no frame is the one before
        return encoded(pixels, request.pixel_format)


@dataclass
class Pair:
    rig: Rig
    right: EmulatedGigeCamera

    def level(self, camera: str, code: int) -> int:
        """What a camera sees of a flat picture, less its own."""
        codes = np.full(self.rig.projector.shape, code, np.uint8)
        return int(self.rig.shoot(codes, name=f"flat-{code}", camera=camera).pixels[1, 1, 0]) - OWN_DN[camera]


def second_address() -> str:
    """An address of this machine besides loopback, on which the second camera is served: one fits on each."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("198.51.100.1", 9))  # of the documentation: nothing is sent
        except OSError:
            pytest.skip("this machine has no network card with an address")
        return str(probe.getsockname()[0])


def camera_at(address: str, serial: str, display: VirtualDisplay, own_dn: int) -> EmulatedGigeCamera:
    sensor = EmulatedSensor(width_px=64, height_px=48, formats=("Mono12",), exposure_range_s=(1e-4, 1.0))
    view = Eye(display, own_dn)
    return EmulatedGigeCamera(view, sensor, serial=serial, address=address, wait=lambda _: None)


def pair_profile(whole: Profile) -> Profile:
    """Two cameras by their serial numbers; packets between two addresses of one machine pass no network card."""
    camera = whole.camera.model_copy(update={"width_px": 64, "height_px": 48, "exposure_range_s": (1e-4, 1.0)})
    names = {"left": "gige-LEFT", "right": "gige-RIGHT"}
    options = {"trigger": "software", "packet_socket": False}
    return whole.model_copy(
        update={
            "cameras": tuple(
                camera.model_copy(update={"name": name, "device_id": serial, "options": options})
                for name, serial in names.items()
            )
        }
    )


@pytest.fixture
def pair() -> Iterator[Pair]:
    profile = pair_profile(gige_rig().profile)
    display = VirtualDisplay(profile.projector.output or f"gige-{os.getpid()}")
    left, right = (
        camera_at(address, serial, display, own_dn)
        for address, serial, own_dn in zip(
            ("127.0.0.1", second_address()), ("LEFT", "RIGHT"), OWN_DN.values(), strict=True
        )
    )
    with plugged(GigeRig(left, profile, [])), right:
        with open_rig(profile) as rig:
            yield Pair(rig, right)


def test_each_camera_has_its_own_frames_and_its_own_exposure(pair: Pair) -> None:
    assert {"gige-LEFT", "gige-RIGHT"} <= {one.device_id for one in list_genicam()}
    assert pair.rig.set_exposure(0.004, camera="right") == pytest.approx(0.004)
    assert pair.rig.set_exposure(0.002, camera="left") == pytest.approx(0.002)
    order = [("left", 10), ("right", 20), ("right", 30), ("left", 40), ("left", 50), ("right", 60)]
    assert [pair.level(name, code) for name, code in order] == [code for _, code in order]


def test_a_camera_that_went_away_is_told_by_its_name_and_the_other_goes_on(pair: Pair) -> None:
    assert pair.level("right", 10) == 10
    pair.right.unplug()
    assert pair.level("left", 20) == 20
    assert pair.rig.events == []
    pair.right.plug()
    assert pair.level("right", 30) == 30
    assert [event.kind for event in pair.rig.events][:2] == ["unplugged", "replugged"]
    assert pair.rig.events[0].detail.startswith("camera right (gige-RIGHT)")
    assert pair.level("left", 40) == 40
