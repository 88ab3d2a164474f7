"""The compensation of Dehos et al. 2014, faults included, for replication (eqs. 12, 13, 16)."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import ArrayLike

from sim.compensation.result import Compensation, checked_target, diagonal_of, divided, finished
from sim.light_transport import LightTransport
from sim.scene import FloatArray


def wanted_radiosity(transport: LightTransport, target: FloatArray) -> FloatArray:
    """(P,) B' of eq. 12: mean of the target over a patch's pixels; 0 for patches that no pixel sees."""
    pixels = transport.pixel_patch >= 0
    patch = transport.pixel_patch[pixels]
    n = transport.radiosity.n_patches
    count = np.bincount(patch, minlength=n)
    return np.asarray(np.bincount(patch, weights=target[pixels], minlength=n) / np.maximum(count, 1))


def required_emission(transport: LightTransport, target: FloatArray) -> FloatArray:
    """(P,) E' = (I - G) B' of eq. 13; below 0 where a patch would have to swallow light."""
    B = wanted_radiosity(transport, target)
    return np.asarray(B - transport.radiosity.gather(B))


def paper(transport: LightTransport, target: ArrayLike, lower: float = 0.0, upper: float = 1.0) -> Compensation:
    """L' = E' / D x c / B' (eq. 16), clamped; 0 where B' = 0.

    Patches that the camera does not see get B' = 0, so the light they return is never subtracted.
    """
    started = time.perf_counter()
    c = checked_target(transport, target, lower, upper)
    diagonal = diagonal_of(transport)
    B, E = wanted_radiosity(transport, c), required_emission(transport, c)
    ratio = np.divide(E, B, out=np.zeros_like(E), where=B != 0)
    patch = transport.pixel_patch
    wanted = divided(np.where(patch >= 0, ratio[patch], 0.0) * c, diagonal)
    notes = {"required_emission_min": float(E.min()), "required_emission_max": float(E.max())}
    return finished(transport, c, wanted, lower, upper, time.perf_counter() - started, notes=notes)
