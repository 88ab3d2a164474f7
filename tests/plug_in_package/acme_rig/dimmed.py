"""A strategy that aims at a darker picture, so that less of it is clipped."""

import numpy as np
from numpy.typing import ArrayLike

from sim import Compensation, Strategy, compensate
from sim.compensation import Transport


def dimmed(
    transport: Transport, target: ArrayLike, lower: float = 0.0, upper: float = 1.0, *, share: float = 0.5
) -> Compensation:
    return compensate("exact", transport, share * np.asarray(target), lower, upper)


STRATEGY = Strategy(name="dimmed", solve=dimmed, summary="exact, for half the brightness", version="1")
