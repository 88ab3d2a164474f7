"""Sinusoidal patterns, and what all codes made of them share: pixels with a phase to a correspondence map."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.arrays import BoolArray, Codes, Float32Array, Frame
from calibration.structured_light.correspondence import Correspondence, PixelReason
from calibration.structured_light.frames import Clipping, is_dark, mark, part
from calibration.structured_light.gray import BOTH_AXES, Axis, across, size_along
from calibration.structured_light.neighbours import isolated, widen_axis_at_border
from calibration.structured_light.strips import for_each_strip

PERIOD_PX = 16.0
"""Light from other walls is alike in all phases of stripes so fine, and the lens blur of a projector in focus (up to
some 2 px) leaves three quarters of their contrast. The mean period of Gupta and Nayar, Micro phase shifting, 2012."""
STEPS = 4
"""Phases a quarter of a period apart: two differences give the phase, and an even harmonic does no harm."""
MOST_SIGMA_PX = 1.0
"""A coordinate with a larger standard deviation is not given: the stripes are washed out."""
_LEAST_SIGMA_PX = 0.01
"""What 8-bit levels and a response known to 0.5 % leave of a period of 16 px."""
_ISOLATED_PX = 8.0
_REACH_PX = 2
"""Up to here neighbours' misfits are averaged: a single pixel's says little."""
_STRIP_PIXELS = 1 << 15
"""Floating-point planes of so many pixels, of which a dozen are in use, fit into the second-level cache."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PhaseReading:
    """Some rows of one axis."""

    position_px: Float32Array
    """Projector coordinate."""
    sigma_px: Float32Array
    """Its standard deviation by the frames' noise."""
    misfit: Float32Array
    """Mean square of what the frames have left, in units of the noise: about 1 where the coordinate explains them."""
    ambiguous: BoolArray
    uncertain_bit: BoolArray | None = None


class PhaseAxis(Protocol):
    """One axis of a code, ready to be read."""

    def read(self, rows: slice) -> PhaseReading:
        """Find the coordinates of some rows."""
        ...


def sinusoid(shape: tuple[int, int], axis: Axis, period_px: float, shift_cycles: float = 0.0) -> Codes:
    """(H, W) codes: linear light that swings between black and white along an axis, white at pixel shift × period."""
    position = np.arange(size_along(shape, axis))
    light = 0.5 + 0.5 * np.cos(2 * np.pi * (position / period_px - shift_cycles))
    stripe = np.rint(255 * light).astype(np.uint8)
    return across(stripe, shape, axis)


def steps(shape: tuple[int, int], axis: Axis, period_px: float) -> Iterator[Codes]:
    """Yield the sinusoid of a period in each of its phases."""
    return (sinusoid(shape, axis, period_px, step / STEPS) for step in range(STEPS))


def difference(one: Frame, other: Frame) -> Float32Array:
    """Return one frame less another."""
    if one.dtype in (np.uint8, np.uint16, np.float32) and other.dtype == one.dtype:
        return np.asarray(cv2.subtract(one, other, dtype=cv2.CV_32F), dtype=np.float32)
    return np.asarray(np.subtract(one, other, dtype=np.float64), dtype=np.float32)


def phase(frames: Sequence[Frame], rows: slice) -> tuple[Float32Array, Float32Array]:
    """Phase, 0 … 1 of a period, and twice the amplitude [dn], from the frames of :func:`steps`."""
    i0, i1, i2, i3 = (frame[rows] for frame in frames)
    twice_amplitude, angle = cv2.cartToPolar(difference(i0, i2), difference(i1, i3))
    return np.asarray(angle * np.float32(0.5 / np.pi), np.float32), np.asarray(twice_amplitude, np.float32)


def decode_phases(
    axes: Mapping[Axis, PhaseAxis],
    projector_shape: tuple[int, int],
    *,
    frames: Sequence[Frame],
    white: Frame,
    black: Frame,
    contrast_limit: NDArray[np.floating],
    saturation: float | None,
) -> Correspondence:
    """Read the axes of a code into a correspondence map.

    Parameters
    ----------
    axes : mapping of axis to PhaseAxis
        What is coded; the coordinate of an axis that is missing is NaN.
    projector_shape : (height, width)
    frames : sequence of (H, W)
        All that decide about a pixel. [dn]
    white, black : (H, W)
        Frames of projector white and black. [dn]
    contrast_limit : () or (H, W)
        Least white minus black. [dn]
    saturation : float, optional
        Values from here on are clipped. [dn]

    Returns
    -------
    Correspondence
        With sub-pixel coordinates and their standard deviations.
    """
    reason = np.zeros(white.shape, dtype=np.uint8)
    planes = {axis: _Planes.of(white.shape, projector_shape[1 - BOTH_AXES.index(axis)]) for axis in axes}
    clipping = Clipping.of(saturation, reason.shape)

    def read(rows: slice) -> None:
        here = reason[rows]
        for axis, source in axes.items():
            planes[axis].take(source.read(rows), rows, here)
        if clipping is not None:
            for frame in frames:
                clipping.note(frame[rows], rows)
            mark(here, PixelReason.SATURATED, clipping.found[rows])
        mark(here, PixelReason.DARK, is_dark(white[rows], black[rows], part(contrast_limit, rows)))

    for_each_strip(read, white.shape, _STRIP_PIXELS)
    positions = [plane.position_px for plane in planes.values()]
    mark(reason, PixelReason.ISOLATED, isolated(positions, reason == 0, _ISOLATED_PX) & (reason == 0))
    return _joined(planes, reason, projector_shape)


