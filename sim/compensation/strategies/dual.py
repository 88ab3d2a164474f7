"""The dual of light transport: one gather of the target itself (Bai et al. 2010, Ng et al. 2012)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sim.compensation.result import Compensation, prepare
from sim.compensation.split_transport import Transport
from sim.compensation.strategies.paper import wanted_radiosity


def dual(transport: Transport, target: ArrayLike, lower: float = 0.0, upper: float = 1.0) -> Compensation:
    """Project D⁻¹ (1 - A) c, A one bounce between what the camera sees, then clamp.

    With T = (1 - A)⁻¹ D the inverse needs a single gather, no series: c minus G B' at each pixel, B' the target's
    mean over each patch.

    Limits: A acts on what is seen; patches that no pixel sees count as black, so the light they return is left in.

    Parameters
    ----------
    transport, target, lower, upper
        As in :func:`sim.compensate`.

    Returns
    -------
    Compensation

    References
    ----------
    Bai, Chandraker, Ng and Ramamoorthi, A dual theory of inverse and forward light transport, ECCV 2010.
    Ng, Pahwa, Bai, Tan and Ramamoorthi, From the rendering equation to stratified light transport inversion, IJCV 2012.
    """
    problem = prepare(transport, target, lower, upper)
    bounced = [
        band.view @ band.radiosity.gather(wanted_radiosity(band, problem.target[:, b]))
        for b, band in enumerate(problem.transport.bands)
    ]
    return problem.result(problem.transport.divide_by_direct(problem.target - np.stack(bounced, axis=-1)))
