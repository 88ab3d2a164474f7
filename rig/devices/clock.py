"""Clocks: the only places that know what time it is and how to wait."""

from __future__ import annotations

import threading
import time


class SystemClock:
    """The machine's monotonic clock."""

    def now_s(self) -> float:
        """Monotonic time in seconds; its zero means nothing."""
        return time.monotonic()

    def wait_until_s(self, time_s: float) -> None:
        """Sleep until ``time_s``; at once if that has passed."""
        remaining_s = time_s - self.now_s()
        while remaining_s > 0:
            time.sleep(remaining_s)  # noqa: TID251 - every other wait goes through this clock
            remaining_s = time_s - self.now_s()


class VirtualClock:
    """A clock that stands still until somebody waits on it, and then jumps; safe to share between threads.

    Parameters
    ----------
    start_s
        First reading. A resumed session starts where its last frame ended.
    """

    def __init__(self, start_s: float = 0.0):
        self._now_s = start_s
        self._lock = threading.Lock()

    def now_s(self) -> float:
        """Virtual time in seconds."""
        with self._lock:
            return self._now_s

    def wait_until_s(self, time_s: float) -> None:
        """Jump to ``time_s``; never back."""
        with self._lock:
            self._now_s = max(self._now_s, time_s)
