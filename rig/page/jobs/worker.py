"""A job's process: reads what is to be done, does it by the functions of the command line, tells how far it is."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from rig.errors import RigError
from rig.page.jobs.requests import AnyJob, CheckJob, KeepJob, LookJob, RecheckJob, RunJob, ShowJob, StrategiesJob
from rig.page.jobs.spare import KIND as SPARE
from rig.page.jobs.spare_work import prepared_beside
from rig.page.jobs.wire import Wire, interrupt_this_process
from rig.records import JsonObject, read_record

if TYPE_CHECKING:
    from rig.shows.prepared import PreparedShow

_PROGRESS_S = 0.1
"""Between two messages about the same step: nobody reads faster."""
INTERRUPTED = 130


class _ToldProgress:
    """Tells how far a job is, no more often than anybody reads it."""

    def __init__(self, wire: Wire):
        self._wire = wire
        self._last_s, self._label = 0.0, ""

    def __call__(self, label: str, done: int, total: int) -> None:
        now_s = time.monotonic()
        if label == self._label and done < total and now_s - self._last_s < _PROGRESS_S:
            return
        self._last_s, self._label = now_s, label
        self._wire.tell("progress", {"label": label, "done": done, "total": total})


def _run(job: RunJob, wire: Wire) -> JsonObject:
    from rig.run.request import SessionRequest
    from rig.run.session import run_session

    wire.on_stop = interrupt_this_process
    request = SessionRequest(
        folder=job.session,
        profile=job.profile,
        target=job.target,
        fit=job.fit,
        linear=job.linear,
        strategies=job.strategies,
    )
    return run_session(request, _ToldProgress(wire)).as_json()


def _strategies(job: StrategiesJob, wire: Wire) -> JsonObject:
    from rig.run.request import SessionRequest
    from rig.strategies.comparison import Comparison, compare_strategies

    wire.on_stop = interrupt_this_process
    wanted = Comparison(
        request=SessionRequest(folder=job.session, strategies=job.strategies),
        loops=job.loops,
        captures=job.captures,
        test_pictures=job.test_pictures,
    )
    return compare_strategies(wanted, _ToldProgress(wire)).as_json()


def _check(job: CheckJob, wire: Wire) -> JsonObject:
    from rig.self_check import run_check

    wire.on_stop = interrupt_this_process
    return run_check(job.profile, _ToldProgress(wire), job.only).as_json()


def _look(job: LookJob, wire: Wire) -> JsonObject:
    from rig.page.jobs.look import look_on

    return look_on(job, wire)


def _show(job: ShowJob, wire: Wire) -> JsonObject:
    from rig.page.jobs.show import show_on

    return show_on(job, wire, _ToldProgress(wire))


def _keep(job: KeepJob, wire: Wire, prepared: PreparedShow | None = None) -> JsonObject:
    from rig.page.jobs.show import keep_on

    wire.on_stop = interrupt_this_process
    return keep_on(job, wire, _ToldProgress(wire), prepared)


def _recheck(job: RecheckJob, wire: Wire) -> JsonObject:
    from rig.recheck.records import RecheckRequest
    from rig.recheck.run import run_recheck

    wire.on_stop = interrupt_this_process
    request = RecheckRequest(folder=Path(job.session), profile=job.profile, realign=job.realign)
    return run_recheck(request, _ToldProgress(wire)).as_json()


def _devices() -> JsonObject:
    from rig.inventory.list import list_devices

    return list_devices().as_json()


def _new_profile(asked: JsonObject) -> JsonObject:
    from rig.inventory.new_profile import ProfileRequest, write_profile

    wanted = {key: str(value) for key, value in asked.items() if key in ("camera", "output", "name")}
    request = ProfileRequest(
        path=Path(str(asked["path"])),
        camera=wanted.get("camera"),
        output=wanted.get("output"),
        name=wanted.get("name"),
    )
    return write_profile(request).as_json()


def _done(kind: str, asked: JsonObject, wire: Wire, prepared: PreparedShow | None) -> JsonObject:
    """Do a job of a kind, and return its result."""
    if kind == "keep":
        return _keep(read_record(KeepJob, asked), wire, prepared)
    if kind == "devices":
        return _devices()
    if kind == "profile":
        return _new_profile(asked)
    work: Mapping[str, tuple[type[AnyJob], Callable[..., JsonObject]]] = {
        "run": (RunJob, _run),
        "strategies": (StrategiesJob, _strategies),
        "check": (CheckJob, _check),
        "look": (LookJob, _look),
        "show": (ShowJob, _show),
        "recheck": (RecheckJob, _recheck),
    }
    record, function = work[kind]
    return function(read_record(record, asked), wire)


def work(wire: Wire) -> int:
    """Do what the first order says, and return the status with which `rig` would end."""
    try:
        kind, asked = _order(wire)
        prepared = None
        if kind == SPARE:
            prepared = prepared_beside(str(asked["show"]))
            wire.tell("ready", {})
            kind, asked = _order(wire)
    except EOFError:  # the server ended, or needs no spare any more
        return 0
    wire.listen()
    return _ended_with(kind, asked, wire, prepared)


def _order(wire: Wire) -> tuple[str, JsonObject]:
    """What the job is. Raises EOFError when nobody will say."""
    first = wire.first()
    if first is None:
        raise EOFError
    kind, asked = first["kind"], first["job"]
    if not isinstance(kind, str) or not isinstance(asked, dict):
        raise ValueError("an order is a kind and a job")
    return kind, asked


def _ended_with(kind: str, asked: JsonObject, wire: Wire, prepared: PreparedShow | None) -> int:
    """Do a job, tell how it ended, and return the status for that."""
    try:
        result = _done(kind, asked, wire, prepared)
    except RigError as error:
        notes = [str(note) for note in getattr(error, "__notes__", ())]
        wire.tell("failed", {"error": str(error), "kind": type(error).__name__, "notes": list(notes)})
        return error.exit_code
    except KeyboardInterrupt:
        wire.tell("stopped", {})
        return INTERRUPTED
    except (OSError, MemoryError) as error:
        wire.tell("failed", {"error": f"{error}; check disk and memory, then start again", "kind": "System"})
        return 4
    wire.tell("result", {"result": result})
    return 0


if __name__ == "__main__":
    sys.exit(work(Wire.of_this_process()))
