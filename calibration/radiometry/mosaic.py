"""Mosaics of colour filters: one number a pixel, each of red, green or blue, and how three are made of them.

Each band is interpolated from the pixels that have it, where they are; what a pixel measured itself is kept as it is.
The interpolation is linear, so it may come before or after anything else that is linear, and variances follow.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.arrays import BoolArray, Float32Array
from calibration.errors import CalibrationError

MosaicPattern = Literal["RGGB", "GRBG", "GBRG", "BGGR"]
"""Filters of the first two pixels of the first row, then of the second."""
N_BANDS = 3
_WEIGHTS = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]], np.float32)
"""Bilinear interpolation on a grid of every second pixel."""
_CROSS = np.array([[0, 1, 0], [1, 4, 1], [0, 1, 0]], np.float32)
"""The same on a checkerboard, which green is."""


@dataclass(frozen=True, slots=True)
class Mosaic:
    """The filters of a sensor, two by two pixels that come again and again.

    Parameters
    ----------
    pattern
        ``RGGB``: red and green in the first row, green and blue in the second.
    """

    pattern: MosaicPattern

    def bands(self, shape: tuple[int, int]) -> NDArray[np.intp]:
        """Return (H, W) which band each pixel has: 0 red, 1 green, 2 blue."""
        cell = np.array(["RGB".index(letter) for letter in self.pattern], np.intp).reshape(2, 2)
        return np.tile(cell, (shape[0] // 2 + 1, shape[1] // 2 + 1))[: shape[0], : shape[1]]

    def seen(self, image: NDArray[np.generic]) -> NDArray[np.generic]:
        """Return (H, W, 1) what the sensor has of an image in three bands, (H, W, 3)."""
        return np.take_along_axis(image, self.bands((image.shape[0], image.shape[1]))[..., None], axis=2)

    def of_bands(self, values: NDArray[np.float64], shape: tuple[int, int]) -> Float32Array:
        """Return (H, W, 1) each pixel's own of three numbers, (3,)."""
        return np.asarray(values, np.float32)[self.bands(shape)][..., None]

    def interpolated(self, values: Float32Array) -> Float32Array:
        """Return three bands of what the pixels measured.

        Parameters
        ----------
        values : (H, W, 1)
            In linear light: across an edge, the mean of digital numbers is not that of light.

        Returns
        -------
        ndarray
            (H, W, 3), each band's own pixels unchanged.

        Raises
        ------
        CalibrationError
            The image is smaller than two by two pixels, or has three bands already.
        """
        return self._weighted(values, power=1)

    def interpolated_variance(self, variance: Float32Array) -> Float32Array:
        """Return the variance of :meth:`interpolated`, (H, W, 3), of independent pixels with variances (H, W, 1)."""
        return self._weighted(variance, power=2)

    def touched(self, flags: BoolArray) -> BoolArray:
        """Return (H, W, 3) which interpolated numbers have part in a pixel that is flagged, (H, W, 1)."""
        return np.asarray(self._weighted(flags.astype(np.float32), power=1) > 0)

    def _weighted(self, values: Float32Array, power: int) -> Float32Array:
        height, width, depth = values.shape
        if depth != 1 or min(height, width) < 2:
            raise CalibrationError(
                f"a mosaic is (height, width, 1) of two by two pixels or more, not {values.shape}; give raw frames"
            )
        found = np.empty((height, width, N_BANDS), np.float32)
        bands = self.bands((height, width))
        for band in range(N_BANDS):
            kernel = _CROSS if band == 1 else _WEIGHTS
            own = (bands == band).astype(np.float32)
            weighted = _filtered(own * values[..., 0], kernel**power)
            found[..., band] = weighted / _filtered(own, kernel) ** power
        return found


def _filtered(image: Float32Array, kernel: Float32Array) -> Float32Array:
    """Nothing comes from outside: there only what is inside has a weight."""
    return np.asarray(cv2.filter2D(image, -1, kernel, borderType=cv2.BORDER_CONSTANT), dtype=np.float32)
