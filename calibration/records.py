"""Frozen results of calibration: arrays and numbers only, read-only, with units in the names."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
BoolArray = NDArray[np.bool_]


class CalibrationError(Exception):
    """The arrays handed in do not determine what was asked for; the message says what to try."""


class PixelReason(IntEnum):
    """Why a camera pixel has, or has not, a projector pixel (one code a pixel)."""

    VALID = 0
    DARK = 1
    """White minus black is under the contrast limit: the projector does not light it."""
    SATURATED = 2
    """A frame that decides about this pixel is clipped."""
    UNCERTAIN_BIT = 3
    """A pattern and its inverse differ by less than the noise allows in some bit."""
    OUT_OF_RANGE = 4
    """The decoded code is outside the projector."""
    ISOLATED = 5
    """The code does not fit its neighbours'."""


@dataclass(frozen=True, slots=True)
class Correspondence:
    """Which projector pixel each camera pixel sees."""

    projector_xy_px: Float32Array
    """(H, W, 2) projector column and row, sub-pixel where refined; NaN where not valid, in pixels."""
    reason: NDArray[np.uint8]
    """(H, W) PixelReason codes."""
    projector_shape: tuple[int, int]
    """(height, width) of the projector, in pixels."""

    @property
    def valid(self) -> BoolArray:
        """(H, W) bool: pixels that may be used."""
        return np.asarray(self.reason == PixelReason.VALID)


@dataclass(frozen=True, slots=True)
class PinholeModel:
    """A camera, or a projector as an inverse camera: lens and pose, OpenCV's conventions."""

    width_px: int
    height_px: int
    focal_px: tuple[float, float]
    principal_point_px: tuple[float, float]
    """(x, y); pixel centres at integers; may lie outside the image (lens shift)."""
    distortion: tuple[float, float, float, float, float]
    """k1, k2, p1, p2, k3 (OpenCV's order). [1]"""
    rotation: FloatArray
    """(3, 3) device_from_world."""
    translation_m: FloatArray
    """(3,) device_from_world, in metres."""

    @property
    def position_m(self) -> FloatArray:
        """(3,) centre of projection in the world, in metres."""
        return np.asarray(-self.rotation.T @ self.translation_m)


@dataclass(frozen=True, slots=True)
class Response:
    """A monotone response curve: what a device makes of a linear input."""

    levels: FloatArray
    """(K,) increasing device levels (camera: digital numbers above black; projector: codes)."""
    linear: FloatArray
    """(K,) increasing linear light at those levels, from 0 to 1 (a camera's end may differ from 1). [1]"""
    rms: float
    """Residual of the fit over the used samples, share of full scale. [1]"""
