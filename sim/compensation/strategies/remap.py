"""The largest contrast that stays in range: one gain and one offset (Dehos et al. 2014, section 5.2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linprog

from sim.arrays import FloatArray
from sim.compensation.adjusted_target import AdjustedTarget
from sim.compensation.inverse import Inverse
from sim.compensation.result import Compensation, Problem, prepare
from sim.compensation.split_transport import Transport
from sim.errors import SimulationError

ROUNDS = 60
"""Most rounds of adding the limits that are exceeded."""
SLACK_PRICE = 1e4
"""What leaving the range costs against gain: it happens only where no gain stays inside."""
OFFSET_PRICE = 1e-6
"""Of equal gains, the smaller offset."""


def remap(transport: Transport, target: ArrayLike, lower: float = 0.0, upper: float = 1.0) -> Compensation:
    """Project T⁻¹ (s c + o) with the largest s <= 1 for which that stays in range.

    A linear program in two unknowns, solved on the few pixels that limit it. The offset is the same in every band.

    Limits: the picture is whole, but its contrast and brightness are those of its most difficult pixel. In a measured
    room one pixel in a corner that would have to swallow light at any gain leaves a gain of 0.

    Parameters
    ----------
    transport, target, lower, upper
        As in :func:`sim.compensate`.

    Returns
    -------
    Compensation
        Its notes hold ``gain``, ``offset`` in the target's unit, and ``out_of_range`` where no gain stays in range.

    References
    ----------
    Dehos, Zéghers, Sarry, Rousselle and Renaud, Immersive front-projection analysis using a radiosity-based simulation
    method, Virtual Reality 18(2), 2014; section 5.2 names the alternative.
    """
    problem = prepare(transport, target, lower, upper)
    adjusted = remapped_target(problem)
    return problem.result(adjusted.wanted, adjusted.iterations, adjusted.notes)


def remapped_target(problem: Problem) -> AdjustedTarget:
    """Return the target at the largest gain, and the offset, that stay in range."""
    inverse = Inverse(problem.transport)
    peak = float(np.abs(problem.target).max(initial=0.0)) or 1.0
    by_gain, by_offset = inverse.apply(problem.target), inverse.apply(np.full_like(problem.target, peak))
    gain, offset, slack, rounds = _largest_gain(by_gain.ravel(), by_offset.ravel(), problem.lower, problem.upper)
    notes: dict[str, float | str] = {"gain": gain, "offset": offset * peak}
    if slack > 1e-9:
        notes["out_of_range"] = slack
    return AdjustedTarget(gain * problem.target + offset * peak, gain * by_gain + offset * by_offset, rounds, notes)


def _largest_gain(
    by_gain: FloatArray, by_offset: FloatArray, lower: float, upper: float
) -> tuple[float, float, float, int]:
    """(s, o, slack, rounds): maximise s with lower - slack <= s a + o b <= upper + slack, by adding violated rows."""
    span = upper - lower
    rows: list[list[float]] = []
    bounds: list[float] = []
    # Variables: s, o+, o-, slack in units of the range.
    cost = [-1.0, OFFSET_PRICE, OFFSET_PRICE, SLACK_PRICE]
    s, o, slack = 1.0, 0.0, 0.0
    for count in range(ROUNDS):
        p = s * by_gain + o * by_offset
        high, low = int(np.argmax(p)), int(np.argmin(p))
        if p[high] <= upper + (slack + 1e-9) * span and p[low] >= lower - (slack + 1e-9) * span:
            return s, o, slack, count
        rows += [
            [by_gain[high], by_offset[high], -by_offset[high], -span],
            [-by_gain[low], -by_offset[low], by_offset[low], -span],
        ]
        bounds += [upper, -lower]
        found = linprog(cost, A_ub=rows, b_ub=bounds, bounds=[(0, 1), (0, None), (0, None), (0, None)])
        if not found.success:
            break
        s, o, slack = abs(float(found.x[0])), float(found.x[1] - found.x[2]), float(found.x[3])
    raise SimulationError(
        f"remap: no gain and offset after {ROUNDS} rounds of the linear program; use content_scale or bounded"
    )
