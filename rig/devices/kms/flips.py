"""When pictures were on screen, as the display's own clock tells it."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

_KEPT = 100_000
_LATE_PERIODS = 1.5


@dataclass(frozen=True, slots=True)
class Flip:
    """A picture that replaced another one."""

    asked_s: float
    """When the finished picture was handed to the kernel, on the monotonic clock."""
    time_s: float
    """Time stamp of the vertical blank after which it was on screen, by the kernel, on the same clock."""
    sequence: int
    """Number of that vertical blank; 0 where the driver does not count them."""


class FlipLog:
    """The last flips, in order, and how many ever came late: the proof of when each picture was on screen."""

    def __init__(self, period_s: float):
        self._period_s = period_s
        self._kept: deque[Flip] = deque(maxlen=_KEPT)
        self.count = 0
        """All flips, also those that are kept no longer."""
        self.late = 0
        """Flips that missed the next vertical blank: more than 1.5 refresh periods after they were asked for."""

    def append(self, flip: Flip) -> None:
        """Note a flip."""
        self._kept.append(flip)
        self.count += 1
        self.late += flip.time_s - flip.asked_s > _LATE_PERIODS * self._period_s

    def __iter__(self) -> Iterator[Flip]:
        return iter(tuple(self._kept))

    def __len__(self) -> int:
        return len(self._kept)

    def __getitem__(self, index: int) -> Flip:
        return self._kept[index]
