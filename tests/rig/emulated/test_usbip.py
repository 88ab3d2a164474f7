"""Emulated USB devices against a host made of a socket: no kernel needed."""

import errno
import socket
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from rig.emulated.usbip import attach as usbip
from rig.emulated.usbip.attach import Attachment, serve
from rig.emulated.usbip.device import (
    Descriptors,
    Setup,
    Stall,
    Transfer,
    UsbSpeed,
    configuration_descriptor,
    device_descriptor,
)
from rig.errors import DeviceError
from tests.rig.emulated.usb_host import Host, HostReply

GET, SET = 0xA1, 0x21
FRAME_PARITY, END_OF_FRAME, ERROR = 1, 2, 0x40


@dataclass
class Echo:
    """A device with an endpoint of each direction: what is sent to it can be read."""

    speed = UsbSpeed.FULL
    descriptors = Descriptors(device_descriptor(0x1209, 2), configuration_descriptor(1, b""), ("us", "echo", "1"))
    life: list[str] = field(default_factory=list)
    waiting: list[Transfer] = field(default_factory=list)
    took: list[bool] = field(default_factory=list)

    def plugged(self) -> None:
        self.life.append("plugged")

    def unplugged(self) -> None:
        self.life.append("unplugged")

    def control(self, setup: Setup, data: bytes) -> bytes:
        if setup.request == 0x55:
            raise Stall
        return b"vendor" * 10

    def select(self, interface: int, alternate: int) -> None:
        self.life.append(f"select {interface} {alternate}")

    def submit(self, transfer: Transfer) -> None:
        if transfer.endpoint & 0x80:
            self.waiting.append(transfer)
            return
        if transfer.data == b"halt":
            transfer.stall()
            return
        transfer.complete()
        if self.waiting:
            self.took.append(self.waiting.pop(0).complete(transfer.data[:2], transfer.data[2:]))


@pytest.fixture
def echo(cable: tuple[socket.socket, Host]) -> Iterator[tuple[Echo, Host, Attachment]]:
    device = Echo()
    with serve(device, cable[0]) as attachment:
        yield device, cable[1], attachment


def test_descriptors_are_cut_to_what_the_host_asked_for(echo: tuple[Echo, Host, Attachment]) -> None:
    device, host, _ = echo
    assert host.control((0x80, 6, 0x0100, 0), 8).data == device.descriptors.device[:8]
    assert host.control((0x80, 6, 0x0200, 0), 255).data == device.descriptors.configuration
    assert host.control((0x80, 6, 0x0302, 0x409), 255).data == b"\x0a\x03e\0c\0h\0o\0"
    assert host.control((0x80, 6, 0x0300, 0), 255).data == b"\x04\x03\x09\x04"
    assert len(host.control((0x80, 6, 0x0600, 0), 255).data) == 10


@pytest.mark.parametrize("value", [0x0304, 0x0201, 0x0F00])
def test_a_descriptor_that_is_not_there_stalls(echo: tuple[Echo, Host, Attachment], value: int) -> None:
    assert echo[1].control((0x80, 6, value, 0), 255) == HostReply(-errno.EPIPE, b"")


def test_the_host_can_configure_and_ask_back(echo: tuple[Echo, Host, Attachment]) -> None:
    device, host, _ = echo
    assert host.control((0x00, 9, 1, 0)).status == 0
    assert host.control((0x01, 11, 3, 2)).status == 0
    assert host.control((0x80, 8, 0, 0), 1).data == b"\1"
    assert host.control((0x81, 10, 0, 2), 1).data == b"\3"
    assert host.control((0x82, 0, 0, 0x81), 2).data == b"\0\0"
    assert host.control((0x02, 1, 0, 0x81)).status == 0
    assert device.life == ["plugged", "select -1 0", "select 2 3"]


def test_vendor_requests_reach_the_device_and_may_stall(echo: tuple[Echo, Host, Attachment]) -> None:
    _, host, _ = echo
    assert host.control((0xC0, 1, 0, 0), 6).data == b"vendor"
    assert host.control((0x40, 1, 0, 0), b"12345").status == 0
    assert host.control((0x40, 0x55, 0, 0), b"12345").status == -errno.EPIPE
    assert host.control((0x81, 6, 0x2200, 0), 6).data == b"vendor"


