"""A process beside the one at work, which has read and computed all that the same work needs, and waits."""

from __future__ import annotations

import asyncio
import contextlib
import time

from rig.page.jobs.process import next_message, send, started
from rig.records import JsonObject

KIND = "spare"
"""Of the first order to such a process; the second says that it is its turn."""
_AGAIN_S = 60.0
"""After one that could not get ready, before the next: what hindered it will not be gone at once."""
_PATIENCE_S = 5.0
"""For one that is not needed any more: it ends when nothing can be ordered any more, and has no device."""


class Spare:
    """Keeps at most one spare process. Used in the event loop's thread alone."""

    def __init__(self) -> None:
        self._process: asyncio.subprocess.Process | None = None
        self._work: tuple[str, JsonObject] | None = None
        self._ready: asyncio.Task[bool] | None = None
        self._not_before_s = 0.0

    @property
    def is_ready(self) -> bool:
        """Whether it has everything, and waits."""
        task = self._ready
        return task is not None and task.done() and not task.cancelled() and task.exception() is None and task.result()

    async def prepare(self, kind: str, work: JsonObject) -> None:
        """Let a process get ready for some work, unless one is or does; it has the lowest priority meanwhile.

        Parameters
        ----------
        kind, work
            As they will be taken.
        """
        if self._process is not None and (self._work != (kind, work) or self._is_lost()):
            await self.drop()
        if self._process is None and time.monotonic() >= self._not_before_s:
            self._not_before_s = time.monotonic() + _AGAIN_S
            self._process = await started(KIND, work)
            self._work, self._ready = (kind, work), asyncio.create_task(_is_told_ready(self._process))

    def _is_lost(self) -> bool:
        return self._ready is not None and self._ready.done() and not self._can_begin()

    def _can_begin(self) -> bool:
        return self.is_ready and self._process is not None and self._process.returncode is None

    async def take(self, kind: str, work: JsonObject) -> asyncio.subprocess.Process | None:
        """Return the process, told to begin, if it is ready for this work; None where another has to be started."""
        if self._work != (kind, work):
            return None
        process = self._process
        if process is None or not self._can_begin():
            await self.drop()
            return None
        self._process = self._work = self._ready = None
        self._not_before_s = 0.0
        send(process, kind, work)
        return process

    async def drop(self) -> None:
        """End the process, if there is one."""
        process, ready = self._process, self._ready
        self._process = self._work = self._ready = None
        if ready is not None:
            ready.cancel()
        if process is None:
            return
        if process.stdin is not None:
            process.stdin.close()
        if process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(process.wait(), _PATIENCE_S)


async def _is_told_ready(process: asyncio.subprocess.Process) -> bool:
    """Wait for its word that it is ready; False when it ended, or could not."""
    if process.stdout is None:
        return False
    while (message := await next_message(process.stdout)) is not None:
        if message[0] in ("ready", "failed"):
            return message[0] == "ready"
    return False
