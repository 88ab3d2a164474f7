"""The one place between the reader and the loop: it holds one picture, and a newer one takes its place.

Three buffers, for ever: one that is being filled, one that waits, one that the loop works on. Nothing queues up.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from rig.devices.protocols import Clock
from rig.live.source import Pixels

_NUDGE = 0.1
"""Share by which each picture moves its source's clock towards the display's."""
_PATIENCE_S = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class LiveFrame:
    """A picture that is to be shown."""

    number: int
    """Rises by one with each picture that was read, over all sources."""
    codes: Pixels
    """(H, W, 3) of the projector's shape; good until the next frame is taken."""
    ready_s: float
    """When it was complete in memory and due, or when it was taken, if that was earlier."""


class Feed(Protocol):
    """Where the loop gets its pictures."""

    @property
    def dropped(self) -> int:
        """Pictures that a newer one replaced before they were taken."""
        ...

    @property
    def ended(self) -> bool:
        """Nothing waits, and nothing will come."""
        ...

    def take(self, latch_s: float, target_s: float) -> LiveFrame | None:
        """Give the newest picture that is due when the display refreshes at ``target_s``; waits until ``latch_s``."""
        ...

    def skip(self) -> None:
        """Forget what waits, without counting it; what was taken stays."""
        ...


@dataclass(slots=True)
class _Waiting:
    number: int
    buffer: int
    arrived_s: float
    media_s: float | None


class Slot:
    """A thread-safe feed with room for one picture.

    Pictures with a media time are due at that time on their source's clock, which begins when the first of them is
    taken and then follows the display's. The reader may be one picture ahead; it waits for its turn. Pictures without
    one are due when they come.

    Parameters
    ----------
    shape
        (height, width) of the pictures.
    period_s
        Of the display.
    clock
        The machine's.
    """

    def __init__(self, shape: tuple[int, int], period_s: float, clock: Clock):
        self.dropped = 0
        self._buffers = [np.zeros((*shape, 3), np.uint8) for _ in range(3)]
        self._period_s = period_s
        self._clock = clock
        self._changed = threading.Condition()
        self._waiting: _Waiting | None = None
        self._taken = 0
        self._origin_s: float | None = None
        self._count = 0
        self._finished = False
        self._closed = False

    @property
    def ended(self) -> bool:
        """Nothing waits, and nothing will come."""
        with self._changed:
            return self._finished and self._waiting is None

    def writable(self) -> Pixels:
        """(H, W, 3) memory to fill next; the reader's alone until it is offered."""
        with self._changed:
            return self._buffers[self._free()]

    def _free(self) -> int:
        used = {self._taken, -1 if self._waiting is None else self._waiting.buffer}
        return next(k for k in range(3) if k not in used)

    def offer(self, media_s: float | None) -> None:
        """Hand over what :meth:`writable` gave. With a media time, waits until the one before was taken or is over."""
        with self._changed:
            buffer = self._free()
            if media_s is not None:
                self._wait_for_turn(media_s)
            if self._closed:
                return
            if self._waiting is not None:
                self.dropped += 1
            self._count += 1
            self._waiting = _Waiting(self._count, buffer, self._clock.now_s(), media_s)
            self._changed.notify_all()

    def _wait_for_turn(self, media_s: float) -> None:
        """A reader that is late moves its source's clock: the film goes on more slowly, but whole."""
        while self._waiting is not None and not self._closed:
            left_s = _PATIENCE_S if self._origin_s is None else self._origin_s + media_s - self._clock.now_s()
            if left_s <= 0:
                return
            self._changed.wait(min(left_s, _PATIENCE_S))
        if self._origin_s is not None and self._waiting is None:
            late_s = self._clock.now_s() - (self._origin_s + media_s)
            self._origin_s += late_s if late_s > self._period_s else 0.0

    def take(self, latch_s: float, target_s: float) -> LiveFrame | None:
        """Give the picture that is due; None when there is none by ``latch_s``."""
        with self._changed:
            while not self._is_due(target_s):
                left_s = latch_s - self._clock.now_s()
                if left_s <= 0 or self._closed or (self._finished and self._waiting is None):
                    return None
                self._changed.wait(left_s)
            return self._give(target_s)

    def _is_due(self, target_s: float) -> bool:
        waiting = self._waiting
        if waiting is None:
            return False
        if waiting.media_s is None or self._origin_s is None:
            return True
        return self._origin_s + waiting.media_s <= target_s + self._period_s / 2

    def _give(self, target_s: float) -> LiveFrame | None:
        waiting, now_s = self._waiting, self._clock.now_s()
        if waiting is None:
            return None
        ready_s = waiting.arrived_s
        if waiting.media_s is not None:
            if self._origin_s is None:
                self._origin_s = target_s - waiting.media_s
            late_s = target_s - (self._origin_s + waiting.media_s)
            ready_s = min(max(ready_s, self._origin_s + waiting.media_s), now_s)
            if abs(late_s) <= self._period_s / 2:
                self._origin_s += _NUDGE * late_s
        self._taken, self._waiting = waiting.buffer, None
        self._changed.notify_all()
        return LiveFrame(waiting.number, self._buffers[self._taken], ready_s)

    def hold(self, media_s: float) -> None:
        """Wait until a media time: a source's last picture stays as long as the others did."""
        with self._changed:
            while self._origin_s is not None or self._waiting is not None:
                left_s = _PATIENCE_S if self._origin_s is None else self._origin_s + media_s - self._clock.now_s()
                if left_s <= 0 or self._closed:
                    return
                self._changed.wait(min(left_s, _PATIENCE_S))

    def skip(self) -> None:
        """Forget what waits."""
        with self._changed:
            self._waiting = None
            self._changed.notify_all()

    def restart(self) -> None:
        """Another source begins: forget what waits, and its clock."""
        with self._changed:
            self._waiting, self._origin_s = None, None
            self._changed.notify_all()

    def finish(self) -> None:
        """Say that nothing more will come."""
        with self._changed:
            self._finished = True
            self._changed.notify_all()

    def close(self) -> None:
        """Let everybody who waits go on."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
