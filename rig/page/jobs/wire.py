"""Messages between the server and a job's process: a line of JSON, and after it the bytes that it announces."""

from __future__ import annotations

import json
import os
import queue
import signal
import threading
from collections.abc import Callable
from typing import IO

from rig.records import Json, JsonObject

PARTS = "parts"
"""Key of a message: how many bytes each of the pieces has that follow it."""
LONGEST_LINE = 1 << 24
"""A message without its pieces; a scene's patches are the longest."""


class Wire:
    """A job's end: orders come in, messages go out. A server that is gone counts as an order to stop.

    Parameters
    ----------
    orders, messages
        Binary streams.
    """

    def __init__(self, orders: IO[bytes], messages: IO[bytes]):
        self._orders, self._messages = orders, messages
        self._waiting: queue.SimpleQueue[JsonObject] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self.is_stopping = False
        """Somebody asked for the end."""
        self.on_stop: Callable[[], None] = lambda: None
        """Called, in a thread of its own, when it is time to end."""

    @classmethod
    def of_this_process(cls) -> Wire:
        """Take standard input and output for the wire; whatever is printed goes to standard error."""
        messages = os.fdopen(os.dup(1), "wb")
        os.dup2(2, 1)
        # Unbuffered: a thread that waits for orders holds no lock that the end of the process would need.
        return cls(os.fdopen(os.dup(0), "rb", buffering=0), messages)

    def first(self) -> JsonObject | None:
        """Wait for an order that says what the job is, before :meth:`listen`; None when there will be none."""
        line = self._orders.readline()
        if not line:
            return None
        found: Json = json.loads(line)
        if not isinstance(found, dict):
            raise ValueError("the first order is no object")
        return found

    def listen(self) -> None:
        """Hear other orders from now on."""
        threading.Thread(target=self._listen, name="orders", daemon=True).start()

    def orders(self) -> list[JsonObject]:
        """Return what was ordered since the last call."""
        found = []
        while not self._waiting.empty():
            found.append(self._waiting.get())
        return found

    def tell(self, what: str, message: JsonObject, *pieces: bytes) -> None:
        """Send a message; ends quietly when nobody listens any more."""
        sizes: list[Json] = [len(piece) for piece in pieces]
        line = json.dumps({"what": what, **message, PARTS: sizes}).encode() + b"\n"
        with self._lock:
            try:
                self._messages.write(line + b"".join(pieces))
                self._messages.flush()
            except (BrokenPipeError, ValueError):
                self._stop()

    def _listen(self) -> None:
        for line in self._orders:
            order: Json = json.loads(line)
            if isinstance(order, dict) and order.get("do") == "stop":
                self._stop()
            elif isinstance(order, dict):
                self._waiting.put(order)
        self._stop()

    def _stop(self) -> None:
        if not self.is_stopping:
            self.is_stopping = True
            self.on_stop()


def interrupt_this_process() -> None:
    """End what is at work as Ctrl-C does: nothing that was photographed is lost."""
    os.kill(os.getpid(), signal.SIGINT)
