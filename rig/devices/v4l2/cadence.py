"""The beat of a camera: which time stamps came later than the frames themselves."""

from __future__ import annotations

from collections import deque
from statistics import median

_LATE_SHARE = 0.5
"""Of a period."""
_DRIFT_SHARE = 0.02
"""Of the time between two frames: rates are not quite what was set."""
_REMEMBERED = 5
"""Periods whose median is the usual one: two stamps that are wrong do not move it."""


class Cadence:
    """Judges time stamps by those before and by the driver's count.

    A stamp that was made late, by a busy host, lets a frame look younger than it is, and may so give it another
    picture. Frames come at a steady rate: one that is stamped much later than its number tells is not trusted. A
    camera that slows down costs a few frames, until its new rate is known.

    Parameters
    ----------
    period_s
        Of the frame rate that is set.
    """

    def __init__(self, period_s: float):
        self._period_s = period_s
        self._periods_s: deque[float] = deque(maxlen=_REMEMBERED)
        self._last: tuple[int, float] | None = None

    def is_late(self, number: int, stamp_s: float, exposure_s: float) -> bool:
        """Return whether the next frame's stamp is too late for its number; remembers it either way."""
        last, self._last = self._last, (number, stamp_s)
        if last is None or number <= last[0]:
            return False
        count, elapsed_s = number - last[0], stamp_s - last[1]
        usual_s = max(self._period_s, exposure_s, median(self._periods_s or [0.0]))
        self._periods_s.append(elapsed_s / count)
        return elapsed_s - count * usual_s > (_LATE_SHARE + _DRIFT_SHARE * count) * usual_s
