"""The devices of a replayed rig, made from its profile: driver ``replay``."""

from __future__ import annotations

from rig.devices.driver_settings import Devices, RigSettings
from rig.devices.protocols import Clock
from rig.devices.replay.photographs import check_photographs, load_manifest
from rig.devices.replay.recording import (
    RecordedFrames,
    Recording,
    ReplayCamera,
    ReplayProjector,
    photographed_frames,
    recorded_frames,
)
from rig.errors import ProfileError


def from_profile(profile: RigSettings, clock: Clock) -> Devices:
    """Make the devices of a replayed rig, closed.

    Raises ProfileError when the recording does not fit the profile, SessionError when it is none.
    """
    camera, projector = profile.camera, profile.projector
    recording = Recording(
        source=profile.recording,
        camera_shape=camera.shape,
        projector_shape=projector.shape,
        full_scale_dn=camera.full_scale_dn,
        exposure_range_s=camera.exposure_range_s,
        frames=_frames(profile),
    )
    player = ReplayProjector(recording, clock)
    return Devices({camera.name: ReplayCamera(recording, player, clock)}, {projector.name: player}, clock)


def _frames(profile: RigSettings) -> RecordedFrames:
    """What was recorded, of devices that are the profile's."""
    recorded = profile.recorded
    if recorded is not None:
        _check_recorded(profile, (recorded.camera.shape, recorded.camera.full_scale_dn, recorded.projector.shape))
        return recorded_frames(profile.recording)
    if profile.camera.mosaic is not None:
        raise ProfileError(
            f"{profile.path}: camera.mosaic: photographs are replayed with all channels at each pixel; remove it"
        )
    channels = profile.camera.channels
    manifest = load_manifest(profile.recording)
    check_photographs(manifest)
    shape = (*manifest.camera_shape, channels)
    _check_recorded(profile, (shape, manifest.full_scale_dn, manifest.projector_shape))
    return photographed_frames(manifest, channels)


def _check_recorded(profile: RigSettings, recorded: tuple[object, ...]) -> None:
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
