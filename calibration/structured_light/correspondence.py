"""The result of structured light: a projector pixel for each camera pixel, or why there is none."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from calibration.arrays import BoolArray, Float32Array

ROUNDING_PX = 12**-0.5
"""Standard deviation of a coordinate of which the whole pixel is known."""


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
    AMBIGUOUS = 6
    """The frames fit several projector pixels about equally well, or none of them."""
    WASHED_OUT = 7
    """Stripes have too little contrast here, by blur or by global light, for a coordinate within its limit."""
    MIRRORED = 8
    """Left and right are exchanged here: the camera, or the projector, sees the surface in a mirror."""


@dataclass(frozen=True, slots=True)
class Correspondence:
    """Which projector pixel each camera pixel sees."""

    projector_xy_px: Float32Array
    """(H, W, 2) projector column and row, sub-pixel where refined; NaN where not valid, and for an axis that was not
    coded, in pixels."""
    reason: NDArray[np.uint8]
    """(H, W) PixelReason codes."""
    projector_shape: tuple[int, int]
    """(height, width) of the projector, in pixels."""
    sigma_px: Float32Array | None = None
    """(H, W, 2) standard deviations of column and row, of meaning where valid; None: not known. [px]"""

    @property
    def valid(self) -> BoolArray:
        """(H, W) bool: pixels that may be used."""
        return np.asarray(self.reason == PixelReason.VALID)