def test_data_written_to_one_endpoint_are_read_from_the_other(echo: tuple[Echo, Host, Attachment]) -> None:
    device, host, _ = echo
    read = host.command(1, 2, 64)
    written = host.command(0, 1, 5)
    host.link.sendall(b"hello")
    assert host.reply() == (written, HostReply(0, b""))
    assert host.reply() == (read, HostReply(0, b"hello"))
    host.control((0x80, 8, 0, 0), 1)
    assert device.took == [True]


def test_a_transfer_that_was_taken_back_is_not_answered(echo: tuple[Echo, Host, Attachment]) -> None:
    device, host, _ = echo
    victim = host.command(1, 2, 64)
    unlinked = host.unlink(victim)
    assert host.reply() == (unlinked, HostReply(-errno.ECONNRESET, b""))
    written = host.command(0, 1, 5)
    host.link.sendall(b"hello")
    assert host.reply() == (written, HostReply(0, b""))
    host.control((0x80, 8, 0, 0), 1)
    assert device.took == [False]


def test_a_transfer_that_was_answered_cannot_be_taken_back(echo: tuple[Echo, Host, Attachment]) -> None:
    _, host, _ = echo
    written = host.command(0, 1, 4)
    host.link.sendall(b"done")
    assert host.reply()[0] == written
    unlinked = host.unlink(written)
    assert host.reply() == (unlinked, HostReply(0, b""))


def test_a_halted_endpoint_says_so(echo: tuple[Echo, Host, Attachment]) -> None:
    _, host, _ = echo
    written = host.command(0, 1, 4)
    host.link.sendall(b"halt")
    assert host.reply() == (written, HostReply(-errno.EPIPE, b""))


@pytest.mark.parametrize(
    "nonsense",
    [b"", b"\0" * 20, struct.pack(">5I28x", 77, 1, 2, 3, 4), struct.pack(">5IIIIiI8x", 1, 1, 1, 0, 1, 0, 9, 0, 0, 0)],
    ids=["hangs up", "half a header", "unknown command", "promised data missing"],
)
def test_a_host_that_hangs_up_or_talks_nonsense_ends_the_device(
    echo: tuple[Echo, Host, Attachment], nonsense: bytes
) -> None:
    device, host, attachment = echo
    host.link.sendall(nonsense)
    host.link.shutdown(socket.SHUT_WR)
    with pytest.raises(ConnectionError):
        host.receive(1)
    attachment.unplug()
    assert not attachment.alive
    assert device.life[-1] == "unplugged"


def test_unplugging_twice_is_the_same_as_once(echo: tuple[Echo, Host, Attachment]) -> None:
    device, _, attachment = echo
    assert attachment.alive
    attachment.unplug()
    attachment.unplug()
    assert device.life == ["plugged", "unplugged"]


def test_a_port_is_free_only_in_the_state_that_says_so() -> None:
    status = """hub port sta spd dev      sockfd local_busid
hs  0000 006 003 00010001 000003 1-1
hs  0001 004 000 00000000 000000 0-0
ss  0008 004 000 00000000 000000 0-0
"""
    assert [port.number for port in usbip._ports(status) if port.is_free and not port.is_super_speed] == [1]


def test_a_kernel_without_the_module_says_what_to_load(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(usbip, "CONTROLLER", tmp_path / "none")
    for port in (None, 3):
        with pytest.raises(DeviceError, match="modprobe vhci-hcd"):
            usbip.attach(Echo(), port=port)


def test_no_free_port_is_told_before_anything_is_plugged_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "status").write_text("headline\nhs 0000 006 003 00010001 000003 1-1\n")
    monkeypatch.setattr(usbip, "CONTROLLER", tmp_path)
    device = Echo()
    with pytest.raises(DeviceError, match="no free USB port"):
        usbip.attach(device)
    assert device.life == []
