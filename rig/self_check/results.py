"""What a self-check hands back: verdicts, values for the profile and everything that was measured, part by part."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import PurePath
from typing import Generic, TypeVar

from rig.records import JsonObject, Record, Verdict, all_met, json_of

Numbers = TypeVar("Numbers", bound=Record, covariant=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class PartResult(Record, Generic[Numbers]):
    """One part of the check."""

    verdicts: tuple[Verdict, ...]
    numbers: Numbers | None = None
    """Everything that was measured; None where the part could not be measured."""
    suggested: Mapping[str, float] = field(default_factory=dict)
    """Values for the profile, by ``table.key``."""


@dataclass(frozen=True, kw_only=True)
class SelfCheck(Record):
    """A whole check of a rig."""

    profile: str
    """Name of the profile."""
    exposure_s: float
    """The working exposure."""
    device_s: float
    """The rig's time that the check took."""
    parts: Mapping[str, PartResult[Record]]
    """By name, in the order in which they were measured."""
    frames_rejected: int
    latency_s: Mapping[str, float] | None = None
    """Mean, min, median, max and sd of the display's latency, if it was measured."""
    report: str | None = None
    """HTML file that was written."""

    @property
    def rows(self) -> tuple[tuple[str, Verdict], ...]:
        """Each verdict with the name of its part."""
        return tuple((name, verdict) for name, part in self.parts.items() for verdict in part.verdicts)

    @property
    def broken(self) -> tuple[Verdict, ...]:
        """Verdicts whose limit is not kept."""
        return tuple(verdict for _, verdict in self.rows if not verdict.met)

    @property
    def suggested(self) -> dict[str, float]:
        """Values for the profile, by ``table.key``; a later part's overrule an earlier one's."""
        return {key: value for part in self.parts.values() for key, value in part.suggested.items()}

    @property
    def within_limits(self) -> bool:
        """Whether all limits are kept."""
        return all_met(tuple(verdict for _, verdict in self.rows))

    def with_report(self, path: PurePath) -> SelfCheck:
        """Return the check with the page that was written of it."""
        return replace(self, report=str(path))

    def as_json(self) -> JsonObject:
        """All that was measured; `checks` are the verdicts, each with its part."""
        numbers = {name: part.numbers.as_json() if part.numbers else {} for name, part in self.parts.items()}
        result: JsonObject = {
            "profile": self.profile,
            "exposure_s": self.exposure_s,
            "device_s": self.device_s,
            "checks": [{"part": name, **verdict.as_json()} for name, verdict in self.rows],
            "suggested": json_of(self.suggested),
            "stale_frames_rejected": self.frames_rejected,
            "numbers": json_of(numbers),
            "within_limits": self.within_limits,
        }
        optional = {"latency_s": json_of(self.latency_s), "report": self.report}
        return result | {key: value for key, value in optional.items() if value is not None}
