"""What a profile's lens file says of a device, in the place of its data sheet."""

from __future__ import annotations

import math

from rig.errors import ProfileError
from rig.files.lens_file import LensEntry, read_lens_file
from rig.profile.schema import Profile
from rig.profile.tables import CameraProfile, ProjectorProfile


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


def hfov_deg_of(profile: Profile, device: CameraProfile | ProjectorProfile) -> float:
    """Return the horizontal field of view of a device: by its focal length if it was measured, else by its data sheet.

    Raises
    ------
    ProfileError
        As :func:`measured_lens`.
    """
    lens = measured_lens(profile, device)
    return device.hfov_deg if lens is None else math.degrees(2 * math.atan(lens.width_px / 2 / lens.focal_px[0]))
