"""Reports to and from a USB HID device: through the kernel's hidraw node, or by libusb where there is none."""

from __future__ import annotations

import errno
import fcntl
import os
import select
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, Protocol

import usb.core
import usb.util

from rig.devices.usb.find import HID_CLASS, FoundUsbDevice, find_usb_devices
from rig.devices.usb.handle import open_usb_device, usb_error
from rig.devices.usb.permissions import forbidden
from rig.errors import DeviceBusy, DeviceError, DeviceForbidden, DeviceLost

REPORT_BYTES = 64


class HidTransport(Protocol):
    """A way to exchange reports of 64 bytes, without a report number."""

    def write_report(self, report: bytes) -> None:
        """Send one report. Raises DeviceLost."""
        ...

    def read_report(self, timeout_s: float) -> bytes | None:
        """Return the next report, or None when none comes in time. Raises DeviceLost."""
        ...

    def close(self) -> None:
        """Let go; any number of times."""
        ...


def find_hid_device(
    vendor_id: int, product_id: int, serial: str | None = None, root: Path = Path("/")
) -> FoundUsbDevice:
    """Find a device by its USB ids, and by its serial number where one is given.

    Raises DeviceLost when there is none, or when there are several to choose from; the message lists what is there.
    """
    ids = [
        device for device in find_usb_devices(root) if (device.vendor_id, device.product_id) == (vendor_id, product_id)
    ]
    found = [device for device in ids if serial in (None, device.serial)]
    if len(found) == 1:
        return found[0]
    there = ", ".join(f"serial {device.serial} at {device.bus_path}" for device in ids) or "none"
    wanted = f"{vendor_id:04x}:{product_id:04x}" + (f" with serial {serial}" if serial else "")
    hint = "give the serial number" if found else "check its cable and power"
    raise DeviceLost(f"{len(found)} USB devices {wanted}, wanted is one; plugged in: {there}; {hint}")


def hidraw_node(device: FoundUsbDevice, root: Path = Path("/")) -> Path:
    """The hidraw node of a device's first HID interface. Raises DeviceLost when the kernel made none."""
    for interface in device.interfaces:
        if interface.class_code == HID_CLASS:
            for folder in sorted(interface.folder.glob("*/hidraw/hidraw*")):
                return root / "dev" / folder.name
    raise DeviceLost(
        f"{device.name} at {device.bus_path} has no hidraw node; `sudo modprobe usbhid`, or plug it in again"
    )


def open_hid(device: FoundUsbDevice, root: Path = Path("/")) -> HidTransport:
    """Open a HID device by the kernel's hidraw node; by libusb where the kernel has none for it.

    A kernel without hidraw, or without a driver for the interface, leaves the device to user space.
    Raises DeviceLost, DeviceForbidden (with a udev rule), DeviceBusy; DeviceError without a libusb library.
    """
    try:
        node = hidraw_node(device, root)
    except DeviceLost:
        return LibusbTransport(device)
    return HidrawTransport(device, node)


class HidrawTransport:
    """Reports through ``/dev/hidrawN``; the kernel's driver stays.

    Raises DeviceForbidden (with a udev rule), DeviceBusy when another program of ours has it, DeviceLost.
    """

    def __init__(self, device: FoundUsbDevice, node: Path):
        self._name = device.name
        try:
            self._descriptor = os.open(node, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
        except PermissionError as error:
            raise forbidden(node, device.vendor_id, device.product_id) from error
        except OSError as error:
            raise DeviceLost(f"{self._name}: {node}: {error.strerror}; plug it in again") from error
        self._lock(node)

    def _lock(self, node: Path) -> None:
        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            self.close()
            raise DeviceBusy(f"{self._name}: another program controls {node}; end it") from error

    def write_report(self, report: bytes) -> None:
        """Send one report of 64 bytes. Raises DeviceLost."""
        try:
            os.write(self._descriptor, b"\0" + report)
        except OSError as error:
            raise self._lost(error) from error

    def read_report(self, timeout_s: float) -> bytes | None:
        """Return the next report, or None when none comes in time. Raises DeviceLost."""
        poll = select.poll()
        poll.register(self._descriptor, select.POLLIN)
        if not poll.poll(max(0.0, timeout_s) * 1e3):
            return None
        try:
            return os.read(self._descriptor, REPORT_BYTES)
        except BlockingIOError:
            return None
        except OSError as error:
            raise self._lost(error) from error

    def close(self) -> None:
        """Let go; any number of times."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def _lost(self, error: OSError) -> DeviceLost:
        if error.errno in (errno.ETIMEDOUT, errno.EPIPE):
            return DeviceLost(f"{self._name} takes no report ({error.strerror}); switch it off and on")
        return DeviceLost(f"{self._name} went away ({error.strerror}); check its cable and power")


class LibusbTransport:
    """Reports by libusb; takes the HID interface away from the kernel's driver until it is closed.

    Raises DeviceError without a libusb library, DeviceForbidden, DeviceBusy, DeviceLost.
    """

    def __init__(self, device: FoundUsbDevice):
        self._found = device
        self._number = next((each.number for each in device.interfaces if each.class_code == HID_CLASS), 0)
        self._device: Any = open_usb_device(device)
        self._detached = False
        with ExitStack() as undo:
            undo.callback(self.close)
            try:
                self._claim()
            except usb.core.USBError as error:
                if error.errno == errno.EBUSY:
                    raise DeviceBusy(f"{device.name}: another program holds its interface; end it") from error
                raise usb_error(error, device) from error
            undo.pop_all()

    def _claim(self) -> None:
        if self._device.is_kernel_driver_active(self._number):
            self._device.detach_kernel_driver(self._number)
            self._detached = True
        usb.util.claim_interface(self._device, self._number)
        endpoints = self._device.get_active_configuration()[(self._number, 0)].endpoints()
        ways = {usb.util.endpoint_direction(endpoint.bEndpointAddress): endpoint for endpoint in endpoints}
        if set(ways) != {usb.util.ENDPOINT_IN, usb.util.ENDPOINT_OUT}:
            raise DeviceError(
                f"{self._found.name}: interface {self._number} has not one endpoint each way, so this program cannot "
                "control it alone; go by the kernel's driver: sudo modprobe usbhid"
            )
        self._in, self._out = ways[usb.util.ENDPOINT_IN], ways[usb.util.ENDPOINT_OUT]

    def write_report(self, report: bytes) -> None:
        """Send one report of 64 bytes. Raises DeviceLost."""
        try:
            self._out.write(report, timeout=1000)
        except usb.core.USBError as error:
            raise self._lost(error) from error

    def read_report(self, timeout_s: float) -> bytes | None:
        """Return the next report, or None when none comes in time. Raises DeviceLost."""
        try:
            return bytes(self._in.read(REPORT_BYTES, timeout=max(1, round(timeout_s * 1e3))))
        except usb.core.USBTimeoutError:
            return None
        except usb.core.USBError as error:
            raise self._lost(error) from error

    def close(self) -> None:
        """Give the interface back to the kernel's driver; any number of times."""
        device, self._device = self._device, None
        if device is None:
            return
        with suppress(usb.core.USBError):
            usb.util.release_interface(device, self._number)
        if self._detached:
            with suppress(usb.core.USBError):
                device.attach_kernel_driver(self._number)
        usb.util.dispose_resources(device)

    def _lost(self, error: Exception) -> DeviceError:
        ours = usb_error(error, self._found)
        if isinstance(ours, DeviceLost | DeviceForbidden):
            return ours
        return DeviceLost(f"{self._found.name} went away ({error}); check its cable and power")
