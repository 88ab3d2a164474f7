"""What a profile's lens file says of a device, in the place of its data sheet."""

from __future__ import annotations

from calibration.arrays import FloatArray
from calibration.geometry.known.lenses import KnownLenses, MeasuredLens
from calibration.geometry.known.nominal import NominalIntrinsics
from rig.errors import ProfileError
from rig.files.lens_file import LensEntry, LensFile, read_lens_file
from rig.profile.schema import Profile
from rig.profile.tables import CameraProfile, ProjectorProfile
from rig.records import JsonObject


def measured_lens(profile: Profile, device: CameraProfile | ProjectorProfile) -> LensEntry | None:
    """Return the lens that the profile's lens file has for a device; None when the profile names no file.

    A file's only lens of the device's kind is taken whatever it is called; of several the device's name chooses.

    Raises
    ------
    ProfileError
        The file cannot be read, has no such lens, or was made with another picture size.
    """
    if device.lens is None:
        return None
    path = profile.path.parent / device.lens
    lenses, role = read_lens_file(path), "camera" if isinstance(device, CameraProfile) else "projector"
    fitting = [lens for lens in lenses.lens if lens.role == role]
    found = fitting[0] if len(fitting) == 1 else lenses.entry(role, device.name)
    if found is None:
        there = ", ".join(f"{lens.role} {lens.name}" for lens in lenses.lens)
        raise ProfileError(f"{profile.path}: {device.name}.lens: {path} has no {role} {device.name}; it has {there}")
    if (found.width_px, found.height_px) != (device.width_px, device.height_px):
        raise ProfileError(
            f"{profile.path}: {device.name}.lens: {path} was made at {found.width_px} × {found.height_px} px, the "
            f"{role} runs at {device.width_px} × {device.height_px} px: calibrate at this size, or set that one"
        )
    return found


def nominal_lenses(profile: Profile) -> NominalIntrinsics:
    """Return what is known of a profile's lenses: what its lens files measured, else what its data sheets say.

    Raises
    ------
    ProfileError
        As :func:`measured_lens`.
    """
    camera, projector = profile.camera, profile.projector
    sheets = NominalIntrinsics.of(
        camera_shape=camera.shape[:2],
        projector_shape=projector.shape,
        camera_hfov_deg=camera.hfov_deg,
        projector_hfov_deg=projector.hfov_deg,
    )
    if camera.lens is None and projector.lens is None:
        return sheets
    known = KnownLenses(
        camera=_measured(profile, camera), projector=_measured(profile, projector), between=_between(profile)
    )
    return sheets.with_lenses(known)


def _measured(profile: Profile, device: CameraProfile | ProjectorProfile) -> MeasuredLens | None:
    file, entry = _file_of(profile, device), measured_lens(profile, device)
    return None if file is None or entry is None else file.measured(entry)


def _between(profile: Profile) -> FloatArray | None:
    """Covariance of camera and projector, where one file has measured both together."""
    first, second = (_file_of(profile, device) for device in (profile.camera, profile.projector))
    return None if first is None or first != second else first.covariance_between("camera", "projector")


def lens_settings(profile: Profile) -> JsonObject:
    """Return what the geometry takes of lens files, to tell whether they changed; empty where none is named."""
    found = {device.name: measured_lens(profile, device) for device in (profile.camera, profile.projector)}
    files = {device.name: _file_of(profile, device) for device in (profile.camera, profile.projector)}
    return {
        name: {"lens": entry.model_dump(mode="json"), "covariance": file.covariance_of(entry.role).tolist()}
        for name, entry in found.items()
        if entry is not None and (file := files[name]) is not None
    }


def _file_of(profile: Profile, device: CameraProfile | ProjectorProfile) -> LensFile | None:
    return None if device.lens is None else read_lens_file(profile.path.parent / device.lens)
