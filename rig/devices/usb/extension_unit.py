"""Vendor controls of UVC cameras (extension units) through the kernel's own driver, which keeps streaming."""

from __future__ import annotations

import ctypes
import errno
import fcntl
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from uuid import UUID

from rig.devices.clock import SystemClock
from rig.devices.protocols import Clock
from rig.devices.usb.find import each_descriptor
from rig.devices.usb.permissions import forbidden
from rig.errors import DeviceBusy, DeviceError, DeviceLost, SettingRefused

_SETTLING_S, _RETRY_S = 2.0, 0.02
"""How long a node may be busy after its camera was plugged in (a machine with a load of four took some tenths), and how
often it is asked."""


class Query(IntEnum):
    """What can be asked of a control (UVC 1.5, table A-8)."""

    SET_CUR = 0x01
    GET_CUR = 0x81
    GET_MIN = 0x82
    GET_MAX = 0x83
    GET_RES = 0x84
    GET_LEN = 0x85
    GET_INFO = 0x86
    GET_DEF = 0x87


class XuControlQuery(ctypes.Structure):
    """``struct uvc_xu_control_query`` of linux/uvcvideo.h."""

    _fields_ = (
        ("unit", ctypes.c_uint8),
        ("selector", ctypes.c_uint8),
        ("query", ctypes.c_uint8),
        ("size", ctypes.c_uint16),
        ("data", ctypes.c_void_p),
    )


UVCIOC_CTRL_QUERY = 3 << 30 | ctypes.sizeof(XuControlQuery) << 16 | ord("u") << 8 | 0x21
"""_IOWR('u', 0x21, struct uvc_xu_control_query)."""
_INTERFACE, _CLASS_INTERFACE, _EXTENSION_UNIT = 0x04, 0x24, 0x06
_VIDEO_CONTROL = (0x0E, 0x01)
Ioctl = Callable[[int, int, ctypes.Structure], object]


