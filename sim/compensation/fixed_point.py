"""Steps of a projector image that stay within the range, repeated until they settle."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sim.compensation.result import Problem
from sim.geometry.scene import FloatArray


def repeated(
    task: Problem, correction: Callable[[FloatArray], FloatArray], damping: float, steps: int, tolerance: float
) -> tuple[FloatArray, int]:
    """Repeat p <- clamp(p + damping x correction(p)) from the clamped direct image on.

    Returns
    -------
    (array, int)
        The last image before it was clamped, and the steps: until no value changes by more than the tolerance, a
        share of the largest.
    """
    wanted, taken, settled = task.view.by_direct(task.target), 0, False
    p = task.clamped(wanted)
    while taken < steps and not settled:
        wanted = p + damping * correction(p)
        before, p, taken = p, task.clamped(wanted), taken + 1
        settled = bool(np.abs(p - before).max(initial=0.0) <= tolerance * np.abs(p).max(initial=0.0))
    return wanted, taken
