"""Holds the rig: starts a job's process, passes orders to it and its messages on, and sees to its end."""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from rig.errors import RigError
from rig.page.jobs.latest import LatestFrame
from rig.page.jobs.process import keep_lines, next_message, started
from rig.page.jobs.spare import Spare
from rig.page.server.news import News
from rig.records import JsonObject

_PATIENCE_S = 20.0
"""For a job that was asked to end: a photograph at the longest exposure, and black on the projector."""
_LAST_PATIENCE_S = 5.0
_MOST_FAULTS = 100
_ERROR_LINES = 30


class RigBusy(RigError):
    """The rig is at work on something else."""


@dataclass(kw_only=True, eq=False)
class Job:
    """A job, as pages see it."""

    number: int
    kind: str
    title: str
    asked: JsonObject
    """As HTTP brought it."""
    started_s: float
    """Seconds since 1970."""
    phase: str = "running"
    """running, stopping, done, stopped or failed."""
    label: str = "start"
    done: int = 0
    total: int = 0
    error: str = ""
    error_kind: str = ""
    ended_s: float | None = None
    result: JsonObject | None = None
    state: JsonObject = field(default_factory=dict)
    """What the devices really do, of jobs that tell."""
    kept: JsonObject = field(default_factory=dict)
    """What the keeper of a saved show does."""
    faults: deque[JsonObject] = field(default_factory=lambda: deque(maxlen=_MOST_FAULTS))
    steps: list[str] = field(default_factory=list)
    """What was done before, in order."""

    @property
    def is_running(self) -> bool:
        """Whether it has the rig."""
        return self.phase in ("running", "stopping")

    def as_json(self) -> JsonObject:
        """All but the result, which has an address of its own."""
        return {
            "number": self.number,
            "kind": self.kind,
            "title": self.title,
            "asked": self.asked,
            "started_s": self.started_s,
            "phase": self.phase,
            "label": self.label,
            "done": self.done,
            "total": self.total,
            "error": self.error,
            "error_kind": self.error_kind,
            "ended_s": self.ended_s,
            "steps": list(self.steps),
            "faults": list(self.faults),
        }


