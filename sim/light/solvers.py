"""Solvers of linear systems with a radiosity matrix: conjugate gradients, refinement, and the paper's two."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from sim.arrays import FloatArray
from sim.errors import SimulationError

Product = Callable[[FloatArray], FloatArray]
TINY = float(np.finfo(float).tiny)
SINGLE_TOLERANCE = 1e-5
"""Residual that one solve in single precision is asked for; each refinement gains as much again."""


@dataclass(frozen=True, eq=False)
class Iterate:
    """Where an iteration ended."""

    x: FloatArray
    iterations: int
    products: int
    """Products with the matrix in double precision."""
    products_single: int = 0
    """Products with the matrix in single precision."""


def conjugate_gradients(multiply: Product, right: FloatArray, tolerance: float, limit: int = 2000) -> Iterate:
    """Solve a symmetric positive definite system for every column until its residual is ``tolerance`` of its norm.

    Parameters
    ----------
    multiply : callable
        Product with the matrix, (n,) or (n, k).
    right : (n,) or (n, k) array
        Right-hand side.
    tolerance : float
        Residual over the norm of the right-hand side.
    limit : int
        Most steps.

    Returns
    -------
    Iterate

    Raises
    ------
    SimulationError
        If the residual is not reached after ``limit`` steps.
    """
    x, r = np.zeros_like(right), right.copy()
    p, rr = r, _squared(r)
    goal = tolerance**2 * rr
    for step in range(limit):
        if (rr <= goal).all():
            return Iterate(x, step, step)
        Ap = multiply(p)
        curvature = _dot(p, Ap)
        # A column that has converged exactly has p = 0: leave it where it is.
        length = np.divide(rr, curvature, out=np.zeros_like(rr), where=curvature > 0)
        x, r = x + length * p, r - length * Ap
        before, rr = rr, _squared(r)
        p = r + np.divide(rr, before, out=np.zeros_like(rr), where=before > 0) * p
    worst = float(np.sqrt((rr / np.maximum(goal, TINY)).max()) * tolerance)
    raise SimulationError(
        f"conjugate gradients: relative residual {worst:.1e} after {limit} steps, wanted {tolerance:.0e}; "
        "the reflectance is too close to 1 for this tolerance: lower the one, or raise the other"
    )


def refined(multiply: Product, multiply_single: Product, right: FloatArray, tolerance: float) -> Iterate:
    """Solve in single precision, and again for what the residual in double precision still asks for.

    Raises
    ------
    SimulationError
        If a round gains less than half of what is left: the condition is beyond single precision.
    """
    x, residual = np.zeros_like(right), right
    norm = np.maximum(np.sqrt(_squared(right)), TINY)
    left, iterations, products = np.ones_like(norm), 0, 0
    while (left > tolerance).any():
        wanted = max(SINGLE_TOLERANCE, tolerance / float(left.max()) / 2)
        correction = conjugate_gradients(multiply_single, residual, wanted)
        x = x + correction.x
        residual = right - multiply(x)
        products, iterations = products + 1, iterations + correction.iterations
        before, left = left, np.sqrt(_squared(residual)) / norm
        if (left > np.maximum(tolerance, before / 2)).any():
            raise SimulationError(
                f"refinement in single precision stands still at a relative residual of {float(left.max()):.1e}, "
                f"wanted {tolerance:.0e}; use precision 'double'"
            )
    return Iterate(x, iterations, products, iterations)


def jacobi(G: FloatArray, E: FloatArray, tolerance: float = 1e-10, limit: int = 20_000) -> tuple[FloatArray, int]:
    """Solve (I - G) B = E by Jacobi's iteration (eq. 6), a bounce of light a step; return B and the steps."""
    B = E.copy()
    for step in range(1, limit + 1):
        previous, B = B, E + G @ B
        if np.abs(B - previous).max() <= tolerance * np.abs(E).max():
            return B, step
    raise SimulationError(
        f"Jacobi: not within {tolerance:.0e} after {limit} steps: spectral radius near 1; use conjugate gradients"
    )


def gauss_seidel(G: FloatArray, E: FloatArray, tolerance: float = 1e-10, limit: int = 5_000) -> tuple[FloatArray, int]:
    """Solve (I - G) B = E by Gauss and Seidel's iteration (eq. 6); return B and the sweeps."""
    lower, upper = np.tril(np.eye(len(G)) - G), np.triu(G, 1)
    B = E.copy()
    for sweep in range(1, limit + 1):
        previous, B = B, np.asarray(solve_triangular(lower, E + upper @ B, lower=True, check_finite=False))
        if np.abs(B - previous).max() <= tolerance * np.abs(E).max():
            return B, sweep
    raise SimulationError(
        f"Gauss-Seidel: not within {tolerance:.0e} after {limit} sweeps, for the spectral radius is near 1; "
        "use conjugate gradients"
    )


def _dot(x: FloatArray, y: FloatArray) -> FloatArray:
    # No BLAS: its threads take longer to wake than these sums take.
    return np.asarray((x * y).sum(axis=0))


def _squared(x: FloatArray) -> FloatArray:
    return _dot(x, x)
