"""The devices that a profile describes, made with the drivers that it names, on the clock that fits them."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from rig.devices.clock import SystemClock, VirtualClock
from rig.devices.driver_settings import Devices
from rig.devices.drivers import RIGS, make_camera, make_projector, rig_factory
from rig.devices.protocols import Clock, Projector
from rig.errors import ProfileError
from rig.profile.schema import Profile, refuse_what_comes_later
from rig.profile.tables import Pjlink, ProjectorProfile

if TYPE_CHECKING:
    from rig.devices.simulated.world import SimulatedWorld


def make_devices(profile: Profile, start_s: float = 0.0, *, real_time: bool = False) -> Devices:
    """Make the devices that a profile describes, without opening them.

    ``start_s`` is where virtual clocks start; with ``real_time`` simulated devices go by the machine's.
    Raises ProfileError when this version cannot run such a rig, or a recording does not fit the profile; UsageError
    when the driver of another package cannot be used.
    """
    refuse_what_comes_later(profile)
    driver = profile.camera.driver
    if driver in RIGS:
        goes_by_machine = real_time and driver == "simulated"
        return rig_factory(driver)(profile, SystemClock() if goes_by_machine else VirtualClock(start_s))
    clock = SystemClock()
    cameras = {one.name: make_camera(one.driver, one, clock) for one in profile.cameras}
    return Devices(cameras, {one.name: _projector(profile, one, clock) for one in profile.projectors}, clock)


def _projector(profile: Profile, settings: ProjectorProfile, clock: Clock) -> Projector:
    """The display, behind what controls the projector that hangs on it."""
    made = make_projector(settings.driver, settings, clock)
    if (light := settings.lightcrafter) is not None:
        from rig.devices.lightcrafter.projector import from_profile as with_lightcrafter

        made = with_lightcrafter(made, light, clock)
    if (control := settings.pjlink) is not None:
        from rig.devices.network.powered_projector import from_profile as with_pjlink

        made = with_pjlink(made, control, _password(profile, control), clock)
    return made


def _password(profile: Profile, control: Pjlink) -> str | None:
    name = control.password_variable
    if name is not None and name not in os.environ:
        raise ProfileError(
            f"{profile.path}: projector.pjlink.password_variable: the variable {name} is not set; export it"
        )
    return os.environ[name] if name else None


def simulated_world_of(profile: Profile) -> SimulatedWorld:
    """The simulated room of a profile, made anew, as a grey camera sees it. Raises ProfileError when it has none."""
    from rig.devices.simulated.devices import worlds_of

    return worlds_of(profile, 1)[0]


def simulated_worlds_of(profile: Profile) -> tuple[SimulatedWorld, ...]:
    """The same in each band of the profile's camera."""
    from rig.devices.simulated.devices import worlds_of

    return worlds_of(profile, profile.camera.channels)
