"""Controller of projector-camera rigs."""

from rig.errors import (
    CalibrationFailed,
    CaptureTimeout,
    DeviceError,
    DeviceLost,
    ProfileError,
    RigError,
    SessionCorrupt,
    SessionError,
    SessionLocked,
    SettingRefused,
    UsageError,
)
from rig.pair import Rig, open_rig
from rig.profile import load_profile
from rig.session import Session

__all__ = [
    "CalibrationFailed",
    "CaptureTimeout",
    "DeviceError",
    "DeviceLost",
    "ProfileError",
    "Rig",
    "RigError",
    "Session",
    "SessionCorrupt",
    "SessionError",
    "SessionLocked",
    "SettingRefused",
    "UsageError",
    "load_profile",
    "open_rig",
]
