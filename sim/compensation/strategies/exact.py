"""The exact inverse of the light transport, unlit patches eliminated (Mukaigawa et al. 2006)."""

from __future__ import annotations

from numpy.typing import ArrayLike

from sim.compensation.inverse import Inverse
from sim.compensation.result import Compensation, prepare
from sim.compensation.split_transport import Transport


def exact(transport: Transport, target: ArrayLike, lower: float = 0.0, upper: float = 1.0) -> Compensation:
    """Project T⁻¹ c, exact at pixel level, then clamped.

    Patches that no pixel lights have no emission, and what they return is subtracted. Pixels without direct light
    stay at 0. Reference: Mukaigawa, Kakinuma and Ohta, Analytical compensation of inter-reflection for pattern
    projection, VRST 2006; here with the unlit patches eliminated.

    Limits: exact only where the range allows it. What is clamped away lets the light of other pixels fall short.
    """
    task = prepare(transport, target, lower, upper)
    inverse = Inverse(task.view)
    wanted = inverse.apply(task.target)
    return task.finished(wanted, inverse.iterations)
