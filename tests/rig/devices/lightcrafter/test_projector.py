"""A projector with a LightCrafter inside is linear while it is open, and as it was before afterwards."""

from contextlib import nullcontext
from dataclasses import dataclass, field

import numpy as np
import pytest

from rig.devices.clock import VirtualClock
from rig.devices.drivers import make_devices
from rig.devices.lightcrafter.controller import LightCrafter
from rig.devices.lightcrafter.projector import LightCrafterProjector
from rig.devices.protocols import Codes, Projector, Shown
from rig.errors import DeviceLost, SettingRefused
from rig.profile.schema import load_profile
from rig.profile.tables import LightCrafterTable
from tests.rig.devices.lightcrafter.emulated_controller import InProcessTransport, LightCrafterEmulation

FACTORY = (104, 135, 130)


@pytest.fixture
def transport() -> InProcessTransport:
    return InProcessTransport(LightCrafterEmulation(), VirtualClock())


@pytest.fixture
def device(transport: InProcessTransport) -> LightCrafterEmulation:
    return transport.device


@dataclass
class FakeDisplay:
    shape: tuple[int, int] = (3, 4)
    calls: list[str] = field(default_factory=list)
    fails: bool = False

    def open(self) -> None:
        if self.fails:
            raise DeviceLost("no such output")
        self.calls.append("open")

    def close(self) -> None:
        self.calls.append("close")

    def show(self, codes: Codes, *, name: str) -> Shown:
        self.calls.append(name)
        return Shown(1.0, name)


class WatchedDisplay(FakeDisplay):
    def check_on_screen(self) -> None:
        raise DeviceLost("another program shows something")


def test_a_projector_notices_what_its_display_notices(transport: InProcessTransport) -> None:
    for display, text in ((FakeDisplay(), None), (WatchedDisplay(), "another program")):
        projector = LightCrafterProjector(display, lambda: LightCrafter(transport, transport.clock), None)
        with pytest.raises(DeviceLost, match=text) if text else nullcontext():
            projector.check_on_screen()


def wrapped(
    transport: InProcessTransport, currents: tuple[int, int, int] | None, **display: bool
) -> tuple[LightCrafterProjector, FakeDisplay]:
    shown = FakeDisplay(**display)  # type: ignore[arg-type]
    return LightCrafterProjector(shown, lambda: LightCrafter(transport, transport.clock), currents), shown


def test_a_projector_prepares_its_controller_and_puts_back_what_it_found(
    transport: InProcessTransport, device: LightCrafterEmulation
) -> None:
    projector, display = wrapped(transport, (60, 60, 60))
    assert isinstance(projector, Projector)
    projector.open()
    projector.open()
    assert (device.registers.gamma, device.registers.led_currents) == (0, bytes([195] * 3))
    assert projector.show(np.zeros((3, 4), np.uint8), name="black").name == "black"
    projector.close()
    projector.close()
    assert (device.registers.gamma, device.registers.led_currents) == (0x80, bytes([151, 120, 125]))
    assert display.calls == ["open", "black", "close", "close"]
    assert transport.closed == 1


def test_a_projector_wakes_a_controller_in_standby(
    transport: InProcessTransport, device: LightCrafterEmulation
) -> None:
    device.registers.power = 1
    projector, _ = wrapped(transport, None)
    projector.open()
    assert device.registers.power == 0
    assert device.registers.led_currents == bytes([151, 120, 125])
    projector.close()


def test_a_projector_that_does_not_open_leaves_the_controller_as_it_was(
    transport: InProcessTransport, device: LightCrafterEmulation
) -> None:
    projector, _ = wrapped(transport, (60, 60, 60), fails=True)
    with pytest.raises(DeviceLost, match="no such output"):
        projector.open()
    assert (device.registers.gamma, device.registers.led_currents) == (0x80, bytes([151, 120, 125]))
    assert transport.closed == 1


def test_a_projector_whose_currents_are_refused_never_opens_its_display(
    transport: InProcessTransport, device: LightCrafterEmulation
) -> None:
    projector, display = wrapped(transport, (255, 255, 255))
    with pytest.raises(SettingRefused, match="red LED current 255"):
        projector.open()
    assert display.calls == []
    assert device.registers.gamma == 0x80


def test_closing_after_the_cable_was_pulled_still_blackens_the_display(transport: InProcessTransport) -> None:
    projector, display = wrapped(transport, None)
    projector.open()
    transport.unplugged = True
    projector.close()
    assert display.calls == ["open", "close"]
    assert transport.closed == 1


def test_a_profile_with_a_lightcrafter_wraps_its_projector(monkeypatch: pytest.MonkeyPatch) -> None:
    tiny = load_profile("ci-tiny")
    plain = tiny.with_device(tiny.camera.model_copy(update={"driver": "v4l2"})).with_device(
        tiny.projector.model_copy(update={"driver": "kms"})
    )
    table = LightCrafterTable(serial="S", led_currents=FACTORY)
    told = plain.with_device(plain.projector.model_copy(update={"lightcrafter": table}))
    display = FakeDisplay()
    monkeypatch.setattr("rig.devices.kms.projector.from_profile", lambda *_: display)
    asked: list[str | None] = []

    def connect(serial: str | None, clock: object) -> LightCrafter:
        asked.append(serial)
        raise DeviceLost("none")

    monkeypatch.setattr("rig.devices.lightcrafter.projector.open_lightcrafter", connect)
    assert make_devices(plain).projector is display
    projector = make_devices(told).projector
    with pytest.raises(DeviceLost):
        projector.open()
    assert asked == ["S"]
