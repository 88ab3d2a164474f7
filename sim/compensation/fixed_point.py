"""Steps of a projector image that stay within the range, repeated until they settle."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sim.arrays import FloatArray
from sim.compensation.result import Problem


def iterate_clamped(
    problem: Problem, correction: Callable[[FloatArray], FloatArray], *, damping: float, steps: int, tolerance: float
) -> tuple[FloatArray, int]:
    """Repeat p <- clamp(p + damping x correction(p)) from the clamped direct image on.

    Parameters
    ----------
    problem : Problem
    correction : callable
        From an image (n, C) within the range to its correction (n, C).
    damping : float
        Factor of every correction.
    steps : int
        Most steps.
    tolerance : float
        Ends when no value changes by more than this share of the largest.

    Returns
    -------
    wanted : (n, C) array
        The last image before it was clamped.
    steps : int
        How many were taken.
    """
    wanted, taken, settled = problem.transport.divide_by_direct(problem.target), 0, False
    p = problem.clamped(wanted)
    while taken < steps and not settled:
        wanted = p + damping * correction(p)
        before, p, taken = p, problem.clamped(wanted), taken + 1
        settled = bool(np.abs(p - before).max(initial=0.0) <= tolerance * np.abs(p).max(initial=0.0))
    return wanted, taken
