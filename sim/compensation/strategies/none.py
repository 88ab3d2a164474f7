"""No compensation: the target itself, at one gain."""

from __future__ import annotations

from numpy.typing import ArrayLike

from sim.compensation.result import Compensation, prepare
from sim.compensation.split_transport import Transport
from sim.light.criteria import weighted_median


def none(
    transport: Transport,
    target: ArrayLike,
    lower: float = 0.0,
    upper: float = 1.0,
    *,
    gain: float | None = None,
) -> Compensation:
    """Project gain x target, in colour too: each channel shows its band of the target.

    Parameters
    ----------
    transport, target, lower, upper
        As in :func:`sim.compensate`.
    gain : float, optional
        Default: the one with the smallest mean absolute error (the figure that strategies are compared by), no larger
        than keeps the image in range: the median of c / (T c), each value weighted by T c. 1.0: the target itself, as
        the paper compares.

    Returns
    -------
    Compensation
        Its notes hold ``gain``.
    """
    problem = prepare(transport, target, lower, upper)
    c = problem.target
    if gain is None:
        seen = problem.transport.forward(c)
        lit = seen > 0
        best = weighted_median(c[lit] / seen[lit], seen[lit])
        peak = float(c.max())
        gain = min(best, upper / peak) if peak > 0 else best
    return problem.result(gain * c, notes={"gain": gain})
