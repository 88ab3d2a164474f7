"""The table of drivers: which function makes the camera or projector that a profile names, here or in other packages.

Each is imported when a profile asks for it: a real camera needs neither the simulated room nor what reads recordings.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from rig.devices.clock import SystemClock, VirtualClock
from rig.devices.driver_settings import Devices, ProjectorSettings, RigSettings
from rig.devices.protocols import Camera, Clock, Projector
from rig.plug_ins import Kind, PlugIn, made_by, names, own

CAMERAS: Mapping[str, str] = {
    "v4l2": "rig.devices.v4l2.camera:from_profile",
    "genicam": "rig.devices.genicam.camera:from_profile",
    "gphoto2": "rig.devices.gphoto2.camera:from_profile",
}
"""Of single cameras: a CameraFactory by name."""
PROJECTORS: Mapping[str, str] = {
    "kms": "rig.devices.kms.projector:from_profile",
    "window": "rig.devices.window.projector:from_profile",
    "virtual": "rig.devices.virtual.projector:from_profile",
}
"""Of single projectors: a ProjectorFactory by name."""
WITH_OPTIONS = ("genicam", "gphoto2")
"""Of this program's drivers, those that read [camera.options]."""
RIGS: Mapping[str, str] = {
    "simulated": "rig.devices.simulated.rigs:from_profile",
    "replay": "rig.devices.replay.devices:from_profile",
}
"""Whose devices come together: a RigFactory by name."""


def brought_along(kind: Kind) -> tuple[PlugIn, ...]:
    """Return this program's own drivers of a kind."""
    return own(kind, {**(CAMERAS if kind == "camera driver" else PROJECTORS), **RIGS})


def driver_names(kind: Kind) -> tuple[str, ...]:
    """Return the names that a profile may give as a driver, this program's first."""
    return names(kind, brought_along(kind))


def make_devices(profile: RigSettings, start_s: float = 0.0, *, real_time: bool = False) -> Devices:
    """Make all devices of a rig with the drivers that it names, closed, on the clock that fits them.

    Parameters
    ----------
    profile
        The rig.
    start_s
        Where virtual clocks start.
    real_time
        Whether simulated devices go by the machine's clock.

    Raises
    ------
    ProfileError
        Settings make no sense to a driver, or a recording does not fit the profile.
    UsageError
        A driver of another package cannot be used.
    """
    driver = profile.cameras[0].driver
    if driver not in RIGS:
        return _single_devices(profile, SystemClock())
    goes_by_machine = real_time and driver == "simulated"
    clock: Clock = SystemClock() if goes_by_machine else VirtualClock(start_s)
    brought = brought_along("camera driver")
    return made_by("camera driver", driver, (profile, clock), brought=brought, wanted=Devices)


def _single_devices(profile: RigSettings, clock: Clock) -> Devices:
    """Cameras and projectors, each made by a driver of its own."""
    cameras, displays = brought_along("camera driver"), brought_along("projector driver")
    projectors = {
        one.name: _controlled(
            made_by("projector driver", one.driver, (one, clock), brought=displays, wanted=Projector),  # type: ignore[type-abstract]
            one,
            profile.path,
            clock,
        )
        for one in profile.projectors
    }
    made = {
        one.name: made_by("camera driver", one.driver, (one, clock), brought=cameras, wanted=Camera)  # type: ignore[type-abstract]
        for one in profile.cameras
    }
    return Devices(made, projectors, clock)


def _controlled(display: Projector, settings: ProjectorSettings, path: Path, clock: Clock) -> Projector:
    """The display, behind what controls the projector that hangs on it."""
    if settings.lightcrafter is not None:
        from rig.devices.lightcrafter.projector import from_profile as with_lightcrafter

        display = with_lightcrafter(display, settings.lightcrafter, clock)
    if settings.pjlink is not None:
        from rig.devices.network.powered_projector import from_profile as with_pjlink

        display = with_pjlink(display, settings.pjlink, path, clock)
    return display
