"""Blur that changes with depth: a thin lens of some aperture, focused at some distance.

A point at depth z is imaged as an even disc. With the lens's aperture A, focused at depth f, and the image's distance
from the lens in pixels (``focal_px``), the disc's diameter is A · focal_px · |1/f − 1/z| pixels, by similar triangles
and the lens equation 1/s' = 1/F − 1/s.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from rig.devices.simulated.optics import SimulatedOptics

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]

_LEVEL_PX = 0.75
"""Largest step of the diameter between discs that light is mixed of; chosen: the mixture then looks like one disc."""
_MOST_LEVELS = 12
_KERNEL_SAMPLES = 8
"""Of a kernel's pixel along each axis."""


def circle_px(optics: SimulatedOptics, depth_m: FloatArray) -> FloatArray:
    """Return the diameter of the disc that a point at a depth becomes, in the device's pixels; 0 where depth is NaN."""
    lens = optics.lens
    if not lens.aperture_m or lens.focus_m is None:
        return np.zeros_like(depth_m)
    with np.errstate(divide="ignore", invalid="ignore"):
        diameter = lens.aperture_m * lens.focal_px * np.abs(1 / lens.focus_m - 1 / depth_m)
    return np.nan_to_num(diameter, nan=0.0, posinf=0.0)


@dataclass(frozen=True, eq=False)
class DiscLevels:
    """A few diameters, and for each of many samples a mixture of two of them with the right second moment."""

    diameters_px: FloatArray
    """(K,) ascending."""
    place: FloatArray
    """Of each sample among the levels: 1.25 is three quarters of level 1 and a quarter of level 2."""

    @classmethod
    def of(cls, circle: FloatArray) -> DiscLevels:
        """Choose levels for samples of these diameters."""
        low, high = (float(circle.min()), float(circle.max())) if circle.size else (0.0, 0.0)
        count = int(np.clip(np.ceil((high - low) / _LEVEL_PX) + 1, 1 if high == low else 2, _MOST_LEVELS))
        levels = np.linspace(low, high, count)
        return cls(levels, np.interp(circle**2, levels**2, np.arange(count)))

    @property
    def margin_px(self) -> int:
        """How far the widest disc reaches."""
        return int(np.ceil(self.diameters_px[-1] / 2)) + 1

    def weight(self, level: int) -> Float32Array:
        """Share of a level in each sample."""
        return self._weights[level]

    @cached_property
    def _weights(self) -> list[Float32Array]:
        """Kept, for every frame asks for them: few levels, and one where the lens has no aperture."""
        levels = np.arange(len(self.diameters_px))
        return [np.asarray(np.maximum(1 - np.abs(self.place - level), 0), dtype=np.float32) for level in levels]

    @cached_property
    def kernels(self) -> list[Float32Array]:
        """The discs, each summing to 1."""
        return [disc_kernel(float(diameter)) for diameter in self.diameters_px]


def disc_kernel(diameter_px: float) -> Float32Array:
    """Return an even disc over square pixels, summing to 1."""
    reach = int(np.ceil(max(diameter_px / 2 - 0.5, 0)))
    fine = (np.arange((2 * reach + 1) * _KERNEL_SAMPLES) + 0.5) / _KERNEL_SAMPLES - reach - 0.5
    inside = (fine[:, None] ** 2 + fine**2 <= (diameter_px / 2) ** 2).astype(float)
    kernel = inside.reshape(2 * reach + 1, _KERNEL_SAMPLES, 2 * reach + 1, _KERNEL_SAMPLES).sum(axis=(1, 3))
    if not kernel.sum():
        kernel[reach, reach] = 1
    return np.asarray(kernel / kernel.sum(), dtype=np.float32)


def defocused(optics: SimulatedOptics, light: Float32Array, depth_m: FloatArray) -> Float32Array:
    """(H, W) light after each pixel is spread over its own disc; what leaves the picture is lost."""
    levels = DiscLevels.of(circle_px(optics, depth_m))
    return mixed(levels, lambda level: spread(light * levels.weight(level), levels.kernels[level]))


def mixed(levels: DiscLevels, of_level: Callable[[int], Float32Array]) -> Float32Array:
    """Return the sum over levels."""
    total = of_level(0)
    for level in range(1, len(levels.diameters_px)):
        total = total + of_level(level)
    return total


def spread(light: Float32Array, kernel: Float32Array) -> Float32Array:
    """(H, W) light with every pixel spread over a kernel; nothing comes from outside."""
    if kernel.size == 1:
        return light
    return np.asarray(cv2.filter2D(light, -1, kernel, borderType=cv2.BORDER_CONSTANT), dtype=np.float32)


def looked_up(
    picture: Float32Array, places: tuple[Float32Array, Float32Array], levels: DiscLevels, margin_px: int = 0
) -> Float32Array:
    """Light of a picture, or of one with a dark margin around it, at places (x, y) that it meets out of focus.

    Parameters
    ----------
    picture : (H, W)
        With `margin_px` more on all sides than the coordinates know of.
    places
        Two arrays of one shape, (h, w): x and y in pixels.
    levels
        Of the same samples.
    """

    def of_level(level: int) -> Float32Array:
        soft = spread(picture, levels.kernels[level])
        x, y = (place + np.float32(margin_px) if margin_px else place for place in places)
        light = cv2.remap(soft, x, y, interpolation=cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        return np.asarray(light * levels.weight(level), dtype=np.float32)

    return mixed(levels, of_level)
