"""No compensation: the target itself, at one gain."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import ArrayLike

from sim.compensation.result import Compensation, checked_target, finished
from sim.light_transport import LightTransport


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
        Default: the least-squares gain <T c, c> / <T c, T c>, no larger than keeps the image in range.
        1.0: the target itself, as the paper compares.
    """
    started = time.perf_counter()
    c = checked_target(transport, target, lower, upper)
    if gain is None:
        Tc = np.asarray(transport @ c)
        power = float(Tc @ Tc)
        best = float(Tc @ c) / power if power > 0 else 0.0
        peak = float(c.max())
        gain = min(best, upper / peak) if peak > 0 else best
    seconds = time.perf_counter() - started
    return finished(transport, c, gain * c, lower, upper, seconds, notes={"gain": gain})
