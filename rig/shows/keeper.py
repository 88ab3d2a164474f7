"""What keeps a show: on at its times, started again when something ends it, later and later, until somebody does."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime
from typing import Protocol

from rig.devices.protocols import Clock
from rig.errors import RigError
from rig.live.results import status_of_signal
from rig.records import Record
from rig.shows.timetable import Timetable

FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.5, 8.0
"""After a failure, before the next start: twice as long each time, so that a show is back in ten seconds."""
_HEALTHY_S = 30.0
"""A run that lasts longer has overcome what ended the one before."""
_LOOK_S = 1.0
"""Between two looks at the time of day, and whether somebody ends the show."""
_BY_SOMEBODY = ("quit", "signal")
_KEPT_FAILURES = 100
"""A show of months must not fill the memory with what went wrong."""
_PLAIN = 2
"""Exit status of what only a person can put right: a wrong file or option."""

log = logging.getLogger("rig.shows")


class Lamp(Protocol):
    """The projector's lamp, and how long it has been lit."""

    def lit(self, seconds: float) -> None:
        """Count so many seconds of light."""
        ...

    def off(self) -> None:
        """Switch it off, if the show wants that."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class KeeperState(Record):
    """What a kept show does now, for who follows it."""

    phase: str
    """showing, waiting (to begin again), or off (by its timetable)."""
    runs: int
    failures: int
    last_failure: str
    """Empty before the first."""


@dataclass(frozen=True, slots=True, kw_only=True)
class KeptShow(Record):
    """How a show went, from its start to its end."""

    runs: int
    """Times that it began to show."""
    failures: int
    seconds_shown: float
    ended_by: str
    """quit, signal, or what only a person can put right."""
    last_failures: tuple[str, ...]
    signal: str | None = None
    """Name of the one that ended it, such as SIGTERM."""

    @property
    def exit_status(self) -> int:
        """What the command line ends with: 128 + the signal that ended it, else 0."""
        return 0 if self.signal is None else status_of_signal(self.signal)


@dataclass(slots=True, kw_only=True)
class ShowKeeper:
    """Plays a show again and again; everything that it needs of the world is handed in.

    Parameters
    ----------
    play
        Show for so many seconds (None: without end); returns how it ended, as `rig live` says, and leaves the
        projector black, also where it raises RigError.
    timetable
        When the show is on.
    clock
        To wait by.
    time_of_day
        Local time now.
    is_ended
        Whether somebody has ended the show while it was off.
    lamp
        Counted, and switched off.
    on_state
        Told whenever the show begins, waits to begin again, or goes off.
    """

    play: Callable[[float | None], str]
    timetable: Timetable
    clock: Clock
    time_of_day: Callable[[], datetime]
    is_ended: Callable[[], bool]
    lamp: Lamp
    on_state: Callable[[KeeperState], None] = lambda _: None
    _runs: int = 0
    _failures: int = 0
    _shown_s: float = 0.0
    _pause_s: float = FIRST_PAUSE_S
    _last: list[str] = field(default_factory=list)

    def keep(self) -> KeptShow:
        """Play until somebody ends it.

        Returns
        -------
        KeptShow

        Raises
        ------
        RigError
            The first run could not begin for a reason that only a person can put right.
        """
        ended_by = ""
        while not ended_by:
            now = self.time_of_day()
            if self.timetable.is_on(now):
                ended_by = self._run(self.timetable.seconds_left(now))
            else:
                ended_by = self._rest(now)
        log.info("ended by %s after %d runs, %d failures", ended_by, self._runs, self._failures)
        return KeptShow(
            runs=self._runs,
            failures=self._failures,
            seconds_shown=self._shown_s,
            ended_by=ended_by,
            last_failures=tuple(self._last),
        )

    def _run(self, seconds: float | None) -> str:
        """Play once; returns why the show is over, empty where it is not."""
        begun_s, how = self.clock.now_s(), ""
        self._runs += 1
        log.info("run %d begins", self._runs)
        self._tell("showing")
        try:
            how = self.play(seconds)
        except RigError as error:
            if self._runs == 1 and error.exit_code == _PLAIN:
                raise
            self._fail(f"{type(error).__name__}: {error}")
        finally:
            lasted_s = self.clock.now_s() - begun_s
            self._shown_s += lasted_s
        self.lamp.lit(lasted_s)
        if how in _BY_SOMEBODY:
            return how
        if how == "source":
            self._fail("all sources ended")
        if how == "time":
            log.info("off by its timetable")
        elif not self._back_off(lasted_s):
            return "signal"
        return ""

    def _fail(self, text: str) -> None:
        self._failures += 1
        self._last = [*self._last, text][-_KEPT_FAILURES:]
        log.warning("%s", text)

    def _tell(self, phase: str) -> None:
        last = self._last[-1] if self._last else ""
        self.on_state(KeeperState(phase=phase, runs=self._runs, failures=self._failures, last_failure=last))

    def _back_off(self, lasted_s: float) -> bool:
        """Wait before the next start; False when somebody ends the show meanwhile."""
        if lasted_s > _HEALTHY_S:
            self._pause_s = FIRST_PAUSE_S
        log.info("starts again in %.1f s", self._pause_s)
        self._tell("waiting")
        goes_on = self._wait(self._pause_s)
        self._pause_s = min(2 * self._pause_s, LONGEST_PAUSE_S)
        return goes_on

    def _rest(self, now: datetime) -> str:
        """Stay off until the show is on again."""
        self._tell("off")
        self.lamp.off()
        left_s = self.timetable.seconds_left(now)
        return "" if self._wait(left_s or _LOOK_S) else "signal"

    def _wait(self, seconds: float) -> bool:
        """Wait; False as soon as somebody ends the show."""
        until_s = self.clock.now_s() + seconds
        while (now_s := self.clock.now_s()) < until_s:
            if self.is_ended():
                return False
            self.clock.wait_until_s(min(now_s + _LOOK_S, until_s))
        return not self.is_ended()
