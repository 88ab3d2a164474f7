"""What goes wrong with a simulated device, as a function of the seed and of time.

A frame index is a place on the camera's grid of start times: frame k begins at k periods.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from rig.devices.simulated.settings import Interval, SimulatedCameraSettings

_LONGEST_CHAIN = 32
"""Frames in a row that may be lost, or be copies of one."""
_STALE_FRAMES = 8
"""How old a stale frame is: more than any driver's queue of buffers holds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameFault:
    """What becomes of a frame."""

    content_index: int
    """The frame whose light it shows."""
    stamp_index: int
    """The frame whose time it bears ..."""
    stamp_error_s: float
    """... and by how much that is wrong."""
    repeats: bool
    """A copy of the frame before it."""
    is_short: bool
    """Its lower rows are missing."""
    restarts_count: bool
    """The camera counts from 1 again."""


class FrameFaults:
    """Draws the faults of every frame; what is not switched on in the settings never happens."""

    def __init__(self, settings: SimulatedCameraSettings, seed: int, period_s: float):
        self._settings = settings
        self._seed = seed
        self._period_s = period_s

    def is_dropped(self, index: int) -> bool:
        """Return whether a frame is lost."""
        rate = self._settings.dropped_frame_rate
        return rate > 0 and self._old_chances(index)[0] < rate

    def lost_before(self, index: int) -> int:
        """Return how many frames directly before this one are lost."""
        lost = 0
        while lost < _LONGEST_CHAIN and self.is_dropped(index - 1 - lost):
            lost += 1
        return lost

    def fault_of(self, index: int) -> FrameFault:
        """Tell what a frame, which is not lost, shows and says."""
        settings = self._settings
        chances = self._chances(index)
        copied = self._copied_index(index)
        stamped = index
        if self._old_chances(index)[1] < settings.stale_frame_rate:
            copied = stamped = index - _STALE_FRAMES
        return FrameFault(
            content_index=copied - settings.pipeline_frames,
            stamp_index=stamped,
            stamp_error_s=settings.time_stamp_jitter_s * (2 * float(chances[3]) - 1),
            repeats=copied < index == stamped,
            is_short=bool(chances[1] < settings.short_frame_rate),
            restarts_count=bool(chances[2] < settings.sequence_restart_rate),
        )

    def _copied_index(self, index: int) -> int:
        """The frame whose pixels this one has: its own, or those of the one that it is a copy of."""
        rate = self._settings.duplicate_frame_rate
        first = index
        while rate > 0 and index > first - _LONGEST_CHAIN and self._chances(index)[0] < rate:
            index -= 1
        return index

    def _old_chances(self, index: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        """Drawn apart from the others, so that these change nothing when they are off."""
        return random_at(self._seed, 2, index * self._period_s).uniform(size=2)

    def _chances(self, index: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        return random_at(self._seed, 4, index * self._period_s).uniform(size=4)


def random_at(seed: int, purpose: int, time_s: float) -> np.random.Generator:
    """Randomness of a moment: the same whenever, and in whatever order, it is asked for."""
    return np.random.default_rng((seed, purpose, max(0, round(time_s * 1e6))))


def first_in(intervals: Iterable[Interval], start_s: float, end_s: float) -> float:
    """First moment of ``start_s`` … ``end_s`` that lies in one of the intervals; infinity when there is none."""
    moments = [max(begin_s, start_s) for begin_s, until_s in intervals if begin_s <= end_s and until_s > start_s]
    return min(moments, default=math.inf)


def end_of(intervals: Iterable[Interval], opened_s: float, time_s: float) -> float:
    """Return when the interval that holds a moment, and began after the device was opened, ends; else the moment."""
    return max((until_s for begin_s, until_s in intervals if opened_s <= begin_s <= time_s < until_s), default=time_s)
