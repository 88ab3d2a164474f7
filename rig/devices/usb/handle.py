"""Handles of USB devices by pyusb, for those that no kernel driver serves."""

from __future__ import annotations

from typing import Any

import usb.backend.libusb1
import usb.core

from rig.devices.usb.find import FoundUsbDevice
from rig.devices.usb.permissions import forbidden
from rig.errors import DeviceError, DeviceForbidden, DeviceLost

NO_LIBRARY = (
    "pyusb finds no libusb library; install it: `sudo apt-get install libusb-1.0-0` (Debian, Ubuntu), "
    "`sudo dnf install libusb1` (Fedora), or `pip install libusb-package`"
)


def libusb() -> Any:
    """Give pyusb's backend. Raises DeviceError, with the package to install, when there is no libusb library."""
    backend = usb.backend.libusb1.get_backend()
    if backend is None:
        raise DeviceError(NO_LIBRARY)
    return backend


def open_usb_device(found: FoundUsbDevice) -> Any:
    """Open a device that sysfs shows as pyusb's; give it back by ``usb.util.dispose_resources``.

    libusb hears from udev of what is plugged in after its first use; without udev it does not find that.
    Raises DeviceError without a libusb library, DeviceLost when it is gone, DeviceForbidden without permission.
    """
    bus, address = int(found.node.parent.name), int(found.node.name)
    device = usb.core.find(bus=bus, address=address, backend=libusb())
    if device is None:
        raise DeviceLost(f"{found.name} is no longer at {found.bus_path}; plug it in again")
    try:
        _ = device.bcdDevice, device.get_active_configuration()
    except usb.core.USBError as error:
        raise usb_error(error, found) from error
    return device


def usb_error(error: Exception, found: FoundUsbDevice) -> DeviceError:
    """Our error for one of pyusb's."""
    number = getattr(error, "errno", None)
    if number in (13, 1):
        denied: DeviceForbidden = forbidden(found.node, found.vendor_id, found.product_id)
        return denied
    if number == 19:
        return DeviceLost(f"{found.name} at {found.bus_path} went away; plug it in again")
    return DeviceError(f"{found.name} at {found.bus_path}: {error}")
