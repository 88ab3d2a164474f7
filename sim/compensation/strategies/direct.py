"""Direct light only: every pixel by its own brightness (Nayar et al. 2003; Grossberg et al. 2004)."""

from __future__ import annotations

from numpy.typing import ArrayLike

from sim.compensation.result import Compensation, prepare
from sim.compensation.split_transport import Transport


def direct(transport: Transport, target: ArrayLike, lower: float = 0.0, upper: float = 1.0) -> Compensation:
    """Project K⁻¹ c / D, clamped.

    Limits: ignores interreflection, so in a room it is too bright; the measure that every other strategy is held to.

    Parameters
    ----------
    transport, target, lower, upper
        As in :func:`sim.compensate`.

    Returns
    -------
    Compensation

    References
    ----------
    Nayar, Peri, Grossberg and Belhumeur, A projection system with radiometric compensation for screen imperfections,
    PROCAMS 2003.
    Grossberg, Peri, Nayar and Belhumeur, Making one object look like another, CVPR 2004.
    """
    problem = prepare(transport, target, lower, upper)
    return problem.result(problem.transport.divide_by_direct(problem.target))
