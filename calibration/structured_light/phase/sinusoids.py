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
from calibration.structured_light.frames import is_dark, mark, part
from calibration.structured_light.gray import BOTH_AXES, Axis, across, size_along
from calibration.structured_light.neighbours import isolated, widen_at_border
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
_WINDOW_PX = 5
"""Neighbours whose misfits are averaged: a single pixel's says little."""
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
    xy, sigma = (np.full((*white.shape, 2), np.nan, dtype=np.float32) for _ in range(2))
    misfit = {axis: np.empty(white.shape, dtype=np.float32) for axis in axes}
    reason = np.zeros(white.shape, dtype=np.uint8)

    def strip(rows: slice) -> None:
        here = reason[rows]
        for axis, source in axes.items():
            k = BOTH_AXES.index(axis)
            reading = source.read(rows)
            _note(reading, here, projector_shape[1 - k])
            np.clip(reading.position_px, -0.5, projector_shape[1 - k] - 0.5, out=xy[rows, :, k])
            sigma[rows, :, k], misfit[axis][rows] = reading.sigma_px, reading.misfit
        if saturation is not None:
            mark(here, PixelReason.SATURATED, _is_clipped(frames, saturation, rows))
        mark(here, PixelReason.DARK, is_dark(white[rows], black[rows], part(contrast_limit, rows)))

    for_each_strip(strip, white.shape, _STRIP_PIXELS)
    shown = [np.ascontiguousarray(xy[..., BOTH_AXES.index(axis)]) for axis in axes]
    mark(reason, PixelReason.ISOLATED, isolated(shown, reason == 0, _ISOLATED_PX) & (reason == 0))
    for axis, left in misfit.items():
        _widen(sigma[..., BOTH_AXES.index(axis)], left, reason == 0)
    widen_at_border(sigma, xy, projector_shape)
    xy[reason != PixelReason.VALID] = np.nan
    return Correspondence(xy, reason, projector_shape, sigma)


def _note(reading: PhaseReading, reason: NDArray[np.uint8], size_px: int) -> None:
    """Say why pixels of a reading have no coordinate; the last reason that fits counts."""
    mark(reason, PixelReason.OUT_OF_RANGE, np.abs(reading.position_px - (size_px - 1) / 2) > (size_px + 1) / 2)
    mark(reason, PixelReason.AMBIGUOUS, reading.ambiguous)
    if reading.uncertain_bit is not None:
        mark(reason, PixelReason.UNCERTAIN_BIT, reading.uncertain_bit)
    mark(reason, PixelReason.WASHED_OUT, ~(reading.sigma_px < MOST_SIGMA_PX))


def _is_clipped(frames: Sequence[Frame], saturation: float, rows: slice) -> BoolArray:
    brightest = frames[0][rows].copy()
    for frame in frames[1:]:
        np.maximum(brightest, frame[rows], out=brightest)
    return np.asarray(brightest >= saturation)


def _widen(sigma_px: Float32Array, misfit: Float32Array, valid: BoolArray) -> None:
    """Let standard deviations grow where the frames around have more left than noise."""
    window = (_WINDOW_PX, _WINDOW_PX)
    weight = valid.astype(np.float32)
    total = cv2.boxFilter(np.where(valid, misfit, np.float32(0)), -1, window, normalize=False)
    count = cv2.boxFilter(weight, -1, window, normalize=False)
    factor = np.sqrt(np.maximum(total / np.maximum(count, 1), 1))
    np.hypot(sigma_px * factor, np.float32(_LEAST_SIGMA_PX), out=sigma_px)
