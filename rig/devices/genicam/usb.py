"""USB3 Vision cameras as the kernel sees them: why one is not found, and what its transfers lack."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from rig.devices.usb.find import FoundUsbDevice, find_usb_devices
from rig.devices.usb.permissions import forbidden

_CLASS, _SUBCLASS = 0xEF, 0x05
"""Of the interfaces of USB3 Vision, by that standard."""
_ROOM = Path("sys/module/usbcore/parameters/usbfs_memory_mb")
_MEGABYTE = 1 << 20


def list_usb_vision(root: Path = Path("/")) -> list[FoundUsbDevice]:
    """List what is plugged in and says of itself that it is a USB3 Vision camera; no permission is needed."""
    return [device for device in find_usb_devices(root) if _is_vision(device)]


def _is_vision(device: FoundUsbDevice) -> bool:
    for interface in device.interfaces:
        with suppress(OSError, ValueError):
            subclass = int((interface.folder / "bInterfaceSubClass").read_text(), 16)
            if (interface.class_code, subclass) == (_CLASS, _SUBCLASS):
                return True
    return False


def why_usb_silent(device_id: str, root: Path = Path("/")) -> str:
    """Return why a USB camera may not be found or opened, and what to do.

    Raises
    ------
    DeviceForbidden
        It is there, and this user may not open it: the library does not even list it then. The message holds a rule.
    """
    there = list_usb_vision(root)
    if not there:
        return "no USB3 Vision camera is plugged in: check its power and cable, and see `rig devices`"
    serial = device_id.removeprefix("usb3-")
    meant = next((one for one in there if one.serial == serial), there[0] if len(there) == 1 else None)
    if meant is None:
        listed = ", ".join(f"{one.name} ({one.serial or 'no serial number'})" for one in there)
        return f"plugged in are {listed}; give one of their serial numbers as device_id"
    if not os.access(meant.node, os.R_OK | os.W_OK):
        raise forbidden(meant.node, meant.vendor_id, meant.product_id)
    if driver := next((one.driver for one in meant.interfaces if one.driver), None):
        return f"{meant.name} is held by the kernel's driver {driver}: sudo modprobe -r {driver}"
    return meant.warning or f"{meant.name} is there: close other programs that have it, or plug it in again"


def usb_advice(device_id: str, wanted_bytes: int, root: Path = Path("/")) -> tuple[str, ...]:
    """Return what the transfers of a USB camera lack, a sentence each, with the setting to change.

    Parameters
    ----------
    device_id
        As the profile has it.
    wanted_bytes
        Of all frames that may be under way at once.
    root
        Where ``sys`` and ``dev`` lie.
    """
    found = []
    with suppress(OSError, ValueError):
        limit_mb = int((root / _ROOM).read_text())
        wanted_mb = -(-wanted_bytes // _MEGABYTE)
        if 0 < limit_mb < wanted_mb:  # 0: without limit
            found.append(
                f"USB transfers may keep {limit_mb} MB, {wanted_mb} are wanted: echo {wanted_mb} | sudo tee /{_ROOM}"
            )
    serial = device_id.removeprefix("usb3-")
    found += [one.warning for one in list_usb_vision(root) if one.serial == serial and one.warning]
    return tuple(f"camera {device_id}: {line}" for line in found)
