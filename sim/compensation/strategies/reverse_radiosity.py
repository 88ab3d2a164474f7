"""Reverse radiosity: projected Jacobi steps with automatic damping (Bimber et al. 2006)."""

from __future__ import annotations

from numpy.typing import ArrayLike

from sim.compensation.fixed_point import repeated
from sim.compensation.result import Compensation, prepare
from sim.compensation.spectrum import damping_for
from sim.compensation.split_transport import Transport


def reverse_radiosity(
    transport: Transport,
    target: ArrayLike,
    lower: float = 0.0,
    upper: float = 1.0,
    steps: int = 60,
    damping: float | None = None,
    tolerance: float = 1e-4,
) -> Compensation:
    """Repeat p <- clamp(p + w K⁻¹ D⁻¹ (c - T p)), so that what is clamped away is taken into account.

    Reference: Bimber, Grundhöfer, Zeidler, Danch and Kapakos, Compensating indirect scattering for immersive and
    semi-immersive projection displays, IEEE VR 2006; the damping is ours.

    Limits: where it ends, each pixel is at a bound or right; that is not the smallest error. Undamped it diverges in
    closed bright rooms.

    Parameters
    ----------
    steps : int
        At most.
    damping : float, optional
        w; default: by the spectral radius. 1: undamped.
    tolerance : float
        Stops when no value changes by more than this share of the largest.

    Raises
    ------
    SimulationError
        For a damping with which it diverges.
    """
    task = prepare(transport, target, lower, upper)
    view = task.view
    step, notes = damping_for(view, "reverse_radiosity", damping)
    wanted, taken = repeated(task, lambda p: view.by_direct(task.target - view.forward(p)), step, steps, tolerance)
    return task.finished(wanted, taken, notes)
