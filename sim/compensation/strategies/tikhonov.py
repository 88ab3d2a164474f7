"""The regularised inverse of a measured transport (Wetzstein and Bimber 2007)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse.linalg import LinearOperator, lsqr

from sim.arrays import FloatArray
from sim.compensation.result import Compensation, Problem, prepare
from sim.compensation.split_transport import Transport, direct_blocks
from sim.errors import SimulationError

DEFAULT_NOISE = 1 / 255 / 12**0.5
"""Share of the target's peak: the quantisation noise of an 8-bit camera."""
SEARCHES = 12
"""Most values of the damping that are tried."""

_Solve = Callable[[float], tuple[FloatArray, float, int]]


def tikhonov(
    transport: Transport,
    target: ArrayLike,
    lower: float = 0.0,
    upper: float = 1.0,
    *,
    noise_rms: float | None = None,
    prior: float = 0.0,
    limit: int = 200,
) -> Compensation:
    """Minimise ||T p - c||² + λ² ||p - p0||² by LSQR, then clamp.

    λ by Morozov's discrepancy principle: the largest with ||T p - c|| within the noise, so that noise is not amplified
    into the projector image.

    Limits: it guards against noise and not against the projector's range; clamping comes last, as in ``exact``.

    Parameters
    ----------
    transport, target, lower, upper
        As in :func:`sim.compensate`.
    noise_rms : float, optional
        Measured noise of the transport's prediction, in the target's unit; default: an 8-bit step's at the peak.
    prior : float
        p0, the level that λ pulls every pixel to.
    limit : int
        Most iterations of one LSQR.

    Returns
    -------
    Compensation
        Its notes hold ``noise_rms`` and ``regularisation``, λ.

    Raises
    ------
    SimulationError
        For noise that is not a number above 0.

    References
    ----------
    Wetzstein and Bimber, Radiometric compensation through inverse light transport, Pacific Graphics 2007.
    Paige and Saunders, LSQR, ACM Transactions on Mathematical Software 8, 1982.
    """
    problem = prepare(transport, target, lower, upper)
    noise = DEFAULT_NOISE * float(np.abs(problem.target).max(initial=0.0)) if noise_rms is None else noise_rms
    if noise_rms is not None and not (np.isfinite(noise_rms) and noise_rms > 0):
        raise SimulationError(f"tikhonov: noise_rms {noise_rms:g}; give the measured noise, above 0")
    if noise == 0:
        return problem.result(np.zeros_like(problem.target), 0, {"noise_rms": 0.0, "regularisation": 0.0})
    wanted = noise * problem.target.size**0.5
    solve = _solver(problem, prior, limit, min(1e-4, 0.1 * wanted / float(np.linalg.norm(problem.target))))
    p, found, iterations = _discrepancy(problem, solve, wanted)
    return problem.result(p, iterations, {"noise_rms": noise, "regularisation": found})


def _solver(problem: Problem, prior: float, limit: int, tolerance: float) -> _Solve:
    """λ -> p, ||T p - c||, iterations; LSQR on [T; λ] M, M the inverse root of direct light's part at each pixel."""
    split, shape, size = problem.transport, problem.target.shape, problem.target.size
    blocks = direct_blocks(split)
    start = np.full(shape, prior)
    right = np.concatenate([(problem.target - split.forward(start)).ravel(), np.zeros(size)])

    def solve(damp: float) -> tuple[FloatArray, float, int]:
        root = np.linalg.inv(np.linalg.cholesky(blocks + damp**2 * np.eye(shape[1])))

        def image(y: FloatArray) -> FloatArray:
            return np.asarray(np.einsum("ncb,nc->nb", root, y.reshape(shape)))

        def forward(y: FloatArray) -> FloatArray:
            p = image(y)
            return np.concatenate([split.forward(p).ravel(), damp * p.ravel()])

        def adjoint(r: FloatArray) -> FloatArray:
            returned = split.adjoint(r[:size].reshape(shape)) + damp * r[size:].reshape(shape)
            return np.asarray(np.einsum("nbc,nc->nb", root, returned)).ravel()

        operator = LinearOperator((2 * size, size), matvec=forward, rmatvec=adjoint, dtype=np.dtype(np.float64))
        y, _, iterations = lsqr(operator, right, atol=tolerance, btol=tolerance, iter_lim=limit)[:3]
        p = start + image(y)
        return p, float(np.linalg.norm(split.forward(p) - problem.target)), int(iterations)

    return solve


def _discrepancy(problem: Problem, solve: _Solve, wanted: float) -> tuple[FloatArray, float, int]:
    """Bisect log λ for the largest that leaves ||T p - c|| within what is wanted."""
    scale = float(problem.transport.diagonal.max(initial=0.0)) or 1.0
    low, high = -6 * np.log(10.0), 4 * np.log(10.0)
    guess, total = np.log(1e-2), 0
    best: tuple[FloatArray, float] | None = None
    for _ in range(SEARCHES):
        p, residual, iterations = solve(scale * float(np.exp(guess)))
        total += iterations
        if residual <= wanted:
            best, low = (p, scale * float(np.exp(guess))), guess
            if residual > 0.9 * wanted:
                break
        else:
            high = guess
        # The residual grows about as λ² where the inverse is well conditioned.
        by_power = guess + 0.5 * float(np.log(0.95 * wanted / max(residual, 1e-300)))
        guess = by_power if low < by_power < high else (low + high) / 2
    if best is None:
        least = scale * float(np.exp(low))
        p, _, iterations = solve(least)
        return p, least, total + iterations
    return *best, total
