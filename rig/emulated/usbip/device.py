"""What an emulated USB device is: descriptors, control requests and transfers, and nothing of how it is plugged in.

Values are those of the USB 2.0 specification, chapters 8 and 9.
"""

from __future__ import annotations

import errno
import struct
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple, Protocol

HOST_READS = 0x80
"""Bit of a request type or an endpoint's address: data go from the device to the host."""
_TYPE_MASK, _RECIPIENT_MASK = 0x60, 0x1F
_DEVICE, _CONFIGURATION, _STRING, _QUALIFIER = 1, 2, 3, 6
_ENGLISH = 0x0409


class _Request(IntEnum):
    """Requests that the standard asks of every device."""

    GET_STATUS = 0
    CLEAR_FEATURE = 1
    SET_FEATURE = 3
    GET_DESCRIPTOR = 6
    GET_CONFIGURATION = 8
    SET_CONFIGURATION = 9
    GET_INTERFACE = 10
    SET_INTERFACE = 11


class UsbSpeed(IntEnum):
    """How fast a device is, in the kernel's numbers."""

    LOW = 1
    FULL = 2
    HIGH = 3


class Stall(Exception):
    """The device refuses a request; the host sees EPIPE."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """The eight bytes that begin a control transfer."""

    request_type: int
    request: int
    value: int
    index: int
    length: int

    @property
    def host_reads(self) -> bool:
        """Whether the device sends data."""
        return bool(self.request_type & HOST_READS)

    @classmethod
    def parse(cls, data: bytes) -> Setup:
        """Read it from 8 bytes."""
        request_type, request, value, index, length = struct.unpack("<BBHHH", data)
        return cls(request_type=request_type, request=request, value=value, index=index, length=length)


class IsoPacket(NamedTuple):
    """One packet of an isochronous transfer: where it lies in the host's buffer, and what came."""

    offset: int
    length: int
    actual_length: int = 0
    status: int = 0


_ISO_PACKET = struct.Struct(">IIIi")
ISO_PACKET_BYTES = _ISO_PACKET.size
"""Of a packet's row in a transfer's table."""


def parse_packets(table: bytes) -> list[IsoPacket]:
    """The packets of a transfer's table."""
    return [IsoPacket(*fields) for fields in _ISO_PACKET.iter_unpack(table)]


def pack_packets(packets: Iterable[IsoPacket]) -> bytes:
    """The table of some packets: 16 bytes each."""
    return b"".join([_ISO_PACKET.pack(*packet) for packet in packets])


Bytes = bytes | bytearray | memoryview
Answer = Callable[["Transfer", Sequence[Bytes], int, bytes], bool]


@dataclass(frozen=True, slots=True, kw_only=True)
class Transfer:
    """What the host wants of an endpoint other than 0; the device answers now or later, from any thread."""

    number: int
    """Unique while the device is plugged in."""
    endpoint: int
    """Its address, with HOST_READS when the host reads."""
    length: int
    """Bytes that the host sends, or has room for."""
    data: bytes
    """What the host sends; empty when it reads."""
    packet_table: bytes
    """Isochronous only: see :func:`parse_packets`; raw, because it is the same in thousands of transfers."""
    answer: Answer

    def complete(self, *data: Bytes, status: int = 0, packet_table: bytes = b"") -> bool:
        """Answer it: what the host reads (in pieces), or nothing. False when the host has taken it back or is gone.

        An isochronous transfer is answered with the data of all packets without gaps, and as many packets in the
        table as the host asked for.
        """
        return self.answer(self, data, status, packet_table)

    def stall(self) -> bool:
        """Refuse it: the endpoint is halted. False as in :meth:`complete`."""
        return self.complete(status=-errno.EPIPE)


