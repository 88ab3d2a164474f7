"""How the emulated camera describes itself: formats, sizes, frame rates, units, endpoints.

Layouts are those of the USB Video Class 1.1, chapter 3, and of its payload documents for uncompressed and MJPEG.
"""

from __future__ import annotations

import struct
import uuid
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from rig.emulated.usbip.device import HOST_READS, Descriptors, configuration_descriptor, device_descriptor
from rig.emulated.uvc.controls import (
    CAMERA_TERMINAL,
    EXTENSION_UNIT,
    OUTPUT_TERMINAL,
    PROCESSING_UNIT,
    VENDOR_CONTROLS,
    Control,
    bit_map,
)
from rig.emulated.uvc.formats import FOURCCS, bits_per_pixel

VIDEO_ENDPOINT = 1 | HOST_READS
ISO_PACKET_BYTES = 3072
"""Three transactions of 1024 bytes in each microframe of 125 µs: the most of high speed."""
PAYLOAD_HEADER_BYTES = 2
EXTENSION_GUID = uuid.UUID("7a4c1b52-51d2-4c0e-9f0a-2f6f3e5b8d10")
"""By which a program finds the vendor's controls."""
CONTROL_INTERFACE, STREAMING_INTERFACE = 0, 1
INTERVAL_UNITS_PER_S = 10_000_000
_FOURCC_GUIDS = {"GREY": b"Y800", "YUYV": b"YUY2"}
_GUID_TAIL = bytes.fromhex("00001000800000aa00389b71")
_CLASS_VERSION = 0x0110
_CLOCK_HZ = 48_000_000
_VIDEO_CLASS, _CONTROL_SUBCLASS, _STREAMING_SUBCLASS = 0x0E, 1, 2
_MISCELLANEOUS_CLASS = (0xEF, 2, 1)
_PROBE = struct.Struct("<HBBI10xIIIBBBB")


class Transport(Enum):
    """How frames travel."""

    ISOCHRONOUS = "isochronous"
    BULK = "bulk"


@dataclass(frozen=True, slots=True)
class VideoSize:
    """A picture size and its frame rates, fastest first."""

    width_px: int
    height_px: int
    frame_rates_hz: tuple[float, ...]

    @property
    def intervals(self) -> tuple[int, ...]:
        """The frame rates' periods, in units of 100 ns."""
        return tuple(round(INTERVAL_UNITS_PER_S / rate) for rate in self.frame_rates_hz)


@dataclass(frozen=True, slots=True)
class VideoFormat:
    """A pixel format, by its V4L2 code of four characters, and its sizes."""

    fourcc: str
    sizes: tuple[VideoSize, ...]

    def frame_bytes(self, size: VideoSize) -> int:
        """Bytes of a frame; for MJPG the most it may have."""
        return size.width_px * size.height_px * bits_per_pixel(self.fourcc) // 8


def video_formats(
    fourccs: Sequence[str] = ("GREY", "YUYV"),
    sizes: Sequence[tuple[int, int]] = ((640, 480), (320, 240)),
    frame_rates_hz: Sequence[float] = (30, 15, 5),
) -> tuple[VideoFormat, ...]:
    """Every format in every size, (width, height), at every frame rate; the first of each is the default.

    Raises ValueError for a format that is not one of the camera's.
    """
    padded = [fourcc.ljust(4) for fourcc in fourccs]
    unknown = [fourcc for fourcc in padded if fourcc not in FOURCCS]
    if unknown:
        raise ValueError(f"the emulated camera has no format {unknown[0]!r}; there are {', '.join(FOURCCS)}")
    every = tuple(VideoSize(width, height, tuple(frame_rates_hz)) for width, height in sizes)
    return tuple(VideoFormat(fourcc, every) for fourcc in padded)


@dataclass(frozen=True, slots=True, kw_only=True)
class NegotiatedStream:
    """What host and camera have agreed on."""

    format_index: int
    size_index: int
    interval: int
    """In units of 100 ns."""
    frame_bytes: int
    payload_bytes: int
    """The most of one transfer's payload: a packet, or (bulk) a frame with its header."""

    def pack(self) -> bytes:
        """The 34 bytes of probe and commit."""
        numbers = (1, self.format_index, self.size_index, self.interval, self.frame_bytes, self.payload_bytes)
        return _PROBE.pack(*numbers, _CLOCK_HZ, 0, 0, 0, 0)


PROBE_BYTES = _PROBE.size


def negotiate(formats: Sequence[VideoFormat], transport: Transport, wish: bytes = b"") -> NegotiatedStream:
    """Return what the camera offers for a host's wish (the first 8 bytes of probe): the nearest that it has."""
    _, format_index, size_index, interval = struct.unpack_from("<HBBI", wish.ljust(8, b"\0"))
    format_index = min(max(format_index, 1), len(formats))
    chosen = formats[format_index - 1]
    size_index = min(max(size_index, 1), len(chosen.sizes))
    size = chosen.sizes[size_index - 1]
    wanted = interval or size.intervals[0]
    frame_bytes = chosen.frame_bytes(size)
    payload = ISO_PACKET_BYTES if transport is Transport.ISOCHRONOUS else frame_bytes + PAYLOAD_HEADER_BYTES
    nearest = min(size.intervals, key=lambda each: abs(each - wanted))
    return NegotiatedStream(
        format_index=format_index,
        size_index=size_index,
        interval=nearest,
        frame_bytes=frame_bytes,
        payload_bytes=payload,
    )


