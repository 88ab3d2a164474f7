"""Controller of projector-camera rigs.

A script opens a session and a rig and calls the verbs of the command line one after the other:
:func:`calibrate`, :func:`separate`, :func:`model`, :func:`compensate`, :func:`compare`, :func:`write_report`
(docs/tutorials/first-session.md).
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rig.capture.rig import Rig, open_rig
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
    from rig.profile.schema import load_profile
    from rig.run.script import calibrate, compare, compensate, model, separate, write_report
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
    "calibrate",
    "compare",
    "compensate",
    "load_profile",
    "model",
    "open_rig",
    "separate",
    "write_report",
]

if not TYPE_CHECKING:
    # Each name is imported when it is first used: `rig --help` needs no numpy, and Ctrl-C meets a quiet import.
    _HOMES = {"Rig": "pair", "open_rig": "pair", "load_profile": "profile", "Session": "session"} | dict.fromkeys(
        ("calibrate", "compare", "compensate", "model", "separate", "write_report"), "workflows.verbs"
    )

    def __getattr__(name):
        if name not in __all__:
            raise AttributeError(f"module 'rig' has no attribute {name!r}")
        from importlib import import_module

        return getattr(import_module(f"rig.{_HOMES.get(name, 'errors')}"), name)
