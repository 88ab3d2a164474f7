"""How good an immersive projection is: section 5.2 of Dehos et al. 2014."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.arrays import BoolArray, FloatArray
from sim.light.transport import LightTransport


@dataclass(frozen=True)
class Spread:
    """Smallest, mean and largest value."""

    min: float
    mean: float
    max: float


@dataclass(frozen=True)
class Difference:
    """Statistics of |visible - desired| over the pixels, in their unit."""

    mean: float
    sd: float
    max: float
    rms: float


def spread(values: FloatArray) -> Spread:
    """Return the smallest, mean and largest of an array."""
    return Spread(float(values.min()), float(values.mean()), float(values.max()))


def visible_patches(transport: LightTransport) -> BoolArray:
    """Return (P,) bool: patches that some camera pixel sees."""
    visible = np.zeros(transport.radiosity.n_patches, dtype=bool)
    visible[transport.view.indices] = True
    return visible


def indirect_radiosity(transport: LightTransport, p: FloatArray) -> FloatArray:
    """Return B - E of the visible patches for a projector image (n_projector,)."""
    E, B = transport.radiosity_of(p)
    return np.asarray((B - E)[visible_patches(transport)])


def once_reflected_share(transport: LightTransport, p: FloatArray) -> FloatArray:
    """Return (n_camera,) the share of each pixel's light that was reflected once; 0 where there is no light."""
    direct, total = np.asarray(transport.direct @ p), np.asarray(transport @ p)
    return np.asarray(np.divide(direct, total, out=np.zeros_like(total), where=total > 0))


def emission_share(transport: LightTransport, p: FloatArray) -> FloatArray:
    """Return E / B of the visible patches for a projector image (n_projector,); 0 where there is no light."""
    E, B = transport.radiosity_of(p)
    share = np.divide(E, B, out=np.zeros_like(B), where=B > 0)
    return np.asarray(share[visible_patches(transport)])


def overall_once_reflected_share(transport: LightTransport, p: FloatArray) -> float:
    """Return the share of all camera light that was reflected once."""
    total = float(np.asarray(transport @ p).sum())
    return float(np.asarray(transport.direct @ p).sum()) / total if total > 0 else 0.0


def difference(visible: FloatArray, desired: FloatArray) -> Difference:
    """Return statistics of |visible - desired|, two images of one shape and unit."""
    error = np.abs(np.asarray(visible, dtype=np.float64) - desired)
    return Difference(float(error.mean()), float(error.std()), float(error.max()), float(np.sqrt(np.mean(error**2))))


def weighted_median(values: FloatArray, weights: FloatArray) -> float:
    """Return the value (of (n,)) below which half of the weight (n,) lies; 0 for no values."""
    if not values.size:
        return 0.0
    order = np.argsort(values)
    below = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(below, below[-1] / 2)])
