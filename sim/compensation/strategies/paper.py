"""The compensation of Dehos et al. 2014, faults included, for replication (eqs. 12, 13, 16)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sim.arrays import FloatArray
from sim.compensation.result import Compensation, prepare
from sim.compensation.split_transport import Transport, divide_where_lit
from sim.light.transport import LightTransport


def wanted_radiosity(transport: LightTransport, target: FloatArray) -> FloatArray:
    """Return (P,) B' of eq. 12: the mean of the target over a patch's pixels; 0 for patches that no pixel sees."""
    pixels = transport.pixel_patch >= 0
    patch = transport.pixel_patch[pixels]
    n = transport.radiosity.n_patches
    count = np.bincount(patch, minlength=n)
    return np.asarray(np.bincount(patch, weights=target[pixels], minlength=n) / np.maximum(count, 1))


def required_emission(transport: LightTransport, target: FloatArray) -> FloatArray:
    """Return (P,) E' = (I - G) B' of eq. 13; below 0 where a patch would have to swallow light."""
    B = wanted_radiosity(transport, target)
    return np.asarray(B - transport.radiosity.gather(B))


def paper(transport: Transport, target: ArrayLike, lower: float = 0.0, upper: float = 1.0) -> Compensation:
    """Project L' = E' / D x c / B' (eq. 16), clamped; 0 where B' = 0. In colour: each band, then K⁻¹.

    Limits: patches that the camera does not see get B' = 0, so the light they return is never subtracted; the
    correction of a patch multiplies, so it also changes the contrast within the patch.

    Parameters
    ----------
    transport, target, lower, upper
        As in :func:`sim.compensate`.

    Returns
    -------
    Compensation
        Its notes hold ``required_emission_min`` and ``required_emission_max``: of E' (eq. 13), over all patches.

    References
    ----------
    Dehos, Zéghers, Sarry, Rousselle and Renaud, Immersive front-projection analysis using a radiosity-based simulation
    method, Virtual Reality 18(2), 2014; equations 12, 13, 16.
    """
    problem = prepare(transport, target, lower, upper)
    emissions = [required_emission(band, problem.target[:, b]) for b, band in enumerate(problem.transport.bands)]
    light = [_band(band, problem.target[:, b], emissions[b]) for b, band in enumerate(problem.transport.bands)]
    wanted = problem.transport.unmixed(divide_where_lit(np.stack(light, axis=-1), problem.transport.diagonal))
    lowest, highest = (float(pick(emissions)) for pick in (np.min, np.max))
    return problem.result(wanted, notes={"required_emission_min": lowest, "required_emission_max": highest})


def _band(band: LightTransport, target: FloatArray, emission: FloatArray) -> FloatArray:
    B = wanted_radiosity(band, target)
    ratio = np.divide(emission, B, out=np.zeros_like(emission), where=B != 0)
    patch = band.pixel_patch
    return np.asarray(np.where(patch >= 0, ratio[patch], 0.0) * target)