@dataclass(frozen=True, eq=False, slots=True)
class _Planes:
    """What has been read of one axis, all (H, W)."""

    position_px: Float32Array
    sigma_px: Float32Array
    misfit: Float32Array
    size_px: int
    """Of the projector along the axis."""

    @classmethod
    def of(cls, shape: tuple[int, ...], size_px: int) -> _Planes:
        """Return planes to be filled."""
        position, sigma, misfit = (np.empty(shape, dtype=np.float32) for _ in range(3))
        return cls(position, sigma, misfit, size_px)

    def take(self, reading: PhaseReading, rows: slice, reason: NDArray[np.uint8]) -> None:
        """Fill some rows, and say why pixels have no coordinate."""
        _note(reading, reason, self.size_px)
        np.clip(reading.position_px, -0.5, self.size_px - 0.5, out=self.position_px[rows])
        self.sigma_px[rows], self.misfit[rows] = reading.sigma_px, reading.misfit

    def widened(self, rows: slice, valid: BoolArray) -> Float32Array:
        """Standard deviations of some rows, larger where the frames around have more left than noise."""
        around = slice(max(rows.start - _REACH_PX, 0), rows.stop + _REACH_PX)
        inner = slice(rows.start - around.start, rows.stop - around.start)
        variance = _mean_around(self.misfit[around], valid[around])[inner]
        np.maximum(variance, 1, out=variance)
        variance *= self.sigma_px[rows]
        variance *= self.sigma_px[rows]
        variance += np.float32(_LEAST_SIGMA_PX**2)
        return np.sqrt(variance, out=variance)


def _mean_around(values: Float32Array, valid: BoolArray) -> Float32Array:
    """Mean of what is valid in a window around each pixel; 0 where nothing is."""
    window = (2 * _REACH_PX + 1,) * 2
    if valid.all():
        return np.asarray(cv2.blur(values, window), dtype=np.float32)
    total = cv2.boxFilter(np.where(valid, values, np.float32(0)), -1, window, normalize=False)
    count = cv2.boxFilter(valid.view(np.uint8), -1, window, normalize=False)
    return np.asarray(total / np.maximum(count, 1).astype(np.float32), dtype=np.float32)


def _joined(
    planes: Mapping[Axis, _Planes], reason: NDArray[np.uint8], projector_shape: tuple[int, int]
) -> Correspondence:
    """Columns and rows side by side, with standard deviations that know the neighbours; NaN of what is not known."""
    xy, sigma = (np.empty((*reason.shape, 2), dtype=np.float32) for _ in range(2))
    valid = reason == PixelReason.VALID

    def join(rows: slice) -> None:
        for k, axis in enumerate(BOTH_AXES):
            plane = planes.get(axis)
            if plane is None:
                xy[rows, :, k] = sigma[rows, :, k] = np.nan
                continue
            position, spread = plane.position_px[rows], plane.widened(rows, valid)
            widen_axis_at_border(spread, position, plane.size_px)
            xy[rows, :, k], sigma[rows, :, k] = position, spread
        if not valid[rows].all():
            xy[rows][~valid[rows]] = np.nan

    for_each_strip(join, reason.shape, _STRIP_PIXELS)
    return Correspondence(xy, reason, projector_shape, sigma)


def _note(reading: PhaseReading, reason: NDArray[np.uint8], size_px: int) -> None:
    """Say why pixels of a reading have no coordinate; the last reason that fits counts."""
    mark(reason, PixelReason.OUT_OF_RANGE, np.abs(reading.position_px - (size_px - 1) / 2) > (size_px + 1) / 2)
    mark(reason, PixelReason.AMBIGUOUS, reading.ambiguous)
    if reading.uncertain_bit is not None:
        mark(reason, PixelReason.UNCERTAIN_BIT, reading.uncertain_bit)
    mark(reason, PixelReason.WASHED_OUT, ~(reading.sigma_px < MOST_SIGMA_PX))
