"""No compensation: the target itself, at one gain."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import ArrayLike

from sim.compensation.result import Compensation, checked_target, finished
from sim.light_transport import LightTransport
from sim.scene import FloatArray


def none(
    transport: LightTransport,
    target: ArrayLike,
    lower: float = 0.0,
    upper: float = 1.0,
    gain: float | None = None,
) -> Compensation:
    """Project gain x target.

    Parameters
    ----------
    gain : float, optional
        Default: the one with the smallest mean absolute error (the figure that strategies are compared by), no larger
        than keeps the image in range: the median of c / (T c), each pixel weighted by T c. 1.0: the target itself, as
        the paper compares.
    """
    started = time.perf_counter()
    c = checked_target(transport, target, lower, upper)
    if gain is None:
        Tc = np.asarray(transport @ c)
        best = _weighted_median(c[Tc > 0] / Tc[Tc > 0], Tc[Tc > 0])
        peak = float(c.max())
        gain = min(best, upper / peak) if peak > 0 else best
    seconds = time.perf_counter() - started
    return finished(transport, c, gain * c, lower, upper, seconds, notes={"gain": gain})


def _weighted_median(values: FloatArray, weights: FloatArray) -> float:
    """Where half of the weight lies below; 0 for no values."""
    if not values.size:
        return 0.0
    order = np.argsort(values)
    below = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(below, below[-1] / 2)])
