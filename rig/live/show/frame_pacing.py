"""Frame pacing: when the display refreshes next, and when work for a refresh has to begin."""

from __future__ import annotations

import math

_LEAST_LEAD, _MOST_LEAD = 0.25, 0.9
"""Shares of the period."""
_BUSY_MARGIN = 1.25
"""Over the longest of the last pictures: the next may take longer. Chosen; too late is dearer than early."""
_FIRST_ALLOWANCE, _MOST_ALLOWANCE, _ALLOWANCE_STEP = 0.2, 0.6, 0.05
"""Shares of the period, for handing a picture to the display; more after each late one."""
_FORGETTING = 0.99
"""Of the longest, a picture: at 60 Hz half of it is forgotten in about a second."""


class DisplayClock:
    """Refreshes of a display, told from when its last picture was on screen.

    Parameters
    ----------
    period_s
        Between two refreshes.
    """

    def __init__(self, period_s: float):
        self.period_s = period_s
        self._last_s: float | None = None
        self._least = 1
        """Refreshes after the last picture's that are still to be had."""

    def target_s(self, ready_s: float) -> float:
        """The first refresh at or after a time that no picture has, and that was not let pass."""
        if self._last_s is None:
            return ready_s + self.period_s
        return self._last_s + max(self._count(ready_s), self._least) * self.period_s

    def _count(self, time_s: float) -> int:
        return 0 if self._last_s is None else math.ceil((time_s - self._last_s) / self.period_s - 1e-6)

    def let_pass(self, target_s: float) -> None:
        """No picture came for a refresh."""
        self._least = self._count(target_s) + 1

    def expect(self, target_s: float, now_s: float) -> None:
        """A picture is on its way to a refresh; or to the first that is still to be had, if that one is taken."""
        if self._last_s is None:
            self.note(target_s)
            return
        aimed_s = self._last_s + round((target_s - self._last_s) / self.period_s) * self.period_s
        self.note(max(aimed_s, self.target_s(now_s)))

    def note(self, on_screen_s: float) -> None:
        """Learn when a picture was on screen."""
        self._last_s, self._least = on_screen_s, 1

    def forget(self) -> None:
        """The display was away: its refreshes begin anew."""
        self._last_s, self._least = None, 1


class LatchTimer:
    """How long before a refresh its picture has to be begun, learned from how long pictures take.

    The longest of the last pictures counts, with a margin, and an allowance for what the display itself needs, which
    grows with each picture that came late although it was begun in time.
    """

    def __init__(self, period_s: float):
        self._period_s = period_s
        self._busy_s = 0.0
        self._allowance = _FIRST_ALLOWANCE

    @property
    def lead_s(self) -> float:
        """Time before the refresh."""
        wanted = _BUSY_MARGIN * self._busy_s / self._period_s + self._allowance
        return self._period_s * min(max(wanted, _LEAST_LEAD), _MOST_LEAD)

    def note(self, busy_s: float, *, is_late: bool) -> None:
        """Learn how long a picture took to compute, and whether it came too late."""
        self._busy_s = max(busy_s, _FORGETTING * self._busy_s)
        if is_late:
            self._allowance = min(self._allowance + _ALLOWANCE_STEP, _MOST_ALLOWANCE)
