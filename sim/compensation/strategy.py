"""What a compensation strategy is to those who choose one: a function with a name, a description and a version."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sim.compensation.result import Compensation, prepare
from sim.compensation.split_transport import Transport
from sim.errors import SimulationError

Solve = Callable[..., Compensation]
"""``solve(transport, target, lower, upper, **options)``; arguments as of :func:`sim.compensate`."""


@dataclass(frozen=True, kw_only=True)
class Strategy:
    """A way to find the projector image for a wanted camera image.

    Raises
    ------
    SimulationError
        For a name that is empty or has other signs than letters, digits, ``_`` and ``-``, or an empty version.
    """

    name: str
    """What commands, files and pages call it."""
    solve: Solve
    """``solve(transport, target, lower, upper, **options)`` returns a :class:`sim.Compensation`."""
    summary: str
    """One line: what it projects."""
    publication: str = ""
    """Author and year of where it comes from; empty for one that was not published."""
    version: str = "1"
    """Rises with every change of its numbers, so that results from before are computed again."""

    def __post_init__(self) -> None:
        if not self.name.replace("_", "").replace("-", "").isalnum():
            raise SimulationError(f"strategy name {self.name!r}; give letters, digits, '_' and '-'")
        if not self.version:
            raise SimulationError(f"strategy {self.name}: no version; give one that rises with every change of numbers")

    def compensate(
        self, transport: Transport, target: ArrayLike, *, lower: float = 0.0, upper: float = 1.0, **options: Any
    ) -> Compensation:
        """Return what the strategy finds, what it was asked and what it answers both checked: the door of all.

        Parameters
        ----------
        transport, target, lower, upper, **options
            As of :func:`sim.compensate`.

        Returns
        -------
        Compensation

        Raises
        ------
        SimulationError
            For a target or transport that does not fit or is not finite, or an answer that is not finite.
        """
        prepare(transport, target, lower, upper)
        found = self.solve(transport, target, lower, upper, **options)
        bad = int(np.count_nonzero(~np.isfinite(found.projector_image)))
        if bad:
            raise SimulationError(
                f"strategy {self.name}: {bad} of {found.projector_image.size} values of its picture are NaN or "
                "infinite; use another strategy, or other options"
            )
        return found
