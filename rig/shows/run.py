"""A saved show from its file to its end: plan, log, lamp, recordings, commands, and what keeps it."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from datetime import datetime
from logging.handlers import RotatingFileHandler
from pathlib import Path

from rig.devices.clock import SystemClock
from rig.errors import SessionError
from rig.live.plan import LivePlan
from rig.live.run import OnStatus, run_live
from rig.live.show.controls import NoRemote, RemoteControl
from rig.live.watcher import ShowWatcher
from rig.shows.disk import keep_within
from rig.shows.keeper import KeeperState, KeptShow, ShowKeeper
from rig.shows.lamp import KeptLamp, control_of, lamp_file
from rig.shows.prepared import PreparedShow, prepare_show
from rig.shows.remote import Desk, OscListener, Remote
from rig.shows.saved import LogSettings, SavedShow
from rig.terminal import OnStep, silent
from rig.terminal.signals import EndSignals

_TIDY_S = 60.0
"""Between two looks at what recordings take."""

log = logging.getLogger("rig.shows")


@dataclass(frozen=True, kw_only=True, eq=False)
class Operator:
    """Who follows a kept show beside the person at the terminal, and orders: a page."""

    remote: RemoteControl = field(default_factory=NoRemote)
    watcher: ShowWatcher | None = None
    on_state: Callable[[KeeperState], None] = lambda _: None
    """Told whenever the show begins, waits to begin again, or goes off."""


_NOBODY = Operator()


def keep_show(
    name: str,
    on_step: OnStep = silent,
    on_status: OnStatus = lambda _: None,
    *,
    operator: Operator = _NOBODY,
    prepared: PreparedShow | None = None,
) -> KeptShow:
    """Run a saved show until somebody ends it; the projector is black whenever it is not shown.

    Parameters
    ----------
    name
        File or name of the show.
    on_step
        Told how far its preparation is.
    on_status
        Told a line for a person twice a second.
    operator
        Who follows it and orders from elsewhere.
    prepared
        The same show as it was prepared before: used where no file of it has changed since.

    Returns
    -------
    KeptShow

    Raises
    ------
    UsageError, ProfileError, SessionError
        It cannot begin.
    """
    if prepared is None or not prepared.is_current():
        prepared = prepare_show(name, on_step)
    show, path, plan = prepared.show, prepared.path, prepared.plan
    with ExitStack() as stack:
        stack.enter_context(_logging(path.with_suffix(".log"), show.log))
        remote = Remote()
        if show.osc is not None:
            stack.enter_context(OscListener(remote, show.osc.host, show.osc.port))
        signals = stack.enter_context(EndSignals())
        keeper = _keeper(
            show,
            path,
            plan,
            desk=Desk(remote, operator.remote),
            signals=signals,
            operator=operator,
            on_status=on_status,
        )
        return replace(keeper.keep(), signal=signals.name or None)


def _keeper(
    show: SavedShow,
    path: Path,
    plan: LivePlan,
    *,
    desk: Desk,
    signals: EndSignals,
    operator: Operator,
    on_status: OnStatus,
) -> ShowKeeper:
    clock = SystemClock()
    pjlink = control_of(plan.profile.projector.pjlink) if show.switch_off else None
    lamp = KeptLamp(lamp_file(path), pjlink, show.lamp_hours_limit)
    tidy = _Tidy(show, path, clock)

    def told(line: str) -> None:
        tidy.look()
        on_status(line)

    def play(seconds: float | None) -> str:
        request = replace(plan.request, seconds=seconds, record=tidy.new_recording())
        desk.begin()
        result = run_live(replace(plan, request=request), told, desk, operator.watcher)
        for note in result.notes:
            log.info("%s", note)
        figures = result.figures
        log.info("%d frames, %d late, ended by %s", figures.frames, figures.late_frames, result.ended_by)
        return result.ended_by

    return ShowKeeper(
        play=play,
        timetable=show.timetable,
        clock=clock,
        time_of_day=datetime.now,
        is_ended=lambda: signals.received is not None,
        lamp=lamp,
        on_state=operator.on_state,
    )


class _Tidy:
    """Recordings of a show, and what they may take."""

    def __init__(self, show: SavedShow, path: Path, clock: SystemClock):
        self._folder = None if show.record is None else path.parent / show.record
        self._limit_bytes = int(show.record_limit_gb * 1e9)
        self._clock = clock
        self._looked_s = -math.inf

    def new_recording(self) -> Path | None:
        """Return a new folder for a run's recording; None where nothing is recorded."""
        return None if self._folder is None else self._folder / f"{datetime.now():%Y%m%d-%H%M%S-%f}"

    def look(self) -> None:
        """Keep recordings within their limit, now and then."""
        now_s = self._clock.now_s()
        if self._folder is None or now_s - self._looked_s < _TIDY_S:
            return
        self._looked_s = now_s
        if deleted := keep_within(self._folder, self._limit_bytes):
            log.info("%d old pictures of recordings were deleted", deleted)


@contextmanager
def _logging(path: Path, settings: LogSettings) -> Iterator[None]:
    """Write the show's log beside its file, in files of a limited size. Raises SessionError when that fails."""
    try:
        handler = RotatingFileHandler(
            path, maxBytes=int(settings.size_mb * 1e6), backupCount=settings.files - 1, encoding="utf-8"
        )
    except OSError as error:
        raise SessionError(f"{path}: the log cannot be written: {error.strerror}; check the folder") from error
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
    level = log.level
    log.setLevel(logging.INFO)
    log.addHandler(handler)
    try:
        yield
    finally:
        log.removeHandler(handler)
        log.setLevel(level)
        handler.close()
