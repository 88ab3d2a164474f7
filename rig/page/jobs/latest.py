"""The newest picture of a job, for any number of pages: each takes what is newest when it is ready for one."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass

from rig.records import JsonObject


@dataclass(frozen=True, kw_only=True)
class StreamedFrame:
    """A picture, and what is known of it."""

    number: int
    facts: JsonObject
    jpeg: bytes
    overlay: bytes = b""


class LatestFrame:
    """Holds one picture; the next one takes its place, whoever has seen it. Used in the event loop's thread alone."""

    def __init__(self) -> None:
        self._frame: StreamedFrame | None = None
        self._number = 0
        self._changed = asyncio.Event()
        self.readers = 0
        """Pages that take pictures."""

    def put(self, facts: JsonObject, jpeg: bytes, overlay: bytes = b"") -> None:
        """Replace the picture."""
        self._number += 1
        self._frame = StreamedFrame(number=self._number, facts=facts, jpeg=jpeg, overlay=overlay)
        changed, self._changed = self._changed, asyncio.Event()
        changed.set()

    def forget(self) -> None:
        """Show no picture of a job that is over."""
        self._frame = None

    async def after(self, number: int, timeout_s: float) -> StreamedFrame | None:
        """Return the newest picture as soon as it is newer than a number; None when none came in time."""
        changed = self._changed
        if self._frame is not None and self._frame.number > number:
            return self._frame
        try:
            await asyncio.wait_for(changed.wait(), timeout_s)
        except TimeoutError:
            return None
        return self._frame
