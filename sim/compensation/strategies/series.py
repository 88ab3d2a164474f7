"""The truncated series of the inverse: one bounce taken away a term (Seitz 2005, Bai 2010, Ng 2012)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sim.compensation.result import Compensation, prepare
from sim.compensation.spectrum import damping_for
from sim.compensation.split_transport import Transport
from sim.errors import SimulationError


def series(
    transport: Transport,
    target: ArrayLike,
    lower: float = 0.0,
    upper: float = 1.0,
    *,
    terms: int = 8,
    damping: float | None = None,
) -> Compensation:
    """Sum the first terms of T⁻¹ c = D⁻¹ sum (-R D⁻¹)^k c, then clamp.

    Limits: that series converges only where the spectral radius of R D⁻¹ is below 1. So unless told otherwise it is
    the damped one, w D⁻¹ sum (1 - w T D⁻¹)^k c, that is summed. Clamping comes last, as in ``exact``.

    Parameters
    ----------
    transport, target, lower, upper
        As in :func:`sim.compensate`.
    terms : int
        1 is ``direct``.
    damping : float, optional
        w; default: by the spectral radius. 1: the series as published.

    Returns
    -------
    Compensation
        Its notes hold ``left_before_clamping``: the length of T p - c over that of c.

    Raises
    ------
    SimulationError
        For no terms, or a damping with which the series diverges.

    References
    ----------
    Seitz, Matsushita and Kutulakos, A theory of inverse light transport, ICCV 2005.
    Bai, Chandraker, Ng and Ramamoorthi, A dual theory of inverse and forward light transport, ECCV 2010.
    Ng, Pahwa, Bai, Tan and Ramamoorthi, From the rendering equation to stratified light transport inversion, IJCV 2012.
    """
    if terms < 1:
        raise SimulationError(f"series: {terms} terms; it takes at least 1")
    problem = prepare(transport, target, lower, upper)
    split = problem.transport
    step, notes = damping_for(split, "series", damping)
    p = step * split.divide_by_direct(problem.target)
    for _ in range(terms - 1):
        p = p + step * split.divide_by_direct(problem.target - split.forward(p))
    left = np.linalg.norm(problem.target - split.forward(p)) / max(float(np.linalg.norm(problem.target)), 1e-300)
    return problem.result(p, terms, notes | {"left_before_clamping": float(left)})
