"""Coordinates from three sinusoids of nearly the same period: whole periods are counted by their beats."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration import _kernel
from calibration.arrays import Frame
from calibration.structured_light.frames import common_kind, of_kind, part
from calibration.structured_light.gray import Axis, size_along
from calibration.structured_light.phase.sinusoids import PhaseReading

FREQUENCIES = 3
MOST_APART_PX2 = 2 * 0.4**2
"""Sum of the squares of the three coordinates' distances from their mean, which leaves two of them free. Where the
beats are off by one period, neighbours among the periods differ by 1 px and more, and it is above 1 px²."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Beats:
    """Three numbers of periods over a range that the picture does not quite fill."""

    counts: tuple[int, int, int]
    range_px: float

    @classmethod
    def of(cls, projector_shape: tuple[int, int], axis: Axis, period_px: float) -> Beats:
        """Choose the numbers: their beats have `slow`, and one more, periods over the range, and those differ by one.

        With `slow` periods the noise that enters each stage of counting is about the same.
        """
        size_px = size_along(projector_shape, axis)
        middle = max(int(np.ceil(size_px / period_px)) + 1, 2)
        slow = max(1, round((middle / (2 * 3**0.5)) ** 0.5))
        return cls(counts=(middle - slow, middle, middle + slow + 1), range_px=middle * period_px)

    @property
    def periods_px(self) -> tuple[float, float, float]:
        """Of the three sinusoids."""
        low, middle, high = self.counts
        return self.range_px / low, self.range_px / middle, self.range_px / high


@dataclass(frozen=True, eq=False, slots=True)
class BeatAxis:
    """The photographs of one axis, all of one kind and contiguous, as the kernel takes them."""

    beats: Beats
    frames: tuple[Frame, ...]
    """Of each period, long ones first, its phases. (H, W) uint8, uint16 or float32 [dn]"""
    noise_dn: NDArray[np.float32]
    """() or (H, W) standard deviation of one frame's noise."""

    @classmethod
    def of(cls, beats: Beats, frames: Sequence[Frame], noise_dn: NDArray[np.float32]) -> BeatAxis:
        """Prepare to read an axis."""
        kind = common_kind(frames)
        return cls(beats, tuple(of_kind(frame, kind) for frame in frames), noise_dn)

    def read(self, rows: slice) -> PhaseReading:
        """Find the coordinates of some rows; ``calibration.reference.beats`` is the definition."""
        shape = self.frames[0][rows].shape
        position, sigma, misfit = (np.empty(shape, dtype=np.float32) for _ in range(3))
        ambiguous = np.empty(shape, dtype=bool)
        _kernel.read_beats(
            [frame[rows] for frame in self.frames],
            np.ascontiguousarray(part(self.noise_dn, rows)).reshape(-1),
            self._numbers(),
            position=position,
            sigma=sigma,
            misfit=misfit,
            ambiguous=ambiguous.view(np.uint8),
        )
        return PhaseReading(position_px=position, sigma_px=sigma, misfit=misfit, ambiguous=ambiguous)

    def _numbers(self) -> NDArray[np.float32]:
        """(12,) what the kernel knows of the beats: calibration/kernel/beats.hpp."""
        low, middle, high = self.beats.counts
        periods = np.array(self.beats.periods_px)
        certainty = periods**-2
        ends = [certainty.sum() ** -0.5, periods.mean(), MOST_APART_PX2]
        numbers = [middle - low, high - low, self.beats.range_px, *periods, *(certainty / certainty.sum()), *ends]
        return np.array(numbers, dtype=np.float32)
