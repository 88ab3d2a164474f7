"""Brown's distortion inverted: the definition of the kernel's `undistort`."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from calibration.arrays import FloatArray
from calibration.geometry.pinhole import distort


def undistort(plane: FloatArray, distortion: ArrayLike, *, limit: float, rounds: int) -> FloatArray:
    """Return (N, 2) ideal image coordinates of real ones, within a limit, by fixed-point iteration."""
    ideal = np.clip(plane, -limit, limit)
    for _ in range(rounds):
        ideal = np.clip(ideal + plane - distort(ideal, distortion), -limit, limit)
    return ideal
