"""Time of a camera's clock on the rig's clock, by the frames that arrive."""

from __future__ import annotations

from collections import deque

_REMEMBERED = 256
"""Frames: at 30 a second nine seconds, in which clocks that differ by 50 ppm drift apart by 0.4 ms."""


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
    def scatter_s(self) -> float:
        """By how much later than the quickest the slowest frame arrived."""
        return max(self._differences_s, default=0.0) - min(self._differences_s, default=0.0)
