"""The compensation of Dehos et al. 2014, faults included, for replication (eqs. 12, 13, 16)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sim.compensation.result import Compensation, prepare
from sim.compensation.split_transport import Transport, divided
from sim.geometry.scene import FloatArray
from sim.light.transport import LightTransport


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


def paper(transport: Transport, target: ArrayLike, lower: float = 0.0, upper: float = 1.0) -> Compensation:
    """L' = E' / D x c / B' (eq. 16), clamped; 0 where B' = 0. In colour: each band, then K⁻¹.

    Reference: Dehos, Zéghers, Sarry, Rousselle and Renaud, Immersive front-projection analysis using a
    radiosity-based simulation method, Virtual Reality 18(2), 2014.

    Limits: patches that the camera does not see get B' = 0, so the light they return is never subtracted; the
    correction of a patch multiplies, so it also changes the contrast within the patch.
    """
    task = prepare(transport, target, lower, upper)
    emissions = [required_emission(band, task.target[:, b]) for b, band in enumerate(task.view.bands)]
    light = [_band(band, task.target[:, b], emissions[b]) for b, band in enumerate(task.view.bands)]
    wanted = task.view.unmixed(divided(np.stack(light, axis=-1), task.view.diagonal))
    lowest, highest = (float(pick(emissions)) for pick in (np.min, np.max))
    return task.finished(wanted, notes={"required_emission_min": lowest, "required_emission_max": highest})


def _band(band: LightTransport, target: FloatArray, emission: FloatArray) -> FloatArray:
    B = wanted_radiosity(band, target)
    ratio = np.divide(emission, B, out=np.zeros_like(emission), where=B != 0)
    patch = band.pixel_patch
    return np.asarray(np.where(patch >= 0, ratio[patch], 0.0) * target)
