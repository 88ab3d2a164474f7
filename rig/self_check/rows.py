"""What a measurement of `rig check` hands back: rows with a verdict, profile values, raw numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True)
class Row:
    """A number against its limit."""

    what: str
    value: float | None
    """None: it could not be measured, and the advice says why."""
    unit: str = ""
    limit: float | None = None
    """None: a number to know, without verdict."""
    at_least: bool = False
    advice: str = ""
    """What to do when it fails."""

    @property
    def passed(self) -> bool:
        """Within its limit, or without one."""
        if self.value is None or self.limit is None:
            return True
        return self.value >= self.limit if self.at_least else self.value <= self.limit

    @property
    def verdict(self) -> str:
        """ok, OUTSIDE, info (no limit) or not measured."""
        if self.value is None:
            return "not measured"
        if self.limit is None:
            return "info"
        return "ok" if self.passed else "OUTSIDE"

    def as_dict(self, part: str) -> dict[str, Any]:
        """For JSON."""
        return {
            "part": part,
            "what": self.what,
            "value": self.value,
            "unit": self.unit,
            "limit": self.limit,
            "at_least": self.at_least,
            "passed": self.passed,
            "verdict": self.verdict,
            "advice": self.advice,
        }


@dataclass(frozen=True, slots=True)
class Measured:
    """One part of the check."""

    rows: tuple[Row, ...]
    suggested: Mapping[str, Any] = field(default_factory=dict)
    """Values for the profile, by ``table.key``."""
    numbers: Mapping[str, Any] = field(default_factory=dict)
    """Everything that was measured, ready for JSON."""
