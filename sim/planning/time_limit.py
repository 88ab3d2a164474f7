"""As exact as a time allows: plans for ever smaller tolerances, as long as the next one still fits."""

from __future__ import annotations

import time
from collections.abc import Callable

from sim.errors import SimulationError
from sim.planning.plan import Plan

COARSEST_PERCENT, FINEST_PERCENT = 16.0, 0.01
"""Tolerances that are tried, from one to the other. [% of white]"""
STEP = 2**0.5
"""From one tolerance to the next."""
GROWTH = 3.3
"""Times as long a plan for the next tolerance takes at most, and its solution: patches grow as the tolerance's -2nd
power, rays as its -1.4th."""


def plan_within(make_plan: Callable[[float], Plan], seconds: float, *, beside: Callable[[], str] = str) -> Plan:
    """Return the plan of the smallest tolerance whose planning and solution fit into a time.

    Parameters
    ----------
    make_plan : callable
        From a tolerance [% of white] to a plan.
    seconds : float
        For all plans and the solution together. [s]
    beside : callable
        Returns what else the last plan's seconds are of, for the message of a refusal; nothing by itself.

    Returns
    -------
    Plan

    Raises
    ------
    SimulationError
        For a time not above 0, or one in which not even 16 % can be had.
    """
    if not seconds > 0:
        raise SimulationError(f"a limit of {seconds:g} s; it must be above 0")
    started, tolerance, best = time.perf_counter(), COARSEST_PERCENT, None
    while tolerance >= FINEST_PERCENT:
        before_s = time.perf_counter() - started
        made = make_plan(tolerance)
        after_s = time.perf_counter() - started
        if after_s + made.seconds > seconds:
            break
        best, tolerance = made, tolerance / STEP
        if after_s + GROWTH * (after_s - before_s + made.seconds) > seconds:
            break
    if best is None:
        needed = f"{after_s + made.seconds:.2g} s{beside() or ','}"
        raise SimulationError(
            f"{tolerance:g} % takes about {needed} the limit is {seconds:g} s; give more time, or a coarser surface"
        )
    return best
