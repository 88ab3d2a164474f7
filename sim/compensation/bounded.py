"""The best image that the projector's range allows: bounded least squares with a certificate."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import solve
from scipy.sparse import csr_array

from sim.compensation.exact import unbounded
from sim.compensation.result import Compensation, checked_target, diagonal_of, finished
from sim.coupling import Coupling
from sim.errors import SimulationError
from sim.light_transport import LightTransport
from sim.scene import BoolArray, FloatArray

DAMPING = 1e-8
"""Added to D², as a share of its largest entry, so that pixels almost without direct light do no harm."""


def bounded(
    transport: LightTransport,
    target: ArrayLike,
    lower: float = 0.0,
    upper: float = 1.0,
    tolerance: float = 1e-3,
    limit: int = 100,
) -> Compensation:
    """Minimise ||T p - c||² over lower <= p <= upper, to a certified share of the optimum.

    Projected Newton (Bertsekas, SIAM J. Control Optim. 20, 1982): pixels held at a bound by the gradient stay
    there, the others take the exact least-squares step, found through the patches by Woodbury's identity,
    since TᵀT is diagonal plus a matrix of rank 2 P. The objective is convex, so it can fall by no more than
    the gap sum max(g (p - lower), g (p - upper)), g the gradient: that is the certificate.

    Parameters
    ----------
    tolerance : float
        Stop once the RMS residual is proven to be within this share of the optimum.

    Returns
    -------
    Compensation
        Its notes hold ``kkt_residual`` (relative, 0 at the optimum) and ``optimal_rms_at_least``.

    Raises
    ------
    SimulationError
        If the steps run out before the certificate holds.
    """
    started = time.perf_counter()
    c = checked_target(transport, target, lower, upper)
    problem = _Problem(transport.coupling, diagonal_of(transport), c, lower, upper)
    p = np.clip(unbounded(problem.coupling, problem.diagonal, c)[0], lower, upper)
    state = problem.at(p)
    iterations = 0
    while not problem.certified(state, tolerance):
        if iterations == limit:
            raise SimulationError(
                f"bounded compensation: {problem.short(state):.1e} from the optimum after {limit} steps, "
                f"wanted {tolerance:.0e}; allow more steps or a larger tolerance"
            )
        state = _searched(problem, state, _newton_step(problem, state))
        iterations += 1
    at_bound = problem.held(state)
    notes = {
        "kkt_residual": problem.kkt_residual(state),
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

    def forward(self, p: FloatArray) -> FloatArray:
        return self.diagonal * p + self.coupling.apply(p)

    def at(self, p: FloatArray) -> _State:
        residual = self.forward(p) - self.target
        gradient = self.diagonal * residual + self.coupling.adjoint(residual)
        gap = np.maximum(gradient * (p - self.lower), gradient * (p - self.upper)).sum()
        return _State(p, residual, gradient, float(residual @ residual) / 2, float(gap))

    def certified(self, state: _State, tolerance: float) -> bool:
        negligible = 1e-20 * float(self.target @ self.target)
        return state.objective <= negligible or self.short(state) <= tolerance

    def short(self, state: _State) -> float:
        """How far, at most, the RMS residual is above the optimum, as a share."""
        return 1 - float(np.sqrt(max(1 - state.gap / max(state.objective, 1e-300), 0.0)))

    def held(self, state: _State) -> BoolArray:
        """Pixels that the gradient presses against a bound."""
        at_lower = (state.p <= self.lower) & (state.gradient >= 0)
        return np.asarray(at_lower | ((state.p >= self.upper) & (state.gradient <= 0)))

    def kkt_residual(self, state: _State) -> float:
        """Length of the scaled projected gradient, relative to the target's."""
        scale = np.maximum(self.diagonal, 1e-6 * self.diagonal.max())
        step = np.clip(state.p - state.gradient / scale**2, self.lower, self.upper) - state.p
        return float(np.linalg.norm(scale * step)) / max(float(np.linalg.norm(self.target)), 1e-300)


def _newton_step(problem: _Problem, state: _State) -> FloatArray:
    """Minimise the least squares over the free pixels: (TᵀT + damping)_FF step_F = -g_F.

    (TᵀT)_FF = D² + U M Uᵀ with U = [Sᵀ, D V]_F and M = [[Hᵀ Vᵀ V H, Hᵀ], [H, 0]], V over all pixels.
    """
    free = ~problem.held(state)
    coupling, d = problem.coupling, problem.diagonal
    inverse = np.where(free, 1 / (d**2 + DAMPING * d.max() ** 2), 0.0)
    H, S, V = coupling.interreflection, coupling.emission, coupling.view
    right = -state.gradient * inverse
    S_scaled, V_scaled = S.multiply(inverse).tocsr(), V.multiply((d * inverse)[:, None]).tocsr()
    C = np.block(
        [
            [_dense(S_scaled, coupling.emission_adjoint), _dense(S, V_scaled)],
            [
                _dense(S, V_scaled).T,
                _dense(coupling.view_adjoint, V.multiply((d**2 * inverse)[:, None]).tocsr()),
            ],
        ]
    )
    VtV_H = (coupling.view_adjoint @ V) @ H
    n_lit = H.shape[1]
    M = np.block([[H.T @ VtV_H, H.T], [H, np.zeros((H.shape[0], H.shape[0]))]])
    U_right = np.concatenate([S @ right, coupling.view_adjoint @ (d * right)])
    z = solve(np.eye(len(M)) + M @ C, M @ U_right, check_finite=False)
    return np.asarray(right - inverse * (coupling.emission_adjoint @ z[:n_lit] + d * (V @ z[n_lit:])))


def _dense(left: csr_array, right: csr_array) -> FloatArray:
    return np.asarray((left @ right).toarray())


def _searched(problem: _Problem, state: _State, step: FloatArray) -> _State:
    """Armijo's rule along the projected path."""
    share = 1.0
    while share > 1e-6:
        p = np.clip(state.p + share * step, problem.lower, problem.upper)
        residual = problem.forward(p) - problem.target
        decrease = float(state.gradient @ (p - state.p))
        if float(residual @ residual) / 2 <= state.objective + 1e-4 * decrease:
            return problem.at(p)
        share /= 2
    raise SimulationError(
        "bounded compensation: no descent along the Newton step; the transport is ill-posed"
    )
