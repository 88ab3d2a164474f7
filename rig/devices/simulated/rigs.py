"""The simulated rig of a profile: its world, and all its cameras and projectors in it. Driver ``simulated``."""

from __future__ import annotations

from calibration.radiometry.mosaic import Mosaic
from rig.devices.driver_settings import CameraSettings, Devices, ProjectorSettings, RigSettings
from rig.devices.protocols import Clock
from rig.devices.simulated.devices import Bands, SimulatedCamera, SimulatedProjector
from rig.devices.simulated.mesh.world import MeshWorld, prepare_scene
from rig.devices.simulated.pair import SimulatedPair
from rig.devices.simulated.settings import SimulationSettings
from rig.devices.simulated.world import SimulatedWorld, make_simulated_worlds
from rig.errors import ProfileError


def from_profile(profile: RigSettings, clock: Clock) -> Devices:
    """Make the devices of a simulated rig, closed. Raises ProfileError without a simulation."""
    stage = _Stage(profile)
    first, *others = profile.projectors
    lit = {one.name: stage.bands(profile.cameras[0], one) for one in profile.projectors}
    projectors = {
        one.name: SimulatedProjector(lit[one.name][0], clock, refresh_rate_hz=one.refresh_rate_hz)
        for one in profile.projectors
    }
    cameras = {}
    for camera in profile.cameras:
        seen = lit if camera is profile.cameras[0] else {p.name: stage.bands(camera, p) for p in profile.projectors}
        cameras[camera.name] = SimulatedCamera(
            seen[first.name],
            projectors[first.name],
            clock,
            bit_depth=camera.bit_depth,
            frame_rate_hz=camera.frame_rate_hz,
            exposure_range_s=camera.exposure_range_s,
            mosaic=None if camera.mosaic is None else Mosaic(camera.mosaic),
            others=[(seen[other.name], projectors[other.name]) for other in others],
        )
    return Devices(cameras, projectors, clock)


class _Stage:
    """A profile's world, of which each camera and projector take their parts."""

    def __init__(self, profile: RigSettings):
        if profile.simulation is None:
            raise ProfileError(f"{profile.path}: simulation: missing; a simulated room needs a [simulation] table")
        self._settings: SimulationSettings = profile.simulation
        try:
            has_scene = self._settings.scene is not None
            self._exchange = prepare_scene(self._settings, profile.path.parent) if has_scene else None
        except ProfileError as error:
            raise ProfileError(f"{profile.path}: {error}") from error

    def bands(self, camera: CameraSettings, projector: ProjectorSettings, channels: int | None = None) -> Bands:
        """The world of a camera and a projector, in each band of the camera or of one with so many channels."""
        settings = self._settings.of_pair(camera.name, projector.name)
        count = channels or camera.channels
        shapes = (camera.shape[:2], projector.shape)
        if self._exchange is None:
            return make_simulated_worlds(settings, *shapes, count)
        bands = (None,) if count == 1 else range(count)
        return tuple(MeshWorld(settings, self._exchange, *shapes, band=band) for band in bands)


def simulated_world_of(profile: RigSettings) -> SimulatedPair:
    """Make the simulated world of a profile's only pair, as a grey camera sees it. Raises ProfileError."""
    return _Stage(profile).bands(profile.camera, profile.projector, channels=1)[0]


def simulated_worlds_of(profile: RigSettings) -> Bands:
    """Make the same in each band of the profile's camera."""
    return _Stage(profile).bands(profile.camera, profile.projector)


def box_world_of(profile: RigSettings) -> SimulatedWorld:
    """Make the same of a profile whose world is a box. Raises ProfileError for another."""
    world = simulated_world_of(profile)
    if not isinstance(world, SimulatedWorld):
        raise ProfileError(
            f"{profile.path}: simulation.scene: is there, but this works with a simulated box only; leave it out and "
            "give simulation.size_m, or take another profile"
        )
    return world
