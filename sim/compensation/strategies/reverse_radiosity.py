"""Reverse radiosity: projected Jacobi steps with automatic damping (Bimber et al. 2006)."""

from __future__ import annotations

from numpy.typing import ArrayLike

from sim.arrays import FloatArray
from sim.compensation.fixed_point import iterate_clamped
from sim.compensation.result import Compensation, prepare
from sim.compensation.spectrum import damping_for
from sim.compensation.split_transport import Transport


def reverse_radiosity(
    transport: Transport,
    target: ArrayLike,
    lower: float = 0.0,
    upper: float = 1.0,
    *,
    steps: int = 60,
    damping: float | None = None,
    tolerance: float = 1e-4,
) -> Compensation:
    """Repeat p <- clamp(p + w K⁻¹ D⁻¹ (c - T p)), so that what is clamped away is taken into account.

    The damping is an addition to what was published.

    Limits: where it ends, each pixel is at a bound or right; that is not the smallest error. Undamped it diverges in
    closed bright rooms.

    Parameters
    ----------
    transport, target, lower, upper
        As in :func:`sim.compensate`.
    steps : int
        At most.
    damping : float, optional
        w; default: by the spectral radius. 1: undamped.
    tolerance : float
        Stops when no value changes by more than this share of the largest.

    Returns
    -------
    Compensation

    Raises
    ------
    SimulationError
        For a damping with which it diverges.

    References
    ----------
    Bimber, Grundhöfer, Zeidler, Danch and Kapakos, Compensating indirect scattering for immersive and semi-immersive
    projection displays, IEEE VR 2006.
    """
    problem = prepare(transport, target, lower, upper)
    split = problem.transport
    step, notes = damping_for(split, "reverse_radiosity", damping)

    def correction(p: FloatArray) -> FloatArray:
        return split.divide_by_direct(problem.target - split.forward(p))

    wanted, taken = iterate_clamped(problem, correction, damping=step, steps=steps, tolerance=tolerance)
    return problem.result(wanted, taken, notes)
