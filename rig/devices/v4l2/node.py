"""A device node: opened without blocking, asked by ioctl, every failure turned into the error tree."""

from __future__ import annotations

import ctypes
import errno
import fcntl
import grp
import os
from pathlib import Path
from typing import TypeVar

from rig.devices.clock import SystemClock
from rig.devices.protocols import Clock
from rig.errors import DeviceBusy, DeviceError, DeviceForbidden, DeviceLost, SettingRefused

Argument = TypeVar("Argument", bound=ctypes.Structure)

PATIENCE_S = 1.0
"""How long a refusal that may pass by itself is asked again."""
_AGAIN_AFTER_S = 0.05
"""Between two tries; a person does not notice it."""
GONE = frozenset({errno.ENODEV, errno.ENXIO, errno.ESHUTDOWN})
BUSY = frozenset({errno.EBUSY})
STALLED = BUSY | {errno.EPIPE, errno.EIO, errno.ETIMEDOUT, errno.EPROTO, errno.EAGAIN}
"""What a USB device says that did not understand, or did not hear; a second try often helps."""
_NOT_YET = BUSY | {errno.EACCES, errno.EPERM}
"""On opening: udev gives a new node to its group a moment after it has appeared."""
_NO_MORE = frozenset({errno.EINVAL, errno.ENOTTY, errno.ENODATA})


class Node:
    """An open V4L2 node. Close it, or use it in a ``with`` statement.

    Parameters
    ----------
    path
        Such as ``/dev/video0``.
    clock
        Waits between two attempts. Default: the system's.
    patience_s
        How long an opening that is refused for now is tried again.

    Raises
    ------
    DeviceLost, DeviceBusy, DeviceForbidden, DeviceError
        It does not open.
    """

    def __init__(self, path: Path, clock: Clock | None = None, patience_s: float = PATIENCE_S):
        self.path = path
        self._clock = clock or SystemClock()
        self._fd: int | None = self._open(patience_s)

    def _open(self, patience_s: float) -> int:
        until_s = self._clock.now_s() + patience_s
        while True:
            try:
                return os.open(self.path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
            except OSError as error:
                if error.errno not in _NOT_YET or self._clock.now_s() >= until_s:
                    raise device_error(error, "opening it", self.path) from error
            self._clock.wait_until_s(self._clock.now_s() + _AGAIN_AFTER_S)

    @property
    def fd(self) -> int:
        """Its file descriptor. Raises DeviceLost when closed."""
        if self._fd is None:
            raise DeviceLost(f"{self.path} is closed; open the camera first")
        return self._fd

    def close(self) -> None:
        """Let it go; any number of times."""
        fd, self._fd = self._fd, None
        if fd is not None:
            os.close(fd)

    def __enter__(self) -> Node:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def ioctl(self, request: int, argument: Argument) -> Argument:
        """One ioctl that signals do not cut short; ``argument`` is changed and returned. Raises OSError."""
        while True:
            try:
                fcntl.ioctl(self.fd, request, argument, True)
                return argument
            except InterruptedError:
                continue

    def call(
        self,
        request: int,
        argument: Argument,
        doing: str,
        transient: frozenset[int] = frozenset(),
    ) -> Argument:
        """An ioctl that has to succeed; refusals in ``transient`` are asked again for PATIENCE_S.

        ``doing`` says in the message what was tried. Raises a DeviceError that says why it failed.
        """
        until_s = self._clock.now_s() + PATIENCE_S
        while True:
            try:
                return self.ioctl(request, argument)
            except OSError as error:
                if error.errno not in transient or self._clock.now_s() >= until_s:
                    raise device_error(error, doing, self.path) from error
            self._clock.wait_until_s(self._clock.now_s() + _AGAIN_AFTER_S)

    def ask(self, request: int, argument: Argument) -> bool:
        """Return whether an ioctl is answered: False at the end of a list and where a driver does not know it."""
        try:
            self.ioctl(request, argument)
        except OSError as error:
            if error.errno in _NO_MORE:
                return False
            raise device_error(error, "asking what it offers", self.path) from error
        return True


def device_error(error: OSError, doing: str, path: Path) -> DeviceError:
    """Return what an errno means for the user."""
    number = error.errno or 0
    what = f"{path}: {doing} failed: {os.strerror(number)} ({errno.errorcode.get(number, number)})"
    if number in GONE or number == errno.ENOENT:
        return DeviceLost(f"{what}; the camera is gone: check cable and power, `rig devices` lists what is there")
    if number == errno.EBUSY:
        return DeviceBusy(f"{what}; another program uses the camera: end it (`fuser -v {path}`)")
    if number in (errno.EACCES, errno.EPERM):
        return forbidden(what, path)
    if number in (errno.EINVAL, errno.ERANGE, errno.ENOTTY):
        return SettingRefused(f"{what}; the driver cannot do this: compare with `rig devices`")
    if number == errno.ENOSPC:
        return DeviceError(f"{what}; the USB bus has no room for this stream: take a smaller format or another port")
    return DeviceError(f"{what}; unplug the camera and plug it in again, and look into the kernel's log")


def forbidden(what: str, path: Path) -> DeviceForbidden:
    """The error for a node that the user may not open, with what to do."""
    try:
        group = grp.getgrgid(path.stat().st_gid).gr_name
    except (OSError, KeyError):
        group = "video"
    return DeviceForbidden(
        f"{what}; the node belongs to the group {group!r}: "
        f"`sudo usermod -aG {group} $USER`, then log in again, or ask whoever runs this machine"
    )
