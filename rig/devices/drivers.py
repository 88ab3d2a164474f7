"""The table of drivers: which function makes the camera or projector that a profile names, here or in other packages.

Each is imported when a profile asks for it: a real camera needs neither the simulated room nor what reads recordings.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import cast

from rig.devices.driver_settings import CameraFactory, CameraSettings, ProjectorFactory, ProjectorSettings, RigFactory
from rig.devices.protocols import Camera, Clock, Projector
from rig.plug_ins import Kind, PlugIn, choose, load, others, own, wrong_type

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
    return (*(CAMERAS if kind == "camera driver" else PROJECTORS), *RIGS, *(one.name for one in others(kind)))


def make_camera(driver: str, settings: CameraSettings, clock: Clock) -> Camera:
    """Make a camera of its settings, closed. Raises UsageError for a driver that is none, ProfileError."""
    plug_in = choose("camera driver", driver, brought_along("camera driver"))
    made = cast(CameraFactory, _function(plug_in))(settings, clock)
    if not isinstance(made, Camera):
        raise wrong_type(plug_in, made, "a Camera (rig.devices.protocols)")
    return made


def make_projector(driver: str, settings: ProjectorSettings, clock: Clock) -> Projector:
    """Make a projector of its settings, closed. Raises UsageError for a driver that is none, ProfileError."""
    plug_in = choose("projector driver", driver, brought_along("projector driver"))
    made = cast(ProjectorFactory, _function(plug_in))(settings, clock)
    if not isinstance(made, Projector):
        raise wrong_type(plug_in, made, "a Projector (rig.devices.protocols)")
    return made


def rig_factory(driver: str) -> RigFactory:
    """Return what makes all devices of a simulated or replayed rig."""
    (plug_in,) = own("camera driver", {driver: RIGS[driver]})
    return cast(RigFactory, load(plug_in))


def _function(plug_in: PlugIn) -> object:
    found = load(plug_in)
    if not callable(found):
        raise wrong_type(plug_in, found, "a function of settings and clock")
    return found