@dataclass(frozen=True, slots=True)
class Descriptors:
    """What a device says of itself, ready to send."""

    device: bytes
    configuration: bytes
    """With all interfaces, endpoints and class descriptors."""
    strings: tuple[str, ...]
    """Number 1 first."""

    def find(self, kind: int, index: int) -> bytes:
        """One descriptor. Raises Stall when there is none."""
        if kind == _DEVICE:
            return self.device
        if kind == _CONFIGURATION and index == 0:
            return self.configuration
        if kind == _STRING and index <= len(self.strings):
            return self._string(index)
        if kind == _QUALIFIER:
            return struct.pack("<BB", 10, _QUALIFIER) + self.device[2:8] + b"\x01\x00"
        raise Stall

    def _string(self, index: int) -> bytes:
        body = struct.pack("<H", _ENGLISH) if index == 0 else self.strings[index - 1].encode("utf-16-le")
        return bytes([2 + len(body), _STRING]) + body


class UsbDevice(Protocol):
    """An emulated device. Its methods are called from one thread; none may wait long, or the host waits too."""

    @property
    def speed(self) -> UsbSpeed:
        """The device's speed."""
        ...

    @property
    def descriptors(self) -> Descriptors:
        """The device's descriptors; they must not change while it is plugged in."""
        ...

    def plugged(self) -> None:
        """The host has it; requests follow."""
        ...

    def unplugged(self) -> None:
        """The cable is out: answer nothing more, end threads."""
        ...

    def control(self, setup: Setup, data: bytes) -> bytes:
        """Answer a request of its class or vendor, or one that the standard leaves to it. Raises Stall to refuse."""
        ...

    def select(self, interface: int, alternate: int) -> None:
        """The host chose an alternate setting; (-1, 0): a configuration, as it does after each reset."""
        ...

    def submit(self, transfer: Transfer) -> None:
        """Take a transfer of an endpoint other than 0; complete it now, or keep it until there is an answer."""
        ...


def device_descriptor(
    vendor_id: int, product_id: int, device_class: tuple[int, int, int] = (0, 0, 0), *, serial: bool = True
) -> bytes:
    """18 bytes: USB 2.0, one configuration; strings 1, 2 and (with ``serial``) 3 are manufacturer, product, serial."""
    head = struct.pack("<BBHBBBB", 18, _DEVICE, 0x0200, *device_class, 64)
    return head + struct.pack("<HHHBBBB", vendor_id, product_id, 0x0100, 1, 2, 3 if serial else 0, 1)


def configuration_descriptor(interfaces: int, body: bytes, *, current_ma: int = 500) -> bytes:
    """A bus-powered configuration around the descriptors of its interfaces."""
    return struct.pack("<BBHBBBBB", 9, _CONFIGURATION, 9 + len(body), interfaces, 1, 0, 0x80, current_ma // 2) + body


class StandardRequests:
    """Answers for any device what the standard asks of all; leaves the rest to the device."""

    def __init__(self, device: UsbDevice):
        self._device = device
        self._configuration = 0
        self._alternates: dict[int, int] = {}

    def answer(self, setup: Setup, data: bytes) -> bytes:
        """Data for the host, not longer than it asked for. Raises Stall when the device refuses."""
        is_standard = setup.request_type & _TYPE_MASK == 0
        known = self._standard(setup) if is_standard else None
        return (self._device.control(setup, data) if known is None else known)[: setup.length]

    def _standard(self, setup: Setup) -> bytes | None:
        to_device = setup.request_type & _RECIPIENT_MASK == 0
        match setup.request:
            case _Request.GET_DESCRIPTOR if to_device:
                return self._device.descriptors.find(setup.value >> 8, setup.value & 0xFF)
            case _Request.GET_STATUS:
                return b"\0\0"
            case _Request.CLEAR_FEATURE | _Request.SET_FEATURE:
                return b""
            case _Request.GET_CONFIGURATION:
                return bytes([self._configuration])
            case _Request.SET_CONFIGURATION:
                return self._configure(setup.value)
            case _Request.GET_INTERFACE:
                return bytes([self._alternates.get(setup.index, 0)])
            case _Request.SET_INTERFACE:
                return self._select(setup.index, setup.value)
        return None

    def _configure(self, value: int) -> bytes:
        self._configuration = value
        self._alternates.clear()
        self._device.select(-1, 0)
        return b""

    def _select(self, interface: int, alternate: int) -> bytes:
        self._alternates[interface] = alternate
        self._device.select(interface, alternate)
        return b""
