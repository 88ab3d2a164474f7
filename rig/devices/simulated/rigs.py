"""The simulated rig of a profile: its world, and all its cameras and projectors in it. Driver ``simulated``."""

from __future__ import annotations

from calibration.radiometry.mosaic import Mosaic
from rig.devices.driver_settings import Devices, RigSettings
from rig.devices.protocols import Clock
from rig.devices.simulated.devices import Bands, SimulatedCamera, SimulatedProjector
from rig.devices.simulated.pair import SimulatedPair
from rig.devices.simulated.stage import Pair, worlds_of
from rig.devices.simulated.world import SimulatedWorld
from rig.errors import ProfileError


def from_profile(profile: RigSettings, clock: Clock) -> Devices:
    """Make the devices of a simulated rig, closed. Raises ProfileError without a simulation."""
    devices = [(camera, projector) for camera in profile.cameras for projector in profile.projectors]
    worlds = worlds_of(profile, *(Pair.of(*pair) for pair in devices))
    seen = {(camera.name, projector.name): bands for (camera, projector), bands in zip(devices, worlds, strict=True)}
    first, *others = profile.projectors
    projectors = {
        one.name: SimulatedProjector(
            seen[profile.cameras[0].name, one.name][0], clock, refresh_rate_hz=one.refresh_rate_hz
        )
        for one in profile.projectors
    }
    cameras = {
        camera.name: SimulatedCamera(
            seen[camera.name, first.name],
            projectors[first.name],
            clock,
            bit_depth=camera.bit_depth,
            frame_rate_hz=camera.frame_rate_hz,
            exposure_range_s=camera.exposure_range_s,
            mosaic=None if camera.mosaic is None else Mosaic(camera.mosaic),
            others=[(seen[camera.name, other.name], projectors[other.name]) for other in others],
        )
        for camera in profile.cameras
    }
    return Devices(cameras, projectors, clock)


def simulated_world_of(profile: RigSettings) -> SimulatedPair:
    """Make the simulated world of a profile's only pair, as a grey camera sees it. Raises ProfileError."""
    ((world,),) = worlds_of(profile, Pair.of(profile.camera, profile.projector, channels=1))
    return world


def simulated_worlds_of(profile: RigSettings) -> Bands:
    """Make the same in each band of the profile's camera."""
    (bands,) = worlds_of(profile, Pair.of(profile.camera, profile.projector))
    return bands


def box_world_of(profile: RigSettings) -> SimulatedWorld:
    """Make the same of a profile whose world is a box. Raises ProfileError for another."""
    world = simulated_world_of(profile)
    if not isinstance(world, SimulatedWorld):
        raise ProfileError(
            f"{profile.path}: simulation.scene: is there, but this works with a simulated box only; leave it out and "
            "give simulation.size_m, or take another profile"
        )
    return world
