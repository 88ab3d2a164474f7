"""What a search finds, as frozen records."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rig.records import Record


@dataclass(frozen=True, kw_only=True)
class Design(Record):
    """Values of the free parameters, and what they give."""

    values: Mapping[str, float | str]
    """By key."""
    measures: Mapping[str, float]
    """By goal; empty for a place that cannot be."""
    score: float
    """What the search makes small: the goals by their weights, each over its spread."""
    allowed: bool
    """Keeps all limits, stands in the room's air and out of all keep-out boxes."""


@dataclass(frozen=True, kw_only=True)
class Sensitivity(Record):
    """What happens to the best design when one parameter changes."""

    key: str
    changed_to: tuple[float | str, ...]
    """A twentieth of its range down and up, or the other choices."""
    measures: tuple[Mapping[str, float], ...]
    """Of each change; empty for one that cannot be."""
    share: float
    """Of the worst change of the score among all parameters; 1 = the one that matters most."""


@dataclass(frozen=True, kw_only=True)
class SearchResult(Record):
    """Best designs of a room."""

    goals: tuple[str, ...]
    evaluations: int
    """Designs that were computed."""
    given: Design
    """As the room file has it."""
    best: Design
    front: tuple[Design, ...]
    """Designs that no other one beats in all goals."""
    sensitivity: tuple[Sensitivity, ...]
    words: tuple[str, ...]
    """Why this one."""
    tried: tuple[Design, ...]
    """All of them, in the order in which they were computed."""