@dataclass(frozen=True, slots=True)
class ExtensionUnit:
    """An extension unit, as its descriptor tells."""

    unit_id: int
    guid: UUID
    selectors: tuple[int, ...]
    """Controls that it says it has."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VendorControl:
    """Length and limits of one control; what the camera does not tell is empty."""

    selector: int
    length: int
    """Of its value. [bytes]"""
    readable: bool
    writable: bool
    minimum: bytes
    maximum: bytes
    default: bytes


def extension_units(descriptors: bytes) -> tuple[ExtensionUnit, ...]:
    """Extension units in a USB device's raw descriptors (sysfs' file ``descriptors``); damaged ones are left out."""
    found = []
    in_video_control = False
    for descriptor in each_descriptor(descriptors):
        if descriptor[1] == _INTERFACE and len(descriptor) >= 9:
            in_video_control = (descriptor[5], descriptor[6]) == _VIDEO_CONTROL
        elif in_video_control and descriptor[1:3] == bytes([_CLASS_INTERFACE, _EXTENSION_UNIT]):
            unit = _unit(descriptor)
            if unit is not None and unit not in found:
                found.append(unit)
    return tuple(found)


def _unit(descriptor: bytes) -> ExtensionUnit | None:
    pins = descriptor[21] if len(descriptor) > 21 else 0
    size_at = 22 + pins
    if len(descriptor) <= size_at:
        return None
    bits = int.from_bytes(descriptor[size_at + 1 : size_at + 1 + descriptor[size_at]], "little")
    selectors = tuple(bit + 1 for bit in range(bits.bit_length()) if bits >> bit & 1)
    return ExtensionUnit(descriptor[3], UUID(bytes_le=descriptor[4:20]), selectors)


def extension_units_of(node: Path, root: Path = Path("/")) -> tuple[ExtensionUnit, ...]:
    """Extension units of the camera behind a video node.

    Raises DeviceLost when the node is no USB camera's, or gone.
    """
    file = root / "sys/class/video4linux" / node.name / "device" / ".." / "descriptors"
    try:
        return extension_units(file.resolve().read_bytes())
    except OSError as error:
        raise DeviceLost(f"{node}: no USB camera has this node ({error.strerror}); `rig devices` lists them") from error


class VendorControls:
    """The controls of one extension unit, by selector, on an open video node.

    Parameters
    ----------
    descriptor
        File descriptor of the video node; may be streaming. Stays the caller's.
    unit_id
        Which unit.
    name
        For messages.
    ioctl
        For tests.
    """

    def __init__(self, descriptor: int, unit_id: int, name: str, ioctl: Ioctl = fcntl.ioctl):
        self._descriptor = descriptor
        self._unit_id = unit_id
        self._name = name
        self._ioctl = ioctl

    def describe(self, selector: int) -> VendorControl:
        """Length, rights and limits of a control. Raises SettingRefused when there is none, DeviceLost."""
        length = int.from_bytes(self._ask(selector, Query.GET_LEN, bytes(2)), "little")
        info = self._ask(selector, Query.GET_INFO, bytes(1))[0]
        return VendorControl(
            selector=selector,
            length=length,
            readable=bool(info & 1),
            writable=bool(info & 2),
            minimum=self._limit(selector, Query.GET_MIN, length),
            maximum=self._limit(selector, Query.GET_MAX, length),
            default=self._limit(selector, Query.GET_DEF, length),
        )

    def read(self, selector: int) -> bytes:
        """Read the value of a control. Raises SettingRefused, DeviceLost, DeviceBusy."""
        length = int.from_bytes(self._ask(selector, Query.GET_LEN, bytes(2)), "little")
        return self._ask(selector, Query.GET_CUR, bytes(length))

    def write(self, selector: int, value: bytes) -> None:
        """Set a control, and read it back where it can be read.

        Raises SettingRefused for a wrong length, a read-only control, a value that the camera refuses or changes;
        DeviceLost, DeviceBusy.
        """
        control = self.describe(selector)
        where = f"{self._name}: control {selector} of unit {self._unit_id}"
        if len(value) != control.length:
            raise SettingRefused(f"{where} has {control.length} bytes, not {len(value)}; give exactly those")
        if not control.writable:
            raise SettingRefused(f"{where} can only be read; leave it out of what is set")
        self._ask(selector, Query.SET_CUR, value)
        if control.readable:
            done = self._ask(selector, Query.GET_CUR, bytes(control.length))
            if done != value:
                raise SettingRefused(f"{where} was set to {value.hex(' ')}, but reads {done.hex(' ')}; see its limits")

    def _limit(self, selector: int, query: Query, length: int) -> bytes:
        try:
            return self._ask(selector, query, bytes(length))
        except SettingRefused:
            return b""

    def _ask(self, selector: int, query: Query, data: bytes) -> bytes:
        buffer = ctypes.create_string_buffer(data, max(1, len(data)))
        request = XuControlQuery(
            unit=self._unit_id, selector=selector, query=query, size=len(data), data=ctypes.addressof(buffer)
        )
        try:
            self._ioctl(self._descriptor, UVCIOC_CTRL_QUERY, request)
        except OSError as error:
            where = f"{self._name}: {query.name} of control {selector} of unit {self._unit_id}"
            raise _named(error, where) from error
        return buffer.raw[: len(data)]


_REFUSALS = {
    errno.ENOENT: "there is no such unit or control; extension_units_of() lists them",
    errno.EPIPE: "the camera refuses it (stall); compare the value with its limits",
    errno.EINVAL: "the driver or the camera finds the value wrong; compare it with its limits",
    errno.ERANGE: "the value is outside its limits",
    errno.EBADRQC: "the control does not know this request",
    errno.ENOBUFS: "the driver expects another length",
    errno.EACCES: "the control is switched off, often by an automatic; switch that off first",
    errno.EILSEQ: "the camera is in a wrong state for it",
    errno.ENOTTY: "this is no UVC camera's node",
}


def _named(error: OSError, where: str) -> DeviceError:
    """Our error for the kernel's number."""
    if error.errno in (errno.ENODEV, errno.ESHUTDOWN):
        return DeviceLost(f"{where}: the camera went away; plug it in again")
    if error.errno == errno.EBUSY:
        return DeviceBusy(f"{where}: the camera is busy with the request before; try again")
    if error.errno in _REFUSALS:
        return SettingRefused(f"{where}: {_REFUSALS[error.errno]} ({errno.errorcode[error.errno]})")
    return DeviceError(f"{where}: {error.strerror}; reset the camera")


@contextmanager
def vendor_controls(
    node: Path, guid: UUID, root: Path = Path("/"), clock: Clock | None = None
) -> Iterator[VendorControls]:
    """The extension unit with a GUID, of the camera behind a video node; open within the ``with`` statement.

    Raises SettingRefused when the camera has no such unit, DeviceLost, DeviceForbidden; DeviceBusy when it does not
    open within two seconds.
    """
    units = extension_units_of(node, root)
    unit = next((unit for unit in units if unit.guid == guid), None)
    if unit is None:
        has = ", ".join(str(unit.guid) for unit in units) or "none"
        raise SettingRefused(f"{node}: no extension unit {guid}; the camera has: {has}")
    descriptor = _opened(node, clock or SystemClock())
    try:
        yield VendorControls(descriptor, unit.unit_id, str(node))
    finally:
        os.close(descriptor)


def _opened(node: Path, clock: Clock) -> int:
    """Open a camera's node, which is busy for a moment after the camera was plugged in."""
    until_s = clock.now_s() + _SETTLING_S
    while True:
        try:
            return os.open(node, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
        except PermissionError as error:
            raise forbidden(node) from error
        except OSError as error:
            if error.errno != errno.EBUSY:
                raise DeviceLost(f"{node}: cannot be opened: {error.strerror}; plug the camera in again") from error
            if clock.now_s() >= until_s:
                raise DeviceBusy(f"{node}: another program holds the camera; close that program") from error
        clock.wait_until_s(clock.now_s() + _RETRY_S)
