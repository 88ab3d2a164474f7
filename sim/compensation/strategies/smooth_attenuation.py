"""A picture dimmed smoothly where it cannot be shown (Ashdown et al. 2006)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize
from scipy.sparse import coo_array, csr_array

from sim.arrays import FloatArray
from sim.compensation.adjusted_target import AdjustedTarget
from sim.compensation.inverse import Inverse
from sim.compensation.result import Compensation, Problem, prepare
from sim.compensation.split_transport import Transport
from sim.errors import SimulationError
from sim.geometry.interpolation import bilinear

COLUMNS = 24
"""Control points of the attenuation across the picture."""


def smooth_attenuation(
    transport: Transport,
    target: ArrayLike,
    lower: float = 0.0,
    upper: float = 1.0,
    *,
    smoothness: float = 0.02,
    in_range: float = 30.0,
    limit: int = 60,
) -> Compensation:
    """Project T⁻¹ (s c), clamped, s an attenuation in 0 ... 1 that is smooth, near 1, and keeps the image in range.

    s minimises smoothness x mean |∇s|² + mean (1 - s)² + in_range x mean (excess over the range)²; it is bilinear
    between control points, and ∇ is per width of the picture. Here in linear light, the same s in all bands.

    Limits: brightness of neighbouring parts changes relative to each other. What black cannot give stays, for dimming
    does not help it much. Without pixel positions in the transport s is one number.

    Parameters
    ----------
    transport, target, lower, upper
        As in :func:`sim.compensate`.
    smoothness, in_range : float
        Weights against the closeness to 1.
    limit : int
        Most iterations of L-BFGS-B.

    Returns
    -------
    Compensation
        Its notes hold ``attenuation_mean`` and ``attenuation_min``.

    Raises
    ------
    SimulationError
        For weights that are not above 0.

    References
    ----------
    Ashdown, Okabe, Sato and Sato, Robust content-dependent photometric projector compensation, PROCAMS 2006.
    """
    problem = prepare(transport, target, lower, upper)
    adjusted = attenuated_target(problem, smoothness, in_range, limit)
    return problem.result(adjusted.wanted, adjusted.iterations, adjusted.notes)


def attenuated_target(
    problem: Problem, smoothness: float = 0.02, in_range: float = 30.0, limit: int = 60
) -> AdjustedTarget:
    """Return the target dimmed smoothly."""
    if not (smoothness > 0 and in_range > 0):
        raise SimulationError(f"smooth_attenuation: smoothness {smoothness:g}, in_range {in_range:g}; both above 0")
    grid = _grid(problem.transport.bands[0].pixel_xy_px, len(problem.target))
    inverse = Inverse(problem.transport)
    span = problem.upper - problem.lower

    def cost(knots: FloatArray) -> tuple[float, FloatArray]:
        s = grid.weights @ knots
        p = inverse.apply(s[:, None] * problem.target)
        excess = (p - problem.clamped(p)) / span
        returned = grid.adjoint @ (problem.target * inverse.adjoint(excess)).sum(axis=1)
        slopes = grid.slopes @ knots
        edges = max(len(slopes), 1)
        value = smoothness * float(slopes @ slopes) / edges + float(((1 - s) ** 2).mean())
        value += in_range * float((excess**2).mean())
        gradient = 2 * smoothness / edges * (grid.slopes.T @ slopes) - 2 / len(s) * (grid.adjoint @ (1 - s))
        return value, np.asarray(gradient + 2 * in_range / (excess.size * span) * returned)

    start = np.ones(grid.weights.shape[1])
    found = minimize(cost, start, jac=True, method="L-BFGS-B", bounds=[(0, 1)] * len(start), options={"maxiter": limit})
    s = np.clip(grid.weights @ found.x, 0.0, 1.0)
    values = s[:, None] * problem.target
    notes: dict[str, float | str] = {"attenuation_mean": float(s.mean()), "attenuation_min": float(s.min())}
    return AdjustedTarget(values, inverse.apply(values), int(found.nit), notes)


@dataclass(frozen=True, eq=False)
class _Grid:
    """Control points over the picture."""

    weights: csr_array
    """(n, knots)."""
    adjoint: csr_array
    """(knots, n)."""
    slopes: csr_array
    """(edges, knots) difference of neighbours per width of the picture."""


def _grid(xy_px: FloatArray | None, n: int) -> _Grid:
    if xy_px is None:
        weights = csr_array(np.ones((n, 1)))
        return _Grid(weights, csr_array(weights.T), csr_array((0, 1)))
    least, most = xy_px.min(axis=0), xy_px.max(axis=0)
    spacing = max(float(most[0] - least[0]), 1.0) / (COLUMNS - 1)
    width, height = (int(size) for size in np.ceil((most - least) / spacing) + 1)
    rows, columns, values = bilinear((xy_px - least) / spacing, width, height)
    knots = (rows * width + columns).ravel()
    weights = csr_array(coo_array((values.ravel(), (np.repeat(np.arange(n), 4), knots)), shape=(n, width * height)))
    number = np.arange(width * height).reshape(height, width)
    pairs = np.concatenate(
        [
            np.stack([number[:, :-1].ravel(), number[:, 1:].ravel()], axis=1),
            np.stack([number[:-1].ravel(), number[1:].ravel()], axis=1),
        ]
    )
    edge = np.repeat(np.arange(len(pairs)), 2)
    signs = np.tile([-1.0, 1.0], len(pairs)) * (COLUMNS - 1)
    slopes = csr_array(coo_array((signs, (edge, pairs.ravel())), shape=(len(pairs), width * height)))
    return _Grid(weights, csr_array(weights.T), slopes)
