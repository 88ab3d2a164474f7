"""What happened, told to every page that is open: server-sent events, of each subject the latest only."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Callable

from rig.records import JsonObject

_BEAT_S = 1.0
"""Between two looks whether the server ends; and how soon a page that is gone is noticed."""
_SILENCE_BEATS = 10
"""After so many a comment is sent, so that nobody on the way takes the connection for dead."""


class News:
    """Subjects and what is the latest of each; a slow reader misses what was overtaken, and holds nobody up.

    Used in the event loop's thread alone.
    """

    def __init__(self, is_closing: Callable[[], bool] = lambda: False):
        self.latest: dict[str, JsonObject] = {}
        """By subject."""
        self._counts: dict[str, int] = {}
        self._changed = asyncio.Event()
        self._is_closing = is_closing
        self.readers = 0
        """Pages that listen."""

    def tell(self, subject: str, what: JsonObject) -> None:
        """Replace what is known of a subject."""
        self.latest[subject] = what
        self._counts[subject] = self._counts.get(subject, 0) + 1
        changed, self._changed = self._changed, asyncio.Event()
        changed.set()

    async def read(self) -> AsyncIterator[bytes]:
        """Yield events as they happen, beginning with what is known; ends when the server does."""
        told: dict[str, int] = {}
        silent = 0
        self.readers += 1
        try:
            while not self._is_closing():
                changed = self._changed
                news = [subject for subject, count in self._counts.items() if told.get(subject) != count]
                for subject in news:
                    told[subject] = self._counts[subject]
                    yield f"event: {subject}\ndata: {json.dumps(self.latest[subject])}\n\n".encode()
                silent = 0 if news else silent + 1
                if silent >= _SILENCE_BEATS:
                    yield b": still there\n\n"
                    silent = 0
                await _changed_or_beat(changed)
        finally:
            self.readers -= 1


async def _changed_or_beat(changed: asyncio.Event) -> None:
    try:
        await asyncio.wait_for(changed.wait(), _BEAT_S)
    except TimeoutError:
        return
