"""The one error tree: every message says what happened, which number met which limit, and what to try."""

from __future__ import annotations


class RigError(Exception):
    """Anything that this product reports to its user rather than to its programmer."""

    exit_code = 1


class UsageError(RigError):
    """A wrong argument or an unusable input file of the user's."""

    exit_code = 2


class ProfileError(RigError):
    """A hardware profile that cannot be used; the message lists every problem, a line each."""

    exit_code = 2


class DeviceError(RigError):
    """A camera or projector that did not do what it was asked."""

    exit_code = 3


class DeviceLost(DeviceError):
    """The device went away, or (replay) the recording ends before the request."""


class NotRecorded(DeviceError):
    """A recording in the place of the devices lacks what is asked for."""


class DeviceBusy(DeviceError):
    """Another program holds the device."""


class DeviceForbidden(DeviceError):
    """The user may not open the device; the message says how to allow it."""


class CaptureTimeout(DeviceError):
    """No acceptable frame came in time."""


class SettingRefused(DeviceError):
    """The device cannot do what it was asked to, or did something else."""


class SessionError(RigError):
    """The session folder cannot be used as asked."""

    exit_code = 4


class SessionLocked(SessionError):
    """Another living process works on the session."""


class SessionCorrupt(SessionError):
    """The files of a session contradict its journal."""


class CalibrationFailed(RigError):
    """The captures do not determine what was asked for."""