class JobHolder:
    """One job at a time, in a process of its own. Used in the event loop's thread alone.

    Parameters
    ----------
    news
        Told what happens.
    """

    def __init__(self, news: News):
        self.latest = LatestFrame()
        """The newest picture of the job."""
        self.job: Job | None = None
        """The one that is at work, or the last one; None before the first."""
        self.spare = Spare()
        """A process that is ready for the same work, where somebody asked for one."""
        self._news = news
        self._process: asyncio.subprocess.Process | None = None
        self._numbers = 0
        self._follower: asyncio.Task[None] | None = None
        self._is_starting = False
        self.on_end: Callable[[Job], None] = lambda _: None
        """Told each job that is over."""

    @property
    def is_busy(self) -> bool:
        """Whether a job has the rig."""
        return self._is_starting or (self.job is not None and self.job.is_running)

    async def start(self, kind: str, title: str, asked: JsonObject, work: JsonObject) -> Job:
        """Begin a job.

        Parameters
        ----------
        kind, title
            What it is, for programs and for people.
        asked
            As it was asked for, for pages.
        work
            As its process needs it, with paths in place of names.

        Raises
        ------
        RigBusy
            The rig is at work.
        """
        if self.is_busy:
            at = self.job.title if self.job is not None else "something"
            raise RigBusy(f"the rig is at work: {at}; stop that first, or wait for its end")
        self._is_starting = True
        try:
            self._process = await self.spare.take(kind, work) or await started(kind, work)
        finally:
            self._is_starting = False
        self._numbers += 1
        self.latest.forget()
        job = Job(number=self._numbers, kind=kind, title=title, asked=asked, started_s=time.time())
        self.job = job
        self._tell()
        self._follower = asyncio.create_task(self._follow(job, self._process))
        return job

    def order(self, order: JsonObject) -> None:
        """Pass an order to the job. Raises RigBusy when there is none."""
        if self._process is None or self._process.stdin is None or not self.is_busy:
            raise RigBusy("nothing is at work that could be told something; start it first")
        with contextlib.suppress(ConnectionError, RuntimeError):
            self._process.stdin.write(json.dumps(order).encode() + b"\n")

    async def stop(self) -> None:
        """Ask the job to end, and see that it does: nothing that was photographed is lost."""
        job, process, follower = self.job, self._process, self._follower
        if job is None or process is None or follower is None or not job.is_running:
            return
        if job.phase == "running":
            job.phase = "stopping"
            self._tell()
            self.order({"do": "stop"})
        for patience_s, harder in ((_PATIENCE_S, process.terminate), (_LAST_PATIENCE_S, process.kill)):
            if await _ended(follower, patience_s):
                return
            with contextlib.suppress(ProcessLookupError):
                harder()
        await _ended(follower, _LAST_PATIENCE_S)

    async def _follow(self, job: Job, process: asyncio.subprocess.Process) -> None:
        """Take the job's messages until its process ends."""
        if process.stdout is None or process.stderr is None:
            raise RuntimeError("a job's process has no streams")
        said: deque[str] = deque(maxlen=_ERROR_LINES)
        errors = asyncio.create_task(keep_lines(process.stderr, said))
        try:
            while (message := await next_message(process.stdout)) is not None:
                self._take(job, *message)
        finally:
            with contextlib.suppress(ConnectionError, RuntimeError):
                if process.stdin is not None:
                    process.stdin.close()
            status = await process.wait()
            await errors
            self._end(job, status, said)

    def _take(self, job: Job, what: str, message: JsonObject, pieces: list[bytes]) -> None:
        match what:
            case "progress":
                _note_progress(job, message)
                self._tell()
            case "frame" if pieces and pieces[0]:
                self.latest.put(message, *pieces[:2])
            case "state":
                job.state = message
                self._news.tell("state", message)
            case "kept":
                job.kept = message
            case "fault":
                job.faults.append(message)
                self._tell()
            case "refused":
                self._news.tell("refused", message)
            case "failed":
                job.phase, job.error = "failed", str(message["error"])
                job.error_kind = str(message["kind"])
            case "stopped":
                job.phase = "stopped"
            case "result" if isinstance(message["result"], dict):
                job.result = message["result"]

    def _end(self, job: Job, status: int, said: deque[str]) -> None:
        if job.is_running:
            was_asked = job.phase == "stopping"
            job.phase = "done" if status == 0 else "stopped" if was_asked else "failed"
            if job.phase == "failed":
                last = " ".join(line for line in list(said)[-3:])
                job.error = f"its process ended with status {status}: {last or 'no word'}"
                job.error_kind = "Crashed"
        job.ended_s = time.time()
        self._process = None
        self._tell()
        self.on_end(job)

    def _tell(self) -> None:
        if self.job is not None:
            self._news.tell("job", self.job.as_json())


async def ask(kind: str, asked: JsonObject | None = None, timeout_s: float = 60.0) -> JsonObject:
    """Let a process of its own find something out that needs no rig.

    Raises
    ------
    RigError
        It could not, or took too long.
    """
    process = await started(kind, asked or {})
    if process.stdout is None:
        raise RuntimeError("a job's process has no streams")
    try:
        async with asyncio.timeout(timeout_s):
            while (message := await next_message(process.stdout)) is not None:
                what, content, _ = message
                if what == "failed":
                    raise RigError(str(content["error"]))
                if what == "result" and isinstance(content["result"], dict):
                    return content["result"]
    except TimeoutError as error:
        raise RigError(f"{kind}: no answer within {timeout_s:g} s; look on the command line") from error
    finally:
        with contextlib.suppress(ProcessLookupError):
            process.kill()
        await process.wait()
    raise RigError(f"{kind}: its process ended without an answer; look on the command line")


async def _ended(task: asyncio.Task[None], timeout_s: float) -> bool:
    await asyncio.wait([task], timeout=timeout_s)
    return task.done()


def _note_progress(job: Job, message: JsonObject) -> None:
    label = str(message["label"])
    if label != job.label:
        if job.label not in ("start", *job.steps):
            job.steps.append(job.label)
        job.label = label
    job.done, job.total = (int(str(message[key])) for key in ("done", "total"))
