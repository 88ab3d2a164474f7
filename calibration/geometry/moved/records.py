"""What is compared, and what was found to have moved."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from calibration.arrays import FloatArray, IntArray
from calibration.geometry.pinhole import PinholeModel

Moved = Literal["nothing", "camera", "projector", "together", "both", "either"]
"""`together`: both devices as one, against the walls that they see, or these walls against them; `either`: a move of
the camera and one of the projector explain the photographs equally well."""


@dataclass(frozen=True, eq=False)
class SeenWalls:
    """What each of some camera pixels sees, as a plane: normal · X = offset in the world."""

    normal: FloatArray
    """(N, 3) of unit length; NaN where a pixel sees nothing."""
    offset_m: FloatArray
    """(N,)"""
    label: IntArray
    """(N,) number of the wall; -1 where a pixel sees nothing."""


WallsSeen = Callable[[PinholeModel, FloatArray], SeenWalls]
"""A camera in the room and (N, 2) of its pixels → what they see."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ComparedPixels:
    """The same camera pixels, before and now."""

    camera_xy_px: FloatArray
    """(N, 2)"""
    before_px: FloatArray
    """(N, 2) projector pixels that they saw when the room was calibrated."""
    now_px: FloatArray
    """(N, 2) projector pixels that they see now."""

    def __len__(self) -> int:
        return len(self.camera_xy_px)


@dataclass(frozen=True, eq=False, kw_only=True)
class DeviceMotion:
    """How far one device is from where it was calibrated."""

    turn_deg: FloatArray
    """(3,) rotation about the device's axes x, y, z."""
    turn_sigma_deg: FloatArray
    shift_m: FloatArray
    """(3,) of its centre of projection, along the room's axes."""
    shift_sigma_m: FloatArray
    turned_deg: float
    """Angle of the turn, and its standard deviation."""
    turned_sigma_deg: float
    shifted_m: float
    """Length of the shift, and its standard deviation."""
    shifted_sigma_m: float
    image_px: float
    """Median distance by which the walls moved in this device's picture, in its pixels, and its standard deviation."""
    image_sigma_px: float


@dataclass(frozen=True, eq=False, kw_only=True)
class MotionFound:
    """Which device moved, how far, and what is left unexplained."""

    moved: Moved
    camera: DeviceMotion
    projector: DeviceMotion
    camera_now: PinholeModel
    projector_now: PinholeModel
    displacement_px: float
    """Median distance between what pixels see now and before, in projector pixels: no model enters."""
    residual_px: FloatArray
    """(N, 2) of the compared pixels: what the motion leaves unexplained, in projector pixels."""
    noise_px: float
    """Standard deviation of an undisturbed pixel's residual."""
    label: IntArray
    """(N,) walls that the pixels see now."""
