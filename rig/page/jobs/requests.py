"""What may be asked of the rig: a record for each kind of job, as HTTP brings it, with names in place of paths."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rig.records import Record
from rig.run.request import DEFAULT_STRATEGIES


@dataclass(frozen=True, kw_only=True)
class RunJob(Record):
    """A whole session: what is missing of it, up to its report."""

    session: str
    profile: str | None = None
    """Needed for a new session."""
    target: str | None = None
    """Name of a picture that was uploaded, or default; None: the session's last one."""
    fit: bool = False
    linear: bool = False
    strategies: tuple[str, ...] = DEFAULT_STRATEGIES


@dataclass(frozen=True, kw_only=True)
class StrategiesJob(Record):
    """All strategies side by side, photographed."""

    session: str
    strategies: tuple[str, ...] = ("all",)
    loops: tuple[str, ...] = ("bounded",)
    captures: int = 4
    test_pictures: bool = True


@dataclass(frozen=True, kw_only=True)
class LookJob(Record):
    """The camera's view, live, while the projector shows a picture."""

    profile: str
    picture: str = "grid"
    """Of `rig show`, or the name of a picture that was uploaded."""
    exposure_s: float | None = None
    """None: the profile's."""


@dataclass(frozen=True, kw_only=True)
class CheckJob(Record):
    """The rig's self-check."""

    profile: str
    only: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class ShowJob(Record):
    """A live show."""

    session: str | None = None
    profile: str | None = None
    sources: tuple[str, ...] = ("pattern",)
    """Names of what was uploaded, pattern, camera:ID or shm:NAME."""
    strategy: str = "bounded"
    gain: float = 1.0
    auto_gain: bool = False
    endless: bool = True
    keeps_going: bool = True
    rate_hz: float | None = None
    seconds: float | None = None
    linear: bool = False
    threads: int = 2


@dataclass(frozen=True, kw_only=True)
class KeepJob(Record):
    """A saved show, kept until somebody ends it."""

    show: str


@dataclass(frozen=True, kw_only=True)
class RecheckJob(Record):
    """Whether anything moved or drifted since a session was made."""

    session: str
    profile: str | None = None
    """None: the session's; else one that differs in where simulated devices stand."""
    realign: bool = False
    """Measure anew what depends on where the devices stand."""


AnyJob = RunJob | StrategiesJob | LookJob | CheckJob | ShowJob | KeepJob | RecheckJob

JOBS: Mapping[str, type[AnyJob]] = {
    "run": RunJob,
    "strategies": StrategiesJob,
    "look": LookJob,
    "check": CheckJob,
    "show": ShowJob,
    "keep": KeepJob,
    "recheck": RecheckJob,
}
"""By the last part of the address to which they are posted: ``/api/jobs/run``."""
