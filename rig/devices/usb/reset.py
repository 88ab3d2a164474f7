"""Switch a hung USB device off and on without touching its cable."""

from __future__ import annotations

import errno
import fcntl
import os
from pathlib import Path

from rig.devices.clock import SystemClock
from rig.devices.protocols import Clock
from rig.devices.usb.find import FoundUsbDevice, find_usb_devices
from rig.devices.usb.permissions import forbidden
from rig.errors import DeviceError, DeviceLost

USBDEVFS_RESET = 0x5514
"""_IO('U', 20) of linux/usbdevice_fs.h."""
_POLL_S = 0.05
"""Between two looks whether it is back."""


def reset_usb_device(
    device: FoundUsbDevice | str, *, timeout_s: float = 10.0, clock: Clock | None = None, root: Path = Path("/")
) -> FoundUsbDevice:
    """Reset a device and wait until it is back with all its drivers.

    The kernel's port reset comes first: it works while a kernel driver holds the device, which is bound anew. When
    that fails, the device is de-authorised and authorised again (needs root). Close every file of the device before.

    Parameters
    ----------
    device
        As found, or its bus path (``1-4.2``).
    timeout_s
        How long to wait for its return.
    clock
        Default: the machine's.
    root
        Where ``sys`` and ``dev`` lie.

    Returns
    -------
    The device as it came back, maybe under another node.

    Raises
    ------
    DeviceLost
        Nothing is plugged in there, or it did not come back in time.
    DeviceForbidden
        The user may do neither.
    DeviceError
        The kernel refused both.
    """
    bus_path = device if isinstance(device, str) else device.bus_path
    before = _at(bus_path, root)
    if before is None:
        raise DeviceLost(f"no USB device at {bus_path} to reset; `rig devices` lists what is plugged in")
    try:
        _reset_port(before.node)
    except OSError as error:
        _authorise_again(before, root, error)
    return _wait_until_back(before, timeout_s, clock or SystemClock(), root)


def _at(bus_path: str, root: Path) -> FoundUsbDevice | None:
    return next((device for device in find_usb_devices(root) if device.bus_path == bus_path), None)


def _reset_port(node: Path) -> None:
    descriptor = os.open(node, os.O_WRONLY | os.O_CLOEXEC)
    try:
        fcntl.ioctl(descriptor, USBDEVFS_RESET, 0)
    except OSError as error:
        if error.errno != errno.ENODEV:  # ENODEV: reset so thoroughly that the kernel enumerates it anew
            raise
    finally:
        os.close(descriptor)


def _authorise_again(device: FoundUsbDevice, root: Path, first: OSError) -> None:
    switch = root / "sys/bus/usb/devices" / device.bus_path / "authorized"
    try:
        for value in ("0", "1"):
            switch.write_text(value)
    except PermissionError as error:
        raise forbidden(device.node, device.vendor_id, device.product_id) from error
    except OSError as error:
        raise DeviceError(
            f"{device.name} at {device.bus_path}: cannot be reset ({first.strerror}) nor switched off and on "
            f"({error.strerror}); unplug it and plug it in again"
        ) from error


def _wait_until_back(before: FoundUsbDevice, timeout_s: float, clock: Clock, root: Path) -> FoundUsbDevice:
    deadline_s = clock.now_s() + timeout_s
    while True:
        now = _at(before.bus_path, root)
        if now is not None and now.node.exists() and _is_back(before, now):
            return now
        if clock.now_s() >= deadline_s:
            break
        clock.wait_until_s(min(deadline_s, clock.now_s() + _POLL_S))
    state = "is not there" if now is None else "is there, but not all its drivers are"
    raise DeviceLost(
        f"{before.name} at {before.bus_path} {state} {timeout_s:g} s after its reset; unplug it and plug it in again"
    )


def _is_back(before: FoundUsbDevice, now: FoundUsbDevice) -> bool:
    """The same kind of device, each interface held by the driver it had."""
    drivers = [{interface.number: interface.driver for interface in device.interfaces} for device in (before, now)]
    held = {number: driver for number, driver in drivers[0].items() if driver not in (None, "usbfs")}
    same = (before.vendor_id, before.product_id) == (now.vendor_id, now.product_id)
    return same and all(drivers[1].get(number) == driver for number, driver in held.items())
