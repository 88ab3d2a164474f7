"""The table of drivers: which function makes the camera or projector that a profile names, here or in other packages.

Each is imported when a profile asks for it: a real camera needs neither the simulated room nor what reads recordings.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import cast

from rig.devices.driver_settings import CameraSettings, ProjectorSettings, RigFactory
from rig.devices.protocols import Camera, Clock, Projector
from rig.errors import RigError, UsageError
from rig.plug_ins import Kind, PlugIn, choose, load, names, own, wrong_type

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


def make_camera(driver: str, settings: CameraSettings, clock: Clock) -> Camera:
    """Make a camera of its settings, closed. Raises UsageError for a driver that cannot be used, ProfileError."""
    plug_in = choose("camera driver", driver, brought_along("camera driver"))
    made = _made(plug_in, settings, clock)
    if not isinstance(made, Camera):
        raise wrong_type(plug_in, made, "a Camera (rig.devices.protocols)")
    return made


def make_projector(driver: str, settings: ProjectorSettings, clock: Clock) -> Projector:
    """Make a projector of its settings, closed. Raises UsageError for a driver that cannot be used, ProfileError."""
    plug_in = choose("projector driver", driver, brought_along("projector driver"))
    made = _made(plug_in, settings, clock)
    if not isinstance(made, Projector):
        raise wrong_type(plug_in, made, "a Projector (rig.devices.protocols)")
    return made


def _made(plug_in: PlugIn, settings: CameraSettings | ProjectorSettings, clock: Clock) -> object:
    """What a driver's function gives; its mistakes are its package's, and say so."""
    factory = load(plug_in)
    if not callable(factory):
        raise wrong_type(plug_in, factory, "a function of settings and clock")
    try:
        made: object = factory(settings, clock)
    except RigError:
        raise
    except Exception as error:
        if plug_in.is_own:
            raise
        raise UsageError(
            f"{plug_in.kind} {plug_in.name!r} of {plug_in.source} fails ({plug_in.value}): {type(error).__name__}: "
            f"{error}; tell its author"
        ) from error
    return made


def rig_factory(driver: str) -> RigFactory:
    """Return what makes all devices of a simulated or replayed rig."""
    (plug_in,) = own("camera driver", {driver: RIGS[driver]})
    return cast(RigFactory, load(plug_in))
