"""What goes wrong with a simulated device, as a function of the seed and of time.

A slot is a place on the camera's grid of start times: slot k begins at k periods.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from rig.devices.simulated.settings import Interval, SimulatedCameraSettings

_LONGEST_CHAIN = 32
"""Frames in a row that may be lost, or be copies of one."""
_STALE_SLOTS = 8


class FrameFault(NamedTuple):
    """What becomes of the frame of a slot."""

    content_slot: int
    """The slot whose light it shows."""
    stamp_slot: int
    """The slot whose time it bears ..."""
    stamp_error_s: float
    """... and by how much that is wrong."""
    repeats: bool
    """A copy of the frame before it."""
    is_short: bool
    restarts_count: bool


class FrameFaults:
    """Draws the fate of every frame; what is not switched on in the settings never happens."""

    def __init__(self, settings: SimulatedCameraSettings, seed: int, period_s: float):
        self._settings = settings
        self._seed = seed
        self._period_s = period_s

    def is_dropped(self, slot: int) -> bool:
        """Whether the frame of a slot is lost."""
        rate = self._settings.dropped_frame_rate
        return rate > 0 and self._old_chances(slot)[0] < rate

    def lost_before(self, slot: int) -> int:
        """How many frames directly before a slot are lost."""
        lost = 0
        while lost < _LONGEST_CHAIN and self.is_dropped(slot - 1 - lost):
            lost += 1
        return lost

    def fate(self, slot: int) -> FrameFault:
        """What the frame of a slot, which is not lost, shows and says."""
        settings = self._settings
        chances = self._chances(slot)
        copied = self._copied_slot(slot)
        stamp_slot = slot
        if self._old_chances(slot)[1] < settings.stale_frame_rate:
            copied = stamp_slot = slot - _STALE_SLOTS
        return FrameFault(
            copied - settings.pipeline_frames,
            stamp_slot,
            settings.time_stamp_jitter_s * (2 * float(chances[3]) - 1),
            copied < slot == stamp_slot,
            bool(chances[1] < settings.short_frame_rate),
            bool(chances[2] < settings.sequence_restart_rate),
        )

    def _copied_slot(self, slot: int) -> int:
        """The slot whose pixels a frame has: its own, or that of the frame that it is a copy of."""
        rate = self._settings.duplicate_frame_rate
        first = slot
        while rate > 0 and slot > first - _LONGEST_CHAIN and self._chances(slot)[0] < rate:
            slot -= 1
        return slot

    def _old_chances(self, slot: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        """Drawn apart from the others, so that these change nothing when they are off."""
        return random_at(self._seed, 2, slot * self._period_s).uniform(size=2)

    def _chances(self, slot: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        return random_at(self._seed, 4, slot * self._period_s).uniform(size=4)


def random_at(seed: int, purpose: int, time_s: float) -> np.random.Generator:
    """Randomness of a moment: the same whenever, and in whatever order, it is asked for."""
    return np.random.default_rng((seed, purpose, max(0, round(time_s * 1e6))))


def first_in(intervals: Iterable[Interval], start_s: float, end_s: float) -> float:
    """First moment of ``start_s`` … ``end_s`` that lies in one of the intervals; infinity when there is none."""
    moments = [max(begin_s, start_s) for begin_s, until_s in intervals if begin_s <= end_s and until_s > start_s]
    return min(moments, default=math.inf)


def end_of(intervals: Iterable[Interval], opened_s: float, time_s: float) -> float:
    """When the interval that holds a moment, and began after the device was opened, ends; else the moment."""
    return max((until_s for begin_s, until_s in intervals if opened_s <= begin_s <= time_s < until_s), default=time_s)
