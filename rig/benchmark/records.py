"""What a bench gives: measured points, and the criteria that they are held against."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Literal

from rig.records import JsonObject, Record, Verdict, json_of

Size = Literal["quick", "default", "full"]
"""Seconds, for tests; about a minute; as long as it takes."""
Kind = Literal["accuracy", "time", "memory"]
Detail = Mapping[str, Any]
"""Further numbers of a point, by name."""


@dataclass(frozen=True, kw_only=True)
class Point(Record):
    """One problem, one method, one setting."""

    problem: str
    method: str
    n: int
    """Patches; of codes, pictures."""
    seconds: float | None = None
    """Median; None where it was not timed."""
    error: float | None = None
    """What it is the error of stands in ``error_of``; None where nothing is known to compare with."""
    peak_mb: float | None = None
    error_of: str = ""
    detail: Detail = field(default_factory=dict)
    """Further numbers: threads, samples, tolerance, matvecs, closure ..."""

    def as_json(self) -> JsonObject:
        """The point as one flat object, its further numbers beside its own."""
        own = {item.name: json_of(getattr(self, item.name)) for item in fields(self) if item.name != "detail"}
        return own | {name: json_of(value) for name, value in self.detail.items()}


@dataclass(frozen=True, kw_only=True)
class Criterion(Verdict):
    """A promise of a benchmark: a number against its limit."""

    kind: Kind = "accuracy"

    def as_json(self) -> JsonObject:
        """The verdict and its kind."""
        return super().as_json() | {"kind": self.kind}


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """All that one bench has found."""

    points: tuple[Point, ...]
    criteria: tuple[Criterion, ...]
    notes: tuple[str, ...] = ()

    @property
    def accurate(self) -> bool:
        """Whether all accuracy criteria are met; seconds and memory of a busy machine decide nothing."""
        return all(criterion.met for criterion in self.criteria if criterion.kind == "accuracy")


@dataclass(frozen=True, kw_only=True)
class BenchmarkMachine(Record):
    """What the seconds were measured on."""

    processor: str
    processors: int
    threads: int
    system: str
    python: str
    numpy: str


@dataclass(frozen=True, kw_only=True)
class BenchResult(Record):
    """A bench with its verdict and its circumstances: ``rig bench NAME --json``."""

    bench: str
    size: Size
    points: tuple[Point, ...]
    criteria: tuple[Criterion, ...]
    notes: tuple[str, ...]
    peers: Mapping[str, str | None]
    """Version of each peer; None: it is not installed."""
    machine: BenchmarkMachine
    within_limits: bool
    """Whether the accuracy criteria are met: the clock of a busy machine decides nothing."""
    elapsed_s: float

    @property
    def absent(self) -> tuple[str, ...]:
        """Peers that are not installed."""
        return tuple(peer for peer, version in self.peers.items() if version is None)

    def as_json(self) -> JsonObject:
        """The fields, and which peers are absent."""
        return super().as_json() | {"absent": list(self.absent)}


def joined(parts: Sequence[Outcome]) -> Outcome:
    """All points, criteria and notes of the parts, in order."""
    return Outcome(
        points=tuple(point for part in parts for point in part.points),
        criteria=tuple(criterion for part in parts for criterion in part.criteria),
        notes=tuple(note for part in parts for note in part.notes),
    )
