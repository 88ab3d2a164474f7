"""No compensation: the target itself, at one gain."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sim.compensation.result import Compensation, prepare
from sim.compensation.split_transport import Transport
from sim.geometry.scene import FloatArray


def none(
    transport: Transport,
    target: ArrayLike,
    lower: float = 0.0,
    upper: float = 1.0,
    gain: float | None = None,
) -> Compensation:
    """Project gain x target, in colour too: each channel shows its band of the target.

    Parameters
    ----------
    gain : float, optional
        Default: the one with the smallest mean absolute error (the figure that strategies are compared by), no larger
        than keeps the image in range: the median of c / (T c), each value weighted by T c. 1.0: the target itself, as
        the paper compares.
    """
    task = prepare(transport, target, lower, upper)
    c = task.target
    if gain is None:
        seen = task.view.forward(c)
        lit = seen > 0
        best = weighted_median(c[lit] / seen[lit], seen[lit])
        peak = float(c.max())
        gain = min(best, upper / peak) if peak > 0 else best
    return task.finished(gain * c, notes={"gain": gain})


def weighted_median(values: FloatArray, weights: FloatArray) -> float:
    """Where half of the weight lies below; 0 for no values."""
    if not values.size:
        return 0.0
    order = np.argsort(values)
    below = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(below, below[-1] / 2)])
