"""When a show is on: times of day, local, and how long until that changes."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta

_SPAN = re.compile(r"([01]\d|2[0-3]):([0-5]\d)-([01]\d|2[0-3]|24):([0-5]\d)")
_DAY_MIN = 24 * 60


@dataclass(frozen=True, slots=True)
class Timetable:
    """Spans of each day, in minutes after midnight; one that ends before it begins ends on the next day."""

    spans: tuple[tuple[int, int], ...]
    """Empty: always on."""

    @classmethod
    def of(cls, words: Sequence[str]) -> Timetable:
        """Return the timetable of spans like ``09:00-18:30``. Raises ValueError for what is none."""
        return cls(tuple(_span(word) for word in words))

    def is_on(self, now: datetime) -> bool:
        """Tell whether the show is on.

        Parameters
        ----------
        now
            Local time.

        Returns
        -------
        bool
        """
        minute = now.hour * 60 + now.minute
        return not self.spans or any(_holds(span, minute) for span in self.spans)

    def seconds_left(self, now: datetime) -> float | None:
        """Return how long it stays as it is, at most a day; None: for ever.

        Parameters
        ----------
        now
            Local time.

        Returns
        -------
        float or None
            [s]
        """
        if not self.spans:
            return None
        state, start = self.is_on(now), now.replace(second=0, microsecond=0)
        for minutes in range(1, _DAY_MIN + 1):
            then = start + timedelta(minutes=minutes)
            if self.is_on(then) != state:
                return (then - now).total_seconds()
        return float((start + timedelta(days=1) - now).total_seconds())


def _span(word: str) -> tuple[int, int]:
    match = _SPAN.fullmatch(word.replace(" ", ""))
    if match is None:
        raise ValueError(f"{word!r} is no span of a day; write it like 09:00-18:30")
    first_h, first_min, last_h, last_min = (int(part) for part in match.groups())
    first, last = first_h * 60 + first_min, last_h * 60 + last_min
    if last > _DAY_MIN or first == last:
        raise ValueError(f"{word!r} is no span of a day: it lasts no time, or ends after 24:00")
    return first, last


def _holds(span: tuple[int, int], minute: int) -> bool:
    first, last = span
    return first <= minute < last if first < last else minute >= first or minute < last
