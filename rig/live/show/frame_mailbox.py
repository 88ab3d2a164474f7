"""The one place between the reader and the loop: it holds one picture, and a newer one takes its place.

Three buffers, for ever: one that the reader fills, one that waits, one that the loop works on. Nothing queues up.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from rig.devices.protocols import Clock
from rig.live.sources.source import Pixels

_NUDGE = 0.1
"""Share by which each picture moves its source's clock towards the display's."""
_PATIENCE_S = 0.1
"""Longest wait without a look at whether the show has ended."""


@dataclass(frozen=True, slots=True, eq=False)
class LiveFrame:
    """A picture that is to be shown."""

    number: int
    """Rises by one with each picture that was read, over all sources."""
    codes: Pixels
    """(H, W, 3) of the projector's shape; good until the next frame is taken."""
    ready_s: float
    """When it was complete in memory and due, or when it was taken, if that was earlier."""
    due_s: float | None = None
    """When it should be on screen by its source's clock; None for as soon as possible."""


class FrameQueue(Protocol):
    """Where the loop gets its pictures."""

    @property
    def dropped(self) -> int:
        """Pictures that a newer one replaced before they were taken."""
        ...

    @property
    def ended(self) -> bool:
        """Nothing waits, and nothing will come."""
        ...

    @property
    def is_timed(self) -> bool:
        """Its pictures come with the times when they are due, and so are known ahead."""
        ...

    def take(self, latch_s: float, target_s: float) -> LiveFrame | None:
        """Give the newest picture that is due when the display refreshes at ``target_s``; waits until ``latch_s``."""
        ...

    def skip(self, target_s: float) -> None:
        """Forget what is due at ``target_s``, without counting it; what was taken stays."""
        ...


@dataclass(slots=True)
class _Waiting:
    number: int
    buffer: int
    arrived_s: float
    media_s: float | None


class FrameMailbox:
    """A thread-safe frame queue with room for one picture.

    Pictures with a media time are due at that time on their source's clock, which begins when the first of them is
    taken and then follows the display's. The reader holds the one that follows until the one before is taken, or is
    over. Pictures without a media time are due when they come.

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
        self._following: _Waiting | None = None
        """In the reader's hands, complete."""
        self._taken, self._filling = 0, 1
        self._origin_s: float | None = None
        self._count = 0
        self._is_timed = False
        self._finished = False
        self._closed = False

    @property
    def ended(self) -> bool:
        """Nothing waits, and nothing will come."""
        with self._changed:
            return self._finished and self._waiting is None

    @property
    def is_timed(self) -> bool:
        """Whether the last picture had a media time."""
        with self._changed:
            return self._is_timed

    def writable(self) -> Pixels:
        """(H, W, 3) memory to fill next; the reader's alone until it is offered."""
        with self._changed:
            used = {self._taken, *(entry.buffer for entry in (self._waiting, self._following) if entry is not None)}
            self._filling = next(k for k in range(3) if k not in used)
            return self._buffers[self._filling]

    def offer(self, media_s: float | None) -> None:
        """Hand over what :meth:`writable` gave. With a media time, waits until the one before was taken or is over."""
        with self._changed:
            self._count += 1
            self._is_timed = media_s is not None
            entry = _Waiting(self._count, self._filling, self._clock.now_s(), media_s)
            if media_s is not None and self._waiting is not None:
                self._following = entry
                self._wait_for_turn(entry, media_s)
                return
            self._replace(entry)

    def _wait_for_turn(self, entry: _Waiting, media_s: float) -> None:
        while self._following is entry and not self._closed:
            left_s = self._until_s(media_s)
            if left_s <= 0:
                self._following = None
                self._replace(entry)
            else:
                self._changed.wait(min(left_s, _PATIENCE_S))
        if self._following is entry:  # closed
            self._following = None

    def _until_s(self, media_s: float) -> float:
        """How long until a media time; some time as long as its clock stands."""
        return _PATIENCE_S if self._origin_s is None else self._origin_s + media_s - self._clock.now_s()

    def _replace(self, entry: _Waiting) -> None:
        self.dropped += self._waiting is not None
        self._waiting = entry
        self._changed.notify_all()

    def _promote(self) -> None:
        """What was waiting is gone: the following one waits, and the reader may go on."""
        self._waiting, self._following = self._following, None
        self._changed.notify_all()

    def take(self, latch_s: float, target_s: float) -> LiveFrame | None:
        """Give the newest picture that is due; None when there is none by ``latch_s``."""
        with self._changed:
            while not self._is_due(self._waiting, target_s):
                left_s = latch_s - self._clock.now_s()
                if left_s <= 0 or self._closed or (self._finished and self._waiting is None):
                    return None
                self._changed.wait(left_s)
            while self._is_due(self._following, target_s) and self._origin_s is not None:
                self.dropped += 1
                self._promote()
            return self._give(target_s)

    def _is_due(self, entry: _Waiting | None, target_s: float) -> bool:
        if entry is None:
            return False
        if entry.media_s is None or self._origin_s is None:
            return True
        return self._origin_s + entry.media_s <= target_s + self._period_s / 2

    def _give(self, target_s: float) -> LiveFrame | None:
        entry, now_s = self._waiting, self._clock.now_s()
        if entry is None:
            return None
        due_s = None if entry.media_s is None else self._due_s(entry.media_s, entry.arrived_s, target_s)
        ready_s = entry.arrived_s if due_s is None else min(max(entry.arrived_s, due_s), now_s)
        self._taken = entry.buffer
        self._promote()
        return LiveFrame(entry.number, self._buffers[entry.buffer], ready_s, due_s)

    def _due_s(self, media_s: float, arrived_s: float, target_s: float) -> float:
        """When a picture should be on screen; its source's clock follows the display's, and waits for a late reader."""
        if self._origin_s is None:
            self._origin_s = target_s - media_s
        due_s = self._origin_s + media_s
        off_s = target_s - due_s
        if abs(off_s) <= self._period_s / 2:
            self._origin_s += _NUDGE * off_s
        elif arrived_s > due_s - self._period_s:
            self._origin_s += off_s
            return target_s
        return due_s

    def hold(self, media_s: float) -> None:
        """Wait until a media time: a source's last picture stays as long as the others did."""
        with self._changed:
            while (self._origin_s is not None or self._waiting is not None) and not self._closed:
                left_s = self._until_s(media_s)
                if left_s <= 0:
                    return
                self._changed.wait(min(left_s, _PATIENCE_S))

    def skip(self, target_s: float) -> None:
        """Forget what is due."""
        with self._changed:
            if self._is_due(self._waiting, target_s):
                self._promote()

    def restart(self) -> None:
        """Another source begins: forget what waits, and its clock."""
        with self._changed:
            self._waiting = self._following = self._origin_s = None
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
