"""The best image that the projector's range allows: bounded least squares with a certificate."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import solve
from scipy.sparse import block_array

from sim.compensation.exact import unbounded
from sim.compensation.result import Compensation, checked_target, diagonal_of, finished
from sim.coupling import Coupling
from sim.light_transport import LightTransport
from sim.scene import BoolArray, FloatArray

ENOUGH = 0.3
"""Share of the certified gap that a good step leaves at most."""
DAMPING_RANGE = (1e-9, 1.0)
"""Levenberg and Marquardt's damping of a step, as a share of the curvature; starts at 1e-6."""


def bounded(
    transport: LightTransport,
    target: ArrayLike,
    lower: float = 0.0,
    upper: float = 1.0,
    tolerance: float = 1e-3,
    limit: int = 60,
) -> Compensation:
    """Minimise ||T p - c||² over lower <= p <= upper, to a certified share of the optimum.

    A primal-dual active set method (Hintermüller, Ito and Kunisch, SIAM J. Optim. 13, 2002): pixels that a
    diagonal step would carry past a bound are put there, the others take the exact least-squares step, found
    through the patches by Woodbury's identity, since TᵀT is diagonal plus a matrix of rank 2 P. Where that
    does not descend, a projected Newton or gradient step with Armijo's rule does (Bertsekas, SIAM J. Control
    Optim. 20, 1982). The objective is convex, so it can fall by no more than the gap
    sum max(g (p - lower), g (p - upper)), g the gradient: that is the certificate.

    Parameters
    ----------
    tolerance : float
        Stop once the RMS residual is proven to be within this share of the optimum.
    limit : int
        Most steps; the best image so far is returned, and ``short_of_optimum`` says how good it is.

    Returns
    -------
    Compensation
        Its notes hold ``kkt_residual`` (relative, 0 at the optimum), ``optimal_rms_at_least`` and
        ``short_of_optimum``: by which share, at most, the RMS residual is above the optimum.
    """
    started = time.perf_counter()
    c = checked_target(transport, target, lower, upper)
    problem = _Problem(transport.coupling, diagonal_of(transport), c, lower, upper)
    state = problem.at(np.clip(unbounded(problem.coupling, problem.diagonal, c)[0], lower, upper))
    iterations, damping = 0, 1e-6
    while iterations < limit and not problem.certified(state, tolerance):
        better = _improved(problem, state, damping)
        if better is None and damping >= DAMPING_RANGE[1]:
            break
        poor = better is None or better.gap > ENOUGH * state.gap
        damping = float(np.clip(damping * (30.0 if poor else 0.1), *DAMPING_RANGE))
        state, iterations = better or state, iterations + 1
    at_bound = problem.held(state)
    notes = {
        "kkt_residual": problem.kkt_residual(state),
        "short_of_optimum": 0.0 if problem.negligible(state) else problem.short(state),
        "optimal_rms_at_least": float(np.sqrt(2 * max(state.objective - state.gap, 0.0) / c.size)),
    }
    result = finished(transport, c, state.p, lower, upper, time.perf_counter() - started, iterations, notes)
    return Compensation(
        result.projector_image,
        result.predicted,
        at_bound,
        result.residual_rms,
        iterations,
        result.seconds,
        notes,
    )


@dataclass(frozen=True, eq=False)
class _State:
    p: FloatArray
    residual: FloatArray
    gradient: FloatArray
    objective: float
    gap: float


