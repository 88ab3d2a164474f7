"""Saved shows, and the keeper of the one that has to run: begun by itself, begun again when it ends, at its hours."""

from __future__ import annotations

import asyncio
import json
from dataclasses import dataclass
from datetime import datetime, time
from pathlib import Path

from rig.devices.network.powered_projector import control_of
from rig.devices.protocols import Clock
from rig.errors import RigError, UsageError
from rig.files.atomic import write_bytes
from rig.page.jobs.holder import Job
from rig.page.jobs.requests import ShowJob
from rig.page.server.folders import Folders
from rig.page.workplace import Workplace
from rig.records import Record, read_record
from rig.session import Session

_FIRST_PAUSE_S, _LONGEST_PAUSE_S = 1.0, 8.0
"""Before the first new start, and before any: doubled in between. A show is back within 10 s of what hindered it."""
_STEADY_S = 60.0
"""A show that ran for so long begins with the first pause again."""
_LOOK_S = 0.5


@dataclass(frozen=True, kw_only=True)
class PageShow(Record):
    """A show that can be begun by its name."""

    show: ShowJob
    on_at: str = ""
    """HH:MM from which it runs every day, this machine's time; empty: always."""
    off_at: str = ""
    """HH:MM at which it ends."""
    power: bool = False
    """Switch the projector off when its hours end, by the profile's PJLink address; opening it switches it on."""

    def hours(self) -> tuple[time, time] | None:
        """When it runs. Raises UsageError for what is no time of day."""
        if not self.on_at and not self.off_at:
            return None
        try:
            return time.fromisoformat(self.on_at), time.fromisoformat(self.off_at)
        except ValueError as error:
            raise UsageError("on_at and off_at are times of day, e.g. 09:00 and 18:30; both, or none") from error

    def runs_at(self, now: time) -> bool:
        """Whether it runs at a time of day; hours may go over midnight."""
        hours = self.hours()
        if hours is None:
            return True
        on, off = hours
        return on <= now < off if on <= off else now >= on or now < off


def read_show(path: Path) -> PageShow:
    """Read a saved show. Raises UsageError when there is none, or it makes no sense."""
    try:
        found = read_record(PageShow, json.loads(path.read_bytes()))
    except (OSError, ValueError, RecursionError) as error:
        raise UsageError(f"{path.stem}: no saved show of that name can be read; save it again on the page") from error
    found.hours()
    return found


def write_show(path: Path, show: PageShow) -> None:
    """Save a show. Raises UsageError for hours that are none, SessionError when the disk refuses."""
    show.hours()
    path.parent.mkdir(parents=True, exist_ok=True)
    write_bytes(path, json.dumps(show.as_json(), indent=2).encode() + b"\n")


@dataclass(frozen=True, kw_only=True)
class KeeperStatus(Record):
    """How the show is that has to run."""

    name: str = ""
    """Empty when none has to."""
    phase: str = "none"
    """none, running, waiting (to begin again), off (not its hours), or let go (an operator stopped it)."""
    restarts: int = 0
    error: str = ""
    """Why it ended last."""

    @property
    def is_well(self) -> bool:
        """Whether nobody need be called."""
        return self.phase != "waiting"


class PageShowKeeper:
    """Sees to it that one show runs: starts it, and again with longer and longer pauses when it ends.

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
        self._task: asyncio.Task[None] | None = None
        self._job: Job | None = None
        self._is_off = False

    def keep(self, name: str) -> None:
        """Let a saved show run from now on. Raises UsageError when there is none of that name."""
        read_show(self._workplace.folders.show(name))
        self._name, self._is_let_go, self._pause_s = name, False, _FIRST_PAUSE_S
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

    async def _run(self) -> None:
        restarts, error, begun_s = 0, "", self._clock.now_s()
        while True:
            phase = await self._step(begun_s)
            if phase == "begun":
                begun_s = self._clock.now_s()
                restarts += self._job is not None
                phase = await self._begin()
            job = self._job
            if job is not None and not job.is_running:
                error = job.error or f"it ended ({job.phase})"
            self.status = KeeperStatus(name=self._name, phase=phase, restarts=restarts, error=error)
            self._workplace.news.tell("keeper", self.status.as_json())
            await asyncio.sleep(_LOOK_S)

    async def _step(self, begun_s: float) -> str:
        """What the show should do now: begun, running, waiting, off, or let go."""
        holder, job = self._workplace.holder, self._job
        if self._is_let_go:
            return "let go"
        saved = read_show(self._workplace.folders.show(self._name))
        is_running = job is not None and job.is_running
        if not saved.runs_at(datetime.now().astimezone().time()):
            if is_running:
                await holder.stop()
            await self._switch_off(saved)
            return "off"
        self._is_off = False
        if is_running:
            if self._clock.now_s() - begun_s > _STEADY_S:
                self._pause_s = _FIRST_PAUSE_S
            return "running"
        if holder.is_busy:
            return "waiting"
        if job is not None and job.ended_s is not None:
            await asyncio.sleep(self._pause_s)
            self._pause_s = min(2 * self._pause_s, _LONGEST_PAUSE_S)
        return "begun"

    async def _begin(self) -> str:
        saved = read_show(self._workplace.folders.show(self._name))
        try:
            self._job = await self._workplace.start("show", saved.show)
        except RigError as error:
            self._workplace.news.tell("refused", {"error": str(error)})
            await asyncio.sleep(self._pause_s)
            self._pause_s = min(2 * self._pause_s, _LONGEST_PAUSE_S)
            return "waiting"
        return "running"

    async def _switch_off(self, saved: PageShow) -> None:
        """Switch the projector off once; one that does not answer is told."""
        if not saved.power or self._is_off:
            return
        self._is_off = True
        try:
            await asyncio.to_thread(switch_projector_off, saved.show, self._workplace.folders)
        except RigError as error:
            self._workplace.news.tell("refused", {"error": f"projector power: {error}"})


def switch_projector_off(show: ShowJob, folders: Folders) -> None:
    """Switch off the projector of a show by its profile's PJLink table. Raises UsageError without one, DeviceError."""
    if show.profile is not None:
        profile = folders.read_profile(show.profile)
    else:
        profile = Session.read(folders.session(show.session or "")).profile
    settings = profile.projectors[0].pjlink
    if settings is None:
        raise UsageError(f"{profile.name}: has no [projector.pjlink]; write its address into the profile")
    control_of(settings, profile.path).switch_off()
