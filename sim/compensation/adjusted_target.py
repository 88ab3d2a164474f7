"""Another picture to aim at, when the target cannot be shown."""

from __future__ import annotations

from dataclasses import dataclass, field

from sim.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class AdjustedTarget:
    """A picture near the target that fits the projector's range better."""

    values: FloatArray
    """(n, C) camera image to aim at."""
    wanted: FloatArray
    """(n, C) projector image that would give it."""
    iterations: int
    notes: dict[str, float | str] = field(default_factory=dict)