@dataclass(frozen=True, eq=False)
class _Problem:
    coupling: Coupling
    diagonal: FloatArray
    target: FloatArray
    lower: float
    upper: float

    @cached_property
    def returned(self) -> FloatArray:
        """Hᵀ Vᵀ V H: what the lit patches send back to the image, squared."""
        H, V = self.coupling.interreflection, self.coupling.view
        return np.asarray(H.T @ ((self.coupling.view_adjoint @ V) @ H))

    @cached_property
    def curvature(self) -> FloatArray:
        """About the diagonal of TᵀT: direct light, and indirect light by patch."""
        indirect = self.coupling.emission_adjoint.power(2) @ np.diag(self.returned)
        total = np.asarray(self.diagonal**2 + indirect)
        return np.asarray(np.maximum(total, max(1e-12 * float(total.max()), np.finfo(float).tiny ** 0.5)))

    def forward(self, p: FloatArray) -> FloatArray:
        return self.diagonal * p + self.coupling.apply(p)

    def at(self, p: FloatArray) -> _State:
        residual = self.forward(p) - self.target
        gradient = self.diagonal * residual + self.coupling.adjoint(residual)
        gap = np.maximum(gradient * (p - self.lower), gradient * (p - self.upper)).sum()
        return _State(p, residual, gradient, float(residual @ residual) / 2, float(gap))

    def certified(self, state: _State, tolerance: float) -> bool:
        return self.negligible(state) or self.short(state) <= tolerance

    def negligible(self, state: _State) -> bool:
        """Tell if the residual is roundoff."""
        return state.objective <= 1e-20 * float(self.target @ self.target)

    def short(self, state: _State) -> float:
        """How far, at most, the RMS residual is above the optimum, as a share."""
        return 1 - float(np.sqrt(max(1 - state.gap / max(state.objective, 1e-300), 0.0)))

    def held(self, state: _State) -> BoolArray:
        """Pixels that the gradient presses against a bound."""
        at_lower = (state.p <= self.lower) & (state.gradient >= 0)
        return np.asarray(at_lower | ((state.p >= self.upper) & (state.gradient <= 0)))

    def kkt_residual(self, state: _State) -> float:
        """Length of the scaled projected gradient, relative to the target's."""
        step = np.clip(state.p - state.gradient / self.curvature, self.lower, self.upper) - state.p
        length = float(np.linalg.norm(np.sqrt(self.curvature) * step))
        return length / max(float(np.linalg.norm(self.target)), 1e-300)


def _improved(problem: _Problem, state: _State, damping: float) -> _State | None:
    """Take a step that descends: active set, projected Newton or projected gradient; None if none does."""
    diagonal_step = state.p - state.gradient / problem.curvature
    low, high = diagonal_step <= problem.lower, diagonal_step >= problem.upper
    moved = problem.at(np.where(low, problem.lower, np.where(high, problem.upper, state.p)))
    step = _newton_step(problem, moved, ~(low | high), damping)
    trial = problem.at(np.clip(moved.p + step, problem.lower, problem.upper))
    if trial.objective < state.objective and trial.gap < ENOUGH * state.gap:
        return trial
    newton = _searched(problem, state, _newton_step(problem, state, ~problem.held(state), damping))
    descending = [each for each in (trial, newton) if each is not None and each.objective < state.objective]
    if descending:
        return min(descending, key=lambda each: each.objective)
    return _searched(problem, state, -state.gradient / problem.curvature)


def _newton_step(problem: _Problem, state: _State, free: BoolArray, damping: float) -> FloatArray:
    """Minimise the least squares over the free pixels: (TᵀT + damping)_FF step_F = -g_F.

    (TᵀT)_FF = D² + U M Uᵀ with U = [Sᵀ, D V]_F and M = [[Hᵀ Vᵀ V H, Hᵀ], [H, 0]], V over all pixels.
    """
    coupling, d = problem.coupling, problem.diagonal
    inverse = np.where(free, 1 / (d**2 + damping * problem.curvature), 0.0)
    H, S, V = coupling.interreflection, coupling.emission, coupling.view
    right = -state.gradient * inverse
    S_scaled, V_scaled = S.multiply(inverse).tocsr(), V.multiply((d * inverse)[:, None]).tocsr()
    cross = S @ V_scaled
    C = block_array(
        [
            [S_scaled @ coupling.emission_adjoint, cross],
            [cross.T, coupling.view_adjoint @ V.multiply((d**2 * inverse)[:, None]).tocsr()],
        ],
        format="csr",
    )
    n_lit = H.shape[1]
    M = np.block([[problem.returned, H.T], [H, np.zeros((H.shape[0], H.shape[0]))]])
    U_right = np.concatenate([S @ right, coupling.view_adjoint @ (d * right)])
    # C and M are symmetric, C sparse.
    z = solve(np.eye(len(M)) + (C @ M).T, M @ U_right, check_finite=False)
    return np.asarray(right - inverse * (coupling.emission_adjoint @ z[:n_lit] + d * (V @ z[n_lit:])))


def _searched(problem: _Problem, state: _State, step: FloatArray) -> _State | None:
    """Armijo's rule along the projected path; None if nothing descends."""
    share = 1.0
    while share > 1e-4:
        p = np.clip(state.p + share * step, problem.lower, problem.upper)
        residual = problem.forward(p) - problem.target
        decrease = float(state.gradient @ (p - state.p))
        objective = float(residual @ residual) / 2
        if objective < state.objective and objective <= state.objective + 1e-4 * decrease:
            return problem.at(p)
        share /= 2
    return None
