"""The exact inverse of the light transport, unlit patches eliminated (Mukaigawa et al. 2006)."""

from __future__ import annotations

from numpy.typing import ArrayLike

from sim.compensation.inverse import Inverse
from sim.compensation.result import Compensation, prepare
from sim.compensation.split_transport import Transport

SHARPENING = 2
"""Steps: what blur takes is raised by 3 at most."""


def exact(transport: Transport, target: ArrayLike, lower: float = 0.0, upper: float = 1.0) -> Compensation:
    """Project T⁻¹ c, exact at pixel level, then clamped.

    Patches that no pixel lights have no emission, and what they return is subtracted: they are eliminated, which is
    an addition to what was published. So is that a picture that would be blurred is sharpened by some steps of van
    Cittert's; global light is too smooth for that to change it. Pixels without direct light stay at 0.

    Limits: exact only where the range allows it. What is clamped away lets the light of other pixels fall short.

    Parameters
    ----------
    transport, target, lower, upper
        As in :func:`sim.compensate`.

    Returns
    -------
    Compensation

    References
    ----------
    Mukaigawa, Kakinuma and Ohta, Analytical compensation of inter-reflection for pattern projection, VRST 2006.
    """
    problem = prepare(transport, target, lower, upper)
    inverse = Inverse(problem.transport)
    wanted = inverse.apply(problem.target)
    return problem.result(problem.shown.sharpened(wanted, SHARPENING), inverse.iterations)
