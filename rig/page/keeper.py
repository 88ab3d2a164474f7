"""Sees to it that the process of a saved show runs: the show itself is kept by :mod:`rig.shows` inside of it."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass

from rig.devices.protocols import Clock
from rig.errors import RigError
from rig.page.jobs.holder import Job
from rig.page.jobs.requests import KeepJob
from rig.page.shows import read_saved
from rig.page.workplace import Workplace
from rig.records import Record

_FIRST_PAUSE_S, _LONGEST_PAUSE_S = 0.25, 8.0
"""Before the first new process, and before any: doubled in between. A show is back within 10 s of what hindered it."""
_STEADY_S = 60.0
"""A process that ran for so long begins with the first pause again."""
_SPARE_AFTER_S = 2.0
"""After its start, once it shows: the next process gets ready beside it, so that only devices are left to be opened."""
_LOOK_S = 0.5
_PHASES = {"showing": "running", "waiting": "waiting", "off": "off"}
"""By what the keeper within the process says it does."""


@dataclass(frozen=True, kw_only=True)
class KeeperStatus(Record):
    """How the show is that has to run."""

    name: str = ""
    """Empty when none has to."""
    phase: str = "none"
    """none, running, waiting (to begin again), off (not its hours), or let go (an operator stopped it)."""
    restarts: int = 0
    """Times that it began again, by itself or by a new process."""
    error: str = ""
    """Why it ended last."""
    has_spare: bool = False
    """Whether a second process is ready to take the place of the one that shows."""

    @property
    def is_well(self) -> bool:
        """Whether nobody need be called."""
        return self.phase != "waiting"


class ProcessKeeper:
    """Starts the process of a saved show, and again with longer and longer pauses when it ends.

    Parameters
    ----------
    workplace
        Where it runs.
    clock
        By which it waits.
    """

    def __init__(self, workplace: Workplace, clock: Clock):
        self.status = KeeperStatus()
        self._workplace = workplace
        self._clock = clock
        self._name = ""
        self._is_let_go = False
        self._pause_s = _FIRST_PAUSE_S
        self._begin_at_s = self._begun_s = 0.0
        self._processes = 0
        self._error = ""
        self._task: asyncio.Task[None] | None = None
        self._job: Job | None = None

    def keep(self, name: str) -> None:
        """Let a saved show run from now on. Raises UsageError, ProfileError when it cannot be read."""
        read_saved(self._workplace.folders, name)
        self._name, self._is_let_go, self._pause_s = name, False, _FIRST_PAUSE_S
        self._begin_at_s, self._processes, self._error = 0.0, 0, ""
        if self._task is None:
            self._task = asyncio.create_task(self._run())

    def let_go(self) -> None:
        """An operator stops it, or takes the rig for something else: it does not begin again until :meth:`keep`."""
        self._is_let_go = True

    async def close(self) -> None:
        """The server ends."""
        self._is_let_go = True
        if self._task is not None:
            self._task.cancel()
            await asyncio.wait([self._task])
        await self._workplace.holder.spare.drop()

    async def _run(self) -> None:
        while True:
            status = self._told(await self._step())
            if status != self.status:
                self.status = status
                self._workplace.news.tell("keeper", status.as_json())
            await asyncio.sleep(_LOOK_S)

    def _told(self, phase: str) -> KeeperStatus:
        kept = {} if self._job is None else self._job.kept
        again = max(int(str(kept.get("runs", 1))) - 1, 0) + max(self._processes - 1, 0)
        error = self._error or str(kept.get("last_failure", ""))
        spare = self._workplace.holder.spare.is_ready
        return KeeperStatus(name=self._name, phase=phase, restarts=again, error=error, has_spare=spare)

    async def _step(self) -> str:
        """Start the process when that is due, and return what the show does."""
        job, now_s = self._job, self._clock.now_s()
        if self._is_let_go:
            await self._workplace.holder.spare.drop()
            return "let go"
        if job is not None and job.is_running:
            if now_s - self._begun_s > _STEADY_S:
                self._pause_s = _FIRST_PAUSE_S
            phase = _PHASES.get(str(job.kept.get("phase")), "running")
            if job.kept and phase != "waiting" and now_s - self._begun_s > _SPARE_AFTER_S:
                await self._workplace.prepare_spare("keep", KeepJob(show=self._name))
            return phase
        if job is not None:
            self._job = None
            self._wait(job.error or f"it ended ({job.phase})")
        if now_s < self._begin_at_s or self._workplace.holder.is_busy:
            return "waiting"
        return await self._begin()

    async def _begin(self) -> str:
        try:
            self._job = await self._workplace.start("keep", KeepJob(show=self._name))
        except RigError as error:
            self._wait(str(error))
            self._workplace.news.tell("refused", {"error": str(error)})
            return "waiting"
        self._begun_s = self._clock.now_s()
        self._processes += 1
        return "running"

    def _wait(self, error: str) -> None:
        """Let some time pass before the next process, more each time."""
        self._error = error
        self._begin_at_s = self._clock.now_s() + self._pause_s
        self._pause_s = min(2 * self._pause_s, _LONGEST_PAUSE_S)
