"""The table of drivers: which function makes the camera or projector that a profile names, here or in other packages.

Each is imported when a profile asks for it: a real camera needs neither the simulated room nor what reads recordings.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from rig.devices.driver_settings import CameraSettings, Devices, ProjectorSettings, RigSettings
from rig.devices.protocols import Camera, Clock, Projector
from rig.plug_ins import Kind, PlugIn, choose, make, names, own, wrong_type

CAMERAS: Mapping[str, str] = {"v4l2": "rig.devices.v4l2.camera:from_profile"}
"""Of single cameras: a CameraFactory by name."""
PROJECTORS: Mapping[str, str] = {
    "kms": "rig.devices.kms.projector:from_profile",
    "window": "rig.devices.window.projector:from_profile",
}
"""Of single projectors: a ProjectorFactory by name."""
RIGS: Mapping[str, str] = {
    "simulated": "rig.devices.simulated.devices:from_profile",
    "replay": "rig.devices.replay.devices:from_profile",
}
"""Whose devices come together: a RigFactory by name."""


def brought_along(kind: Kind) -> tuple[PlugIn, ...]:
    """Return this program's own drivers of a kind."""
    return own(kind, {**(CAMERAS if kind == "camera driver" else PROJECTORS), **RIGS})


def driver_names(kind: Kind) -> tuple[str, ...]:
    """Return the names that a profile may give as a driver, this program's first."""
    return names(kind, brought_along(kind))


def make_devices_of(profile: RigSettings, clock: Clock) -> Devices:
    """Make all devices of a rig with the drivers that it names, closed.

    Raises ProfileError for settings that make no sense to a driver, UsageError for a driver that cannot be used.
    """
    if profile.camera.driver in RIGS:
        return _rig(profile, clock)
    cameras = {one.name: _camera(one, clock) for one in profile.cameras}
    return Devices(cameras, {one.name: _projector(one, profile.path, clock) for one in profile.projectors}, clock)


def _rig(profile: RigSettings, clock: Clock) -> Devices:
    plug_in = choose("camera driver", profile.camera.driver, brought_along("camera driver"))
    made = make(plug_in, profile, clock)
    if not isinstance(made, Devices):
        raise wrong_type(plug_in, made, "Devices (rig.devices.driver_settings)")
    return made


def _camera(settings: CameraSettings, clock: Clock) -> Camera:
    plug_in = choose("camera driver", settings.driver, brought_along("camera driver"))
    made = make(plug_in, settings, clock)
    if not isinstance(made, Camera):
        raise wrong_type(plug_in, made, "a Camera (rig.devices.protocols)")
    return made


def _projector(settings: ProjectorSettings, path: Path, clock: Clock) -> Projector:
    """The display, behind what controls the projector that hangs on it."""
    plug_in = choose("projector driver", settings.driver, brought_along("projector driver"))
    made = make(plug_in, settings, clock)
    if not isinstance(made, Projector):
        raise wrong_type(plug_in, made, "a Projector (rig.devices.protocols)")
    if settings.lightcrafter is not None:
        from rig.devices.lightcrafter.projector import from_profile as with_lightcrafter

        made = with_lightcrafter(made, settings.lightcrafter, clock)
    if settings.pjlink is not None:
        from rig.devices.network.powered_projector import from_profile as with_pjlink

        made = with_pjlink(made, settings.pjlink, path, clock)
    return made
