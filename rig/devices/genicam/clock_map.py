"""Time of a camera's clock on the rig's clock, by the frames that arrive."""

from __future__ import annotations

from collections import deque
from statistics import median
from typing import NamedTuple

_REMEMBERED = 256
"""Frames: at 30 a second nine seconds, in which clocks that differ by 50 ppm drift apart by 0.4 ms."""
_SETTLED = 8
"""Frames; a quarter of a second at 30 a second."""
_CLOCKS_DIFFER = 1e-4
"""Relative: what the cheapest oscillators may be off."""
_RECENT_S = 30.0
"""In which they drift apart by 3 ms."""
_SCATTER_KNOWN = 4
"""Answers: of fewer, the next is the quickest so far too often."""


class ClockMap:
    """Ties the camera's time stamps to the rig's clock.

    No frame arrives before it was stamped, and the quickest of many arrives at nearly the same delay each time: the
    least difference of the last frames is the map. What it puts into the rig's clock is late by that least delay.
    """

    def __init__(self) -> None:
        self._differences_s: deque[float] = deque(maxlen=_REMEMBERED)

    def add(self, device_s: float, host_s: float) -> None:
        """Learn from a frame that was stamped, and that arrived."""
        self._differences_s.append(host_s - device_s)

    def host_s(self, device_s: float) -> float:
        """Return a time of the camera's clock on the rig's. Raises ValueError before the first frame."""
        if not self._differences_s:
            raise ValueError("nothing is known of the camera's clock before its first frame")
        return device_s + min(self._differences_s)

    @property
    def is_settled(self) -> bool:
        """Whether so many frames were seen that one that came late among them does no harm."""
        return len(self._differences_s) >= _SETTLED

    @property
    def scatter_s(self) -> float:
        """By how much later than the quickest the slowest frame arrived."""
        return max(self._differences_s, default=0.0) - min(self._differences_s, default=0.0)


class _Answer(NamedTuple):
    """A frame that a trigger had for an answer."""

    began_s: float
    """When the command was sent, on the rig's clock."""
    exposure_s: float
    device_s: float
    """The frame's time stamp, on the camera's clock."""

    @property
    def behind_s(self) -> float:
        """From command to stamp; of two clocks, so that only differences mean anything."""
        return self.device_s - self.began_s


class TriggerAnswers:
    """Tells a frame of an earlier trigger from the answer to the last one.

    From a trigger to the time stamp of its frame it takes at least so long, whatever the stamp means and wherever the
    camera's clock began. A frame that was begun before the trigger is stamped earlier than any answer so far.
    """

    def __init__(self) -> None:
        self._answers: deque[_Answer] = deque(maxlen=_REMEMBERED)

    @property
    def is_known(self) -> bool:
        """Whether there is anything to compare with."""
        return bool(self._answers)

    def early_s(self, device_s: float, began_s: float, exposure_s: float) -> float:
        """Return by how much a frame was stamped too early for a trigger; 0 where nothing is known, or stamps stand."""
        if not self._answers or device_s == self._answers[-1].device_s:
            return 0.0
        return max(min(self._behind_s(began_s, exposure_s)) - (device_s - began_s), 0.0)

    def explains(self, early_s: float, began_s: float, exposure_s: float) -> bool:
        """Tell whether a frame that was too early by so much may be an answer, the quickest so far.

        It may where answers scatter by as much as that: between the quickest and the middle one.
        """
        behind_s = self._behind_s(began_s, exposure_s)
        return early_s == 0.0 or (len(behind_s) >= _SCATTER_KNOWN and early_s <= median(behind_s) - min(behind_s))

    def _behind_s(self, began_s: float, exposure_s: float) -> list[float]:
        """From command to stamp at least, of the answers that compare best with those of now."""
        of_late = [one for one in self._answers if began_s - one.began_s < _RECENT_S] or self._answers
        same = [one for one in of_late if one.exposure_s == exposure_s] or of_late
        # Stamps may be of the end of an exposure: a longer one puts them later.
        return [
            one.behind_s - max(one.exposure_s - exposure_s, 0.0) - _CLOCKS_DIFFER * (began_s - one.began_s)
            for one in same
        ]

    def add(self, device_s: float, began_s: float, exposure_s: float) -> None:
        """Learn from a frame that was taken for an answer."""
        self._answers.append(_Answer(began_s, exposure_s, device_s))

    def forget(self) -> None:
        """Begin anew: nothing that was learned explains what comes."""
        self._answers.clear()
