"""Which devices stand behind a profile's ``driver``: the one place that knows every back end.

Each is imported when a profile asks for it: a real camera needs neither the simulated room nor what reads recordings.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

from rig.devices.clock import SystemClock, VirtualClock
from rig.devices.protocols import Camera, Clock, Projector
from rig.errors import ProfileError
from rig.profile.schema import Profile, load_profile

if TYPE_CHECKING:
    from rig.devices.replay.recording import Recording
    from rig.devices.simulated.world import SimulatedWorld


class Devices(NamedTuple):
    """A camera and a projector that share a clock; closed."""

    camera: Camera
    projector: Projector
    clock: Clock


def make_devices(profile: Profile, start_s: float = 0.0, *, real_time: bool = False) -> Devices:
    """Make the devices that a profile describes, without opening them.

    ``start_s`` is where virtual clocks start; with ``real_time`` simulated devices go by the machine's.
    Raises ProfileError when a recording does not fit the profile.
    """
    if profile.camera.driver == "replay":
        return _replayed(profile, start_s)
    if profile.camera.driver == "simulated":
        return _simulated(profile, SystemClock() if real_time else VirtualClock(start_s))
    clock = SystemClock()
    return Devices(_real_camera(profile, clock), _real_projector(profile, clock), clock)


def _real_camera(profile: Profile, clock: Clock) -> Camera:
    from rig.devices.v4l2.camera import V4l2Camera

    camera = profile.camera
    return V4l2Camera(
        camera.device_id or "",
        shape=camera.shape,
        pixel_format=camera.pixel_format or "",
        bit_depth=camera.bit_depth,
        frame_rate_hz=camera.frame_rate_hz,
        exposure_range_s=camera.exposure_range_s,
        controls=camera.controls,
        clock=clock,
    )


def _real_projector(profile: Profile, clock: Clock) -> Projector:
    settings = profile.projector
    display = _display_kind(settings.driver)(
        settings.output or "", shape=settings.shape, refresh_rate_hz=settings.refresh_rate_hz, clock=clock
    )
    return _with_pjlink(profile, _with_lightcrafter(profile, display, clock), clock)


def _display_kind(driver: str) -> Callable[..., Projector]:
    if driver == "kms":
        from rig.devices.kms.projector import KmsProjector

        return KmsProjector
    from rig.devices.window.projector import WindowProjector

    return WindowProjector


def _with_lightcrafter(profile: Profile, display: Projector, clock: Clock) -> Projector:
    if (light := profile.lightcrafter) is None:
        return display
    from rig.devices.lightcrafter.controller import open_lightcrafter
    from rig.devices.lightcrafter.projector import LightCrafterProjector

    return LightCrafterProjector(display, lambda: open_lightcrafter(light.serial, clock), light.led_currents)


def _with_pjlink(profile: Profile, display: Projector, clock: Clock) -> Projector:
    if (control := profile.pjlink) is None:
        return display
    from rig.devices.network.pjlink import Pjlink
    from rig.devices.network.powered_projector import PoweredProjector

    name = control.password_variable
    if name is not None and name not in os.environ:
        raise ProfileError(f"{profile.path}: pjlink.password_variable: the variable {name} is not set; export it")
    return PoweredProjector(
        display,
        Pjlink(control.host, control.port, os.environ[name] if name else None),
        input_code=control.input,
        warm_up_timeout_s=control.warm_up_timeout_s,
        clock=clock,
    )


def _replayed(profile: Profile, start_s: float) -> Devices:
    from rig.devices.replay.recording import ReplayCamera, ReplayProjector

    clock = VirtualClock(start_s)
    recording = _recording(profile)
    player = ReplayProjector(recording, clock)
    return Devices(ReplayCamera(recording, player, clock), player, clock)


def simulated_world_of(profile: Profile) -> SimulatedWorld:
    """The simulated room of a profile, made anew, as a grey camera sees it. Raises ProfileError when it has none."""
    return _benches(profile, 1)[0]


def simulated_worlds_of(profile: Profile) -> tuple[SimulatedWorld, ...]:
    """The same in each band of the profile's camera."""
    return _benches(profile, profile.camera.channels)


def _benches(profile: Profile, channels: int) -> tuple[SimulatedWorld, ...]:
    from rig.devices.simulated.world import make_simulated_worlds

    if profile.simulation is None:
        raise ProfileError(f"{profile.path}: simulation: missing; a simulated room needs a [simulation] table")
    return make_simulated_worlds(profile.simulation, profile.camera.shape[:2], profile.projector.shape, channels)


def _simulated(profile: Profile, clock: Clock) -> Devices:
    from rig.devices.simulated.devices import SimulatedCamera, SimulatedProjector

    bands = simulated_worlds_of(profile)
    projector = SimulatedProjector(bands[0], clock, refresh_rate_hz=profile.projector.refresh_rate_hz)
    camera = SimulatedCamera(
        bands,
        projector,
        clock,
        bit_depth=profile.camera.bit_depth,
        frame_rate_hz=profile.camera.frame_rate_hz,
        exposure_range_s=profile.camera.exposure_range_s,
    )
    return Devices(camera, projector, clock)


def _recording(profile: Profile) -> Recording:
    from rig.devices.replay.photographs import check_photographs, load_manifest
    from rig.devices.replay.recording import Recording, photographed_frames, recorded_frames

    camera, source = profile.camera, profile.recording
    recorded: tuple[object, ...]
    if profile.replay is not None and profile.replay.manifest is not None:
        manifest = load_manifest(source)
        recorded = (
            (*manifest.camera_shape, camera.channels),
            manifest.full_scale_dn,
            manifest.projector_shape,
        )
        check_photographs(manifest)
        frames = photographed_frames(manifest, camera.channels)
    else:
        theirs = load_profile(source / "profile.toml")
        recorded = (theirs.camera.shape, theirs.camera.full_scale_dn, theirs.projector.shape)
        frames = recorded_frames(source)
    _check_recorded(profile, recorded)
    return Recording(
        source, camera.shape, profile.projector.shape, camera.full_scale_dn, camera.exposure_range_s, frames
    )


def _check_recorded(profile: Profile, recorded: tuple[object, ...]) -> None:
    """Refuse a replay whose devices are not the recorded ones."""
    ours = (profile.camera.shape, profile.camera.full_scale_dn, profile.projector.shape)
    names = ("camera's shape", "camera's full scale", "projector's shape")
    problems = [
        f"{profile.path}: the {name} is {own}, but {their} in {profile.recording}; give what was recorded"
        for name, own, their in zip(names, ours, recorded, strict=True)
        if own != their
    ]
    if problems:
        raise ProfileError("\n".join(problems))
