"""Pictures of a job to a page: the newest each time the page is ready for one; one stream a page."""

from __future__ import annotations

import asyncio
import json
import struct
import time
from collections.abc import Callable

from starlette.requests import Request
from starlette.types import Receive, Scope, Send

from rig.page.jobs.latest import LatestFrame, StreamedFrame
from rig.records import JsonObject

MOST_STREAMS = 32
"""Of all pages together."""
_STALL_S = 10.0
"""A page that takes nothing for so long is let go: it asks again when it wakes up."""
_BEAT_S = 1.0
_LONGEST_S = 600.0
"""Then the page asks again: no connection lives for ever."""
TYPE = "application/x-rig-frames"


class Streams:
    """The streams that are open, by page: a page's next one ends the one before."""

    def __init__(self, is_closing: Callable[[], bool]):
        self.is_closing = is_closing
        self._open: dict[str, object] = {}

    def begin(self, client: str) -> object | None:
        """Return the mark of a new stream; None when there are too many."""
        if client not in self._open and len(self._open) >= MOST_STREAMS:
            return None
        mark = object()
        self._open[client] = mark
        return mark

    def is_current(self, client: str, mark: object) -> bool:
        """Whether a stream may go on."""
        return self._open.get(client) is mark and not self.is_closing()

    def end(self, client: str, mark: object) -> None:
        """A stream is over."""
        if self._open.get(client) is mark:
            del self._open[client]


def packed(frame: StreamedFrame) -> bytes:
    """Return a frame as a stream has it: three lengths (header, JPEG, overlay; 4 bytes each, big end first), then they.

    The header is JSON: what is known of the frame, and ``sent_s``, seconds since 1970.
    """
    facts: JsonObject = {**frame.facts, "stream_number": frame.number, "sent_s": time.time()}
    header = json.dumps(facts).encode()
    lengths = struct.pack(">III", len(header), len(frame.jpeg), len(frame.overlay))
    return b"".join((lengths, header, frame.jpeg, frame.overlay))


class FrameStream:
    """An answer that goes on until its reader leaves, falls asleep, or begins another.

    Parameters
    ----------
    request
        Of the reader, who names itself.
    latest
        Where pictures come from.
    streams
        Of all readers.
    """

    def __init__(self, client: str, latest: LatestFrame, streams: Streams, mark: object):
        self._client, self._latest, self._streams, self._mark = client, latest, streams, mark

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send frames."""
        gone = asyncio.create_task(_until_gone(Request(scope, receive)))
        self._latest.readers += 1
        try:
            headers = [(b"content-type", TYPE.encode())]
            await send({"type": "http.response.start", "status": 200, "headers": headers})
            await self._send_all(send, gone)
        except TimeoutError:
            return
        finally:
            gone.cancel()
            self._latest.readers -= 1
            self._streams.end(self._client, self._mark)

    async def _send_all(self, send: Send, gone: asyncio.Task[None]) -> None:
        number, until_s = 0, time.monotonic() + _LONGEST_S
        while self._streams.is_current(self._client, self._mark) and time.monotonic() < until_s and not gone.done():
            frame = await self._latest.after(number, _BEAT_S)
            if frame is not None and frame.number > number:
                number = frame.number
                body = {"type": "http.response.body", "body": packed(frame), "more_body": True}
                await asyncio.wait_for(send(body), _STALL_S)
        if not gone.done():
            await asyncio.wait_for(send({"type": "http.response.body", "body": b""}), _STALL_S)


async def _until_gone(request: Request) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass
