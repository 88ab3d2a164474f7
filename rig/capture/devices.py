"""The devices that a profile describes, made with the drivers that it names, on the clock that fits them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rig.devices.clock import SystemClock, VirtualClock
from rig.devices.driver_settings import Devices
from rig.devices.drivers import RIGS, make_devices_of
from rig.profile.schema import Profile, refuse_what_comes_later

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
    goes_by_machine = driver not in RIGS or (real_time and driver == "simulated")
    return make_devices_of(profile, SystemClock() if goes_by_machine else VirtualClock(start_s))


def simulated_world_of(profile: Profile) -> SimulatedWorld:
    """The simulated room of a profile, made anew, as a grey camera sees it. Raises ProfileError when it has none."""
    from rig.devices.simulated.devices import worlds_of

    return worlds_of(profile, 1)[0]


def simulated_worlds_of(profile: Profile) -> tuple[SimulatedWorld, ...]:
    """The same in each band of the profile's camera."""
    from rig.devices.simulated.devices import worlds_of

    return worlds_of(profile, profile.camera.channels)
