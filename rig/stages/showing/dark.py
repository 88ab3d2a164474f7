"""What must stay dark: people, windows, exhibits, as a picture that was painted over what a device sees."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.files.atomic import sha256_of
from rig.files.pictures import read_picture
from rig.profile.schema import Profile
from rig.records import JsonObject
from rig.stages.correspondence import only
from rig.stages.maps.sampling import sample
from rig.stages.scene_model import SceneModel

BoolArray = NDArray[np.bool_]

_HALF = 0.2140
"""Linear light of sRGB's middle grey: what is darker stays dark."""
_SIGMAS = 3.0
"""Of the projector's blur: beyond, less than 0.3 % of a pixel's light lands."""


def dark_file(profile: Profile) -> Path | None:
    """Return the profile's mask; None where it has none."""
    return None if profile.target.dark is None else profile.path.parent / profile.target.dark


def dark_settings(profile: Profile) -> JsonObject:
    """Return what steps that show pictures depend on: the mask, where there is one.

    Raises
    ------
    UsageError
        The file is missing.
    """
    path = dark_file(profile)
    if path is None:
        return {}
    if not path.is_file():
        raise UsageError(f"{path}: no such file, which [target] dark names; paint the mask, or take the line away")
    return {"dark_sha256": sha256_of(path), "dark_seen_by": profile.target.dark_seen_by}


def dark_pixels(profile: Profile, scene_model: SceneModel) -> BoolArray | None:
    """Return (n projector pixels,) pixels that stay black whatever is shown; None where the profile has no mask.

    The mask grows by a camera pixel and by three standard deviations of the projector's blur, so that no light of the
    picture's rim gets there. A pixel whose light lands where the camera cannot see it is not steered anyway.

    Raises
    ------
    UsageError
        The file is missing, unreadable, or has neither the device's size.
    """
    path = dark_file(profile)
    if path is None:
        return None
    device = scene_model.camera if profile.target.dark_seen_by == "camera" else scene_model.projector
    mask = _mask(path, device.lens.shape, profile.target.dark_seen_by)
    shape = scene_model.projector.lens.shape
    if profile.target.dark_seen_by == "camera":
        grown = cv2.dilate(mask.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(np.float64)
        mask = np.nan_to_num(sample(grown + 1.0, scene_model.camera_xy_px), nan=1.0).reshape(shape) > 1.0
    blur = only(scene_model.projectors).blur_variance_px2
    reach = 1 if blur is None else 1 + int(np.ceil(_SIGMAS * np.sqrt(float(np.median(blur)))))
    window = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    return np.asarray(cv2.dilate(mask.astype(np.uint8), window).ravel() > 0)


def _mask(path: Path, shape: tuple[int, int], seen_by: str) -> BoolArray:
    levels = read_picture(path).levels / 255
    if levels.shape[:2] != shape:
        raise UsageError(
            f"{path}: the mask of what stays dark has {levels.shape[1]} x {levels.shape[0]} px, the {seen_by} "
            f"{shape[1]} x {shape[0]}; paint it over a picture of the {seen_by}'s own size, or change dark_seen_by"
        )
    mask = np.asarray(levels.mean(axis=-1) < _HALF)
    if mask.all():
        raise UsageError(f"{path}: all of the mask is black, so that nothing would be shown; paint white what is free")
    return mask
