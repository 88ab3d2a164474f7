"""Whether taking interreflection away bounce by bounce comes to an end, and the damping that makes it."""

from __future__ import annotations

import numpy as np

from sim.compensation.split_transport import SplitTransport, divide_where_lit
from sim.errors import SimulationError


def spectral_radius(transport: SplitTransport, tolerance: float = 1e-6, limit: int = 500) -> float:
    """Spectral radius of R D⁻¹, R the global light: that of H S D⁻¹ V, patch to patch, the largest of the bands.

    Power iteration; the matrix has no negative entry, so the largest eigenvalue is real and its vector positive.
    """
    return max(_band_radius(transport, b, tolerance, limit) for b in range(len(transport.bands)))


def _band_radius(transport: SplitTransport, band: int, tolerance: float, limit: int) -> float:
    interreflection = transport.interreflections[band]
    D = transport.diagonal[:, band]
    reciprocal = divide_where_lit(np.ones_like(D), D)
    loop = interreflection.emission @ interreflection.view.multiply(reciprocal[:, None]).tocsr()
    x, radius = np.ones(loop.shape[1]), 0.0
    for _ in range(limit):
        x = interreflection.patch_to_patch @ (loop @ (x / max(float(np.linalg.norm(x)), np.finfo(float).tiny)))
        previous, radius = radius, float(np.linalg.norm(x))
        if abs(radius - previous) <= tolerance * radius:
            break
    return radius


def damping_for(
    transport: SplitTransport, strategy: str, damping: float | None
) -> tuple[float, dict[str, float | str]]:
    """Step w for u <- u + w D⁻¹ (c - T u), and the notes that say why.

    The error of such a step shrinks by |1 - w (1 + m)| for each eigenvalue m of R D⁻¹. They lie in -1 ... r, r the
    spectral radius, so w must stay below 2 / (1 + r); 2 / (2 + r) treats 0 and r alike.

    Parameters
    ----------
    damping : float, optional
        Default: 2 / (2 + r). 1: undamped, as published.

    Raises
    ------
    SimulationError
        For a damping with which the iteration diverges.
    """
    radius = spectral_radius(transport)
    limit = 2 / (1 + radius)
    step = 2 / (2 + radius) if damping is None else damping
    if not 0 < step < limit:
        raise SimulationError(
            f"{strategy}: spectral radius {radius:.3f} of the global light over the direct, so with damping {step:g} "
            f"it diverges; the damping must lie between 0 and {limit:.3f}: leave it out to have it chosen"
        )
    said: dict[str, float | str] = {"spectral_radius": radius, "damping": step}
    if radius >= 1:
        said["undamped"] = f"would diverge: spectral radius {radius:.3f}, the limit is 1"
    return step, said
