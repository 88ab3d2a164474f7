"""Sessions as the page lists and shows them: how far they are, what they found, what went wrong on the way."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

from rig.errors import RigError, SessionError
from rig.records import Json, JsonObject, Record, Verdict
from rig.report.links import PAGES
from rig.run.plan import PlannedStep, plan_session
from rig.run.request import SessionRequest
from rig.session import Session
from rig.stages.photograph import FrameNote, frame_notes
from rig.stages.results import SessionResult
from rig.terminal.line import counted, in_words

_MOST_NOTES = 200


@dataclass(frozen=True, kw_only=True)
class ListedSession(Record):
    """A session in a list."""

    name: str
    profile: str
    created: str
    """ISO 8601; empty when it cannot be read."""
    frames: int
    verdict: str
    """ok, outside, unfinished or damaged."""
    says: str
    """The verdict in words."""
    measured_mean: float | None = None
    """Mean error of the best strategy. [grey levels]"""
    uncompensated_mean: float | None = None
    strategy: str = ""
    geometry_rms_px: float | None = None
    pages: tuple[str, ...] = ()
    """Of the files of :data:`rig.report.links.PAGES`, those that are there."""


@dataclass(frozen=True, kw_only=True)
class SessionDetail(Record):
    """A session, looked at closely."""

    listed: ListedSession
    steps: tuple[PlannedStep, ...]
    seconds_left: float
    left_in_words: str
    notes: tuple[FrameNote, ...]
    """What went wrong with photographs, and was put right; the last ones."""
    limits: tuple[Verdict, ...] = ()
    strategies: tuple[str, ...] = ()
    """Names of those that were photographed."""


def listed(folder: Path) -> ListedSession:
    """Return a session's row of the list; one that cannot be read says why."""
    return _listed(folder, _changed(folder))


def _changed(folder: Path) -> tuple[int, ...]:
    """What tells that a session is not as it was."""
    files = [folder / name for name in ("journal.jsonl", "metrics.json", "session.json", *PAGES)]
    return tuple(file.stat().st_mtime_ns if file.is_file() else 0 for file in files)


@lru_cache(maxsize=512)
def _listed(folder: Path, _changed: tuple[int, ...]) -> ListedSession:
    pages = tuple(name for name in PAGES if (folder / name).is_file())
    try:
        session = Session.read(folder)
    except RigError as error:
        return ListedSession(
            name=folder.name, profile="", created="", frames=0, verdict="damaged", says=str(error), pages=pages
        )
    frames = sum(event["event"] == "frame" for event in session.events())
    bare = ListedSession(
        name=folder.name,
        profile=session.profile.name,
        created=next((str(event["time"]) for event in session.events()), ""),
        frames=frames,
        verdict="unfinished",
        says=f"{counted(frames, 'frame')}; not compared yet",
        pages=pages,
    )
    result = _result(session)
    return bare if result is None else _with_result(bare, result)


def _with_result(bare: ListedSession, result: SessionResult) -> ListedSession:
    failed = [row.what for row in result.limits if not row.met]
    return replace(
        bare,
        verdict="ok" if result.within_limits else "outside",
        says="within limits" if result.within_limits else f"outside: {', '.join(failed)}",
        measured_mean=result.measured.compensated.mean,
        uncompensated_mean=result.measured.uncompensated.mean,
        strategy=result.compensation.strategy,
        geometry_rms_px=result.geometry.rms_px,
    )


def _result(session: Session) -> SessionResult | None:
    try:
        return session.read_metrics(SessionResult)
    except SessionError:
        return None


def detail(folder: Path) -> SessionDetail:
    """Return what the page of a session shows. Raises RigError when it cannot be read."""
    session = Session.read(folder)
    plan = plan_session(SessionRequest(folder=folder))
    result = _result(session)
    return SessionDetail(
        listed=listed(folder),
        steps=plan.steps,
        seconds_left=plan.seconds_left,
        left_in_words=in_words(plan.seconds_left),
        notes=tuple(frame_notes(session)[-_MOST_NOTES:]),
        limits=() if result is None else result.limits,
        strategies=() if result is None else tuple(result.strategies),
    )


@dataclass(frozen=True, kw_only=True)
class ComparedFigure(Record):
    """A number of two sessions."""

    name: str
    first: float | None = None
    second: float | None = None


@dataclass(frozen=True, kw_only=True)
class TwoSessions(Record):
    """Two sessions, number by number."""

    first: str
    second: str
    figures: tuple[ComparedFigure, ...]


def compared(first: Path, second: Path) -> TwoSessions:
    """Hold the numbers of two sessions side by side. Raises SessionError when one was not compared yet."""
    numbers = [dict(_numbers(Session.read(folder).read_metrics(SessionResult).as_json())) for folder in (first, second)]
    names = list(dict.fromkeys([*numbers[0], *numbers[1]]))
    figures = tuple(
        ComparedFigure(name=name, first=numbers[0].get(name), second=numbers[1].get(name)) for name in names
    )
    return TwoSessions(first=first.name, second=second.name, figures=figures)


_NOT_COMPARED = ("limits", "expected", "report", "elapsed_s")


def _numbers(value: Json, name: str = "") -> Iterator[tuple[str, float]]:
    """Numbers of a JSON value, by their way in it: ``geometry.rms_px``."""
    if isinstance(value, bool):
        return
    if isinstance(value, int | float):
        yield name, float(value)
    elif isinstance(value, Mapping):
        for key, item in value.items():
            if name or key not in _NOT_COMPARED:
                yield from _numbers(item, f"{name}.{key}" if name else key)
    elif isinstance(value, list):
        for k, item in enumerate(value):
            yield from _numbers(item, f"{name}.{k}")


def last_frame(folder: Path) -> JsonObject | None:
    """Return the journal's entry of the frame that was photographed last; None before the first."""
    frames = [event for event in Session.read(folder).events() if event["event"] == "frame"]
    return frames[-1] if frames else None
