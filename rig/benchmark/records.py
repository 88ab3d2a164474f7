"""What a bench gives: measured points, and the criteria that they are held against."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import Any, Literal

Size = Literal["quick", "default", "full"]
"""Seconds, for tests; about a minute; as long as it takes."""
OnStep = Callable[[str, int, int], None]
Kind = Literal["accuracy", "time", "memory"]


@dataclass(frozen=True)
class Point:
    """One problem, one method, one setting."""

    problem: str
    method: str
    n: int
    """Patches."""
    seconds: float | None = None
    """Median; none where it was not timed."""
    error: float | None = None
    """What it is the error of stands in ``error_of``; none where nothing is known to compare with."""
    peak_mb: float | None = None
    error_of: str = ""
    detail: Mapping[str, Any] = field(default_factory=dict)
    """Further numbers: threads, samples, tolerance, matvecs, closure ..."""

    def as_json(self) -> dict[str, Any]:
        """One flat object."""
        own = {item.name: getattr(self, item.name) for item in fields(self) if item.name != "detail"}
        return {**own, **self.detail}


@dataclass(frozen=True)
class Criterion:
    """A promise: a number against its limit."""

    what: str
    value: float
    limit: float
    unit: str = ""
    kind: Kind = "accuracy"
    at_least: bool = False
    """True if the value must not be below the limit instead of above."""

    @property
    def met(self) -> bool:
        """Whether the limit is kept; never for a value that is not a number."""
        return self.value >= self.limit if self.at_least else self.value <= self.limit

    def as_json(self) -> dict[str, Any]:
        """One object, with the verdict."""
        return {**asdict(self), "met": self.met}


@dataclass(frozen=True)
class Outcome:
    """All that one bench has found."""

    points: tuple[Point, ...]
    criteria: tuple[Criterion, ...]
    notes: tuple[str, ...] = ()

    @property
    def accurate(self) -> bool:
        """Whether all accuracy criteria are met; seconds and memory of a busy machine decide nothing."""
        return all(criterion.met for criterion in self.criteria if criterion.kind == "accuracy")


def joined(parts: Sequence[Outcome]) -> Outcome:
    """All points, criteria and notes of the parts, in order."""
    return Outcome(
        tuple(point for part in parts for point in part.points),
        tuple(criterion for part in parts for criterion in part.criteria),
        tuple(note for part in parts for note in part.notes),
    )
