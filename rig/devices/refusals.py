"""What several drivers refuse, in the same words."""

from __future__ import annotations

import numpy as np

from rig.devices.protocols import Codes, ExposureRange
from rig.errors import SettingRefused


def check_codes(codes: Codes, shape: tuple[int, int], whose: str = "the projector shows") -> None:
    """Refuse a picture that is not uint8 of exactly the projector's (height, width). Raises SettingRefused."""
    if codes.dtype != np.uint8 or codes.shape not in (shape, (*shape, 3)):
        raise SettingRefused(
            f"{whose} uint8 codes of shape {shape}, not {codes.dtype} of {codes.shape}; "
            "make the picture in exactly its size"
        )


def check_exposure(exposure_s: float, range_s: tuple[float, float], whose: str = "the camera's") -> None:
    """Refuse an exposure that a camera cannot do. Raises SettingRefused."""
    possible = ExposureRange(*range_s)
    if not possible.holds(exposure_s):
        raise SettingRefused(f"exposure {exposure_s:.6g} s is outside {whose} {possible} s")