def camera_descriptors(
    formats: Sequence[VideoFormat],
    controls: Sequence[Control],
    transport: Transport,
    *,
    name: str,
    serial: str,
    vendor_id: int,
    product_id: int,
) -> Descriptors:
    """All that the camera says of itself."""
    association = bytes([8, 0x0B, 0, 2, _VIDEO_CLASS, 3, 0, 2])
    body = association + _control_interface(controls) + _streaming_interface(formats, transport)
    device = device_descriptor(vendor_id, product_id, _MISCELLANEOUS_CLASS, serial=bool(serial))
    return Descriptors(device, configuration_descriptor(2, body), ("procam-rig", name, serial))


def _interface(number: int, alternate: int, endpoints: int, subclass: int) -> bytes:
    return bytes([9, 4, number, alternate, endpoints, _VIDEO_CLASS, subclass, 0, 0])


def _class_specific(subtype: int, body: bytes) -> bytes:
    return bytes([3 + len(body), 0x24, subtype]) + body


def _control_interface(controls: Sequence[Control]) -> bytes:
    units = _camera_terminal(controls) + _processing_unit(controls) + _extension_unit() + _output_terminal()
    header_bytes = 13
    header = struct.pack("<HHIBB", _CLASS_VERSION, header_bytes + len(units), _CLOCK_HZ, 1, STREAMING_INTERFACE)
    return _interface(CONTROL_INTERFACE, 0, 0, _CONTROL_SUBCLASS) + _class_specific(1, header) + units


def _camera_terminal(controls: Sequence[Control]) -> bytes:
    bits = bit_map([control for control in controls if control.unit == CAMERA_TERMINAL], 3)
    return _class_specific(2, struct.pack("<BHBBHHHB", CAMERA_TERMINAL, 0x0201, 0, 0, 0, 0, 0, len(bits)) + bits)


def _processing_unit(controls: Sequence[Control]) -> bytes:
    bits = bit_map([control for control in controls if control.unit == PROCESSING_UNIT], 2)
    head = struct.pack("<BBHB", PROCESSING_UNIT, CAMERA_TERMINAL, 0, len(bits))
    return _class_specific(5, head + bits + bytes(2))


def _extension_unit() -> bytes:
    bits = sum(1 << (control.selector - 1) for control in VENDOR_CONTROLS)
    head = bytes([EXTENSION_UNIT]) + EXTENSION_GUID.bytes_le
    return _class_specific(6, head + bytes([len(VENDOR_CONTROLS), 1, PROCESSING_UNIT, 1, bits, 0]))


def _output_terminal() -> bytes:
    return _class_specific(3, struct.pack("<BHBBB", OUTPUT_TERMINAL, 0x0101, 0, EXTENSION_UNIT, 0))


def _streaming_interface(formats: Sequence[VideoFormat], transport: Transport) -> bytes:
    body = b"".join(_format(index, each) for index, each in enumerate(formats, 1))
    header_bytes = 13 + len(formats)
    head = struct.pack(
        "<BHBBBBBBB", len(formats), header_bytes + len(body), VIDEO_ENDPOINT, 0, OUTPUT_TERMINAL, 0, 0, 0, 1
    )
    described = _class_specific(1, head + bytes(len(formats))) + body
    if transport is Transport.BULK:
        return _interface(STREAMING_INTERFACE, 0, 1, _STREAMING_SUBCLASS) + described + _endpoint(2, 512, 0)
    endpoint = _endpoint(5, 1024 | 2 << 11, 1)
    idle = _interface(STREAMING_INTERFACE, 0, 0, _STREAMING_SUBCLASS)
    return idle + described + _interface(STREAMING_INTERFACE, 1, 1, _STREAMING_SUBCLASS) + endpoint


def _endpoint(attributes: int, packet_size: int, interval: int) -> bytes:
    return struct.pack("<BBBBHB", 7, 5, VIDEO_ENDPOINT, attributes, packet_size, interval)


def _format(index: int, described: VideoFormat) -> bytes:
    compressed = described.fourcc == "MJPG"
    if compressed:
        head = _class_specific(6, bytes([index, len(described.sizes), 0, 1, 0, 0, 0, 0]))
    else:
        guid = _FOURCC_GUIDS.get(described.fourcc, described.fourcc.encode()) + _GUID_TAIL
        bits = bits_per_pixel(described.fourcc)
        head = _class_specific(4, bytes([index, len(described.sizes)]) + guid + bytes([bits, 1, 0, 0, 0, 0]))
    subtype = 7 if compressed else 5
    sizes = [_class_specific(subtype, _size(described, number)) for number in range(1, len(described.sizes) + 1)]
    colours = _class_specific(0x0D, bytes([1, 1, 4]))
    return head + b"".join(sizes) + colours


def _size(described: VideoFormat, index: int) -> bytes:
    size = described.sizes[index - 1]
    frame_bytes, rates, intervals = described.frame_bytes(size), size.frame_rates_hz, size.intervals
    slowest, fastest = (min(round(frame_bytes * 8 * rate(rates)), 0xFFFFFFFF) for rate in (min, max))
    head = struct.pack("<BBHHIII", index, 0, size.width_px, size.height_px, slowest, fastest, frame_bytes)
    return head + struct.pack(f"<IB{len(intervals)}I", intervals[0], len(intervals), *intervals)
