"""What several drivers refuse, in the same words."""

from __future__ import annotations

import numpy as np

from calibration.radiometry.mosaic import MosaicPattern
from rig.devices.protocols import Codes, ExposureRange, Gain
from rig.errors import ProfileError, SettingRefused


def check_codes(codes: Codes, shape: tuple[int, int], whose: str = "the projector shows") -> None:
    """Refuse a picture that is not uint8 of exactly the projector's (height, width). Raises SettingRefused."""
    if codes.dtype != np.uint8 or codes.shape not in (shape, (*shape, 3)):
        raise SettingRefused(
            f"{whose} uint8 codes of shape {shape}, not {codes.dtype} of {codes.shape}; "
            "make the picture in exactly its size"
        )


def check_mosaic(pixel_format: str, of_format: MosaicPattern | None, given: MosaicPattern | None) -> None:
    """Refuse colour filters that are not those of the pixel format. Raises ProfileError."""
    if given is not None and given != of_format:
        says = "is no mosaic" if of_format is None else f"has the filters {of_format}"
        raise ProfileError(f"camera.mosaic: is {given}, but pixel_format {pixel_format!r} {says}; correct one of them")


def check_exposure(exposure_s: float, range_s: tuple[float, float], whose: str = "the camera's") -> None:
    """Refuse an exposure that a camera cannot do. Raises SettingRefused."""
    possible = ExposureRange(*range_s)
    if not possible.holds(exposure_s):
        raise SettingRefused(
            f"exposure {exposure_s:.6g} s is outside {whose} {possible} s; correct camera.exposure_range_s"
        )


def check_gain(value: float, gain: Gain) -> None:
    """Refuse a gain that a camera does not have. Raises SettingRefused."""
    if not gain.least <= value <= gain.most:
        raise SettingRefused(
            f"gain {value:.6g} is outside the camera's {gain.least:g} … {gain.most:g} {gain.unit}; give one within it"
        )
