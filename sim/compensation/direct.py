"""Direct light only: every pixel by its own brightness (Nayar et al. 2003; Grossberg et al. 2004)."""

from __future__ import annotations

import time

from numpy.typing import ArrayLike

from sim.compensation.result import Compensation, checked_target, diagonal_of, divided, finished
from sim.light_transport import LightTransport


def direct(transport: LightTransport, target: ArrayLike, lower: float = 0.0, upper: float = 1.0) -> Compensation:
    """Project c / D, clamped: ignores interreflection."""
    started = time.perf_counter()
    c = checked_target(transport, target, lower, upper)
    wanted = divided(c, diagonal_of(transport))
    return finished(transport, c, wanted, lower, upper, time.perf_counter() - started)
