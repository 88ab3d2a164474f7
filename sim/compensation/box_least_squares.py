"""Least squares over a box, for light transports: active sets, conjugate gradients, and a certificate.

Minimises ½ (T p - c)ᵀ Ω (T p - c) over lower <= p <= upper, T = D K + V H S K, Ω a metric at each pixel (the identity
unless the error is weighted). Pixels meet only through the patches, so TᵀΩT is a C x C block at every pixel plus a part
of patch rank; conjugate gradients, preconditioned by the blocks, see few distinct eigenvalues. A projector's blur
couples neighbours: a step then takes fewer products, and the optimum is certified to :data:`BLURRED_TOLERANCE`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sim.arrays import BoolArray, FloatArray
from sim.compensation.split_transport import SplitTransport, direct_blocks

ENOUGH = 0.3
"""Share of the certified gap that a good step leaves at most."""
DAMPING_RANGE = (1e-9, 1.0)
"""Levenberg and Marquardt's damping of a step, as a share of the curvature; starts at 1e-6."""
FLOOR = 1e-8
"""An objective below this share of the target's square counts as this share: 1e-4 of its root mean square."""
FORCING = (1e-1, 1e-2)
"""Residual that conjugate gradients leave, first and from the second step on."""
CG_LIMIT = 60
"""Products of one step at most: it bounds the time of a step; how good the image is the certificate tells."""
BLURRED_CG_LIMIT, BLURRED_DAMPING = 10, 0.1
"""The same, and the most damping, with a blur: what its eigenvalues of nearly 0 leave undone nobody sees. From random
rigs with a blur of 0.4 to 1.05 px: more products a step took longer to the same gap."""
TOLERANCE, BLURRED_TOLERANCE = 1e-6, 1e-2
"""Relative gap to stop at; 1e-2 is 0.5 % of the RMS residual, and measured errors no longer change."""
LIMIT, BLURRED_LIMIT = 60, 10
"""Most steps; with a blur above 1 px ten leave a gap of 1 to 2 %, and twenty hardly less."""
SWEEPS = 12
"""Of coordinate descent within a pixel of several channels, at most."""
CHUNK = 1 << 13
"""Pixels at a time: what the sweeps touch stays in the processor's cache."""


@dataclass(frozen=True, eq=False, kw_only=True)
class State:
    """A projector image in the box, and how far it can be from the best."""

    p: FloatArray
    residual: FloatArray
    gradient: FloatArray
    objective: float
    gap: float
    """The objective is convex, so it can fall by no more than sum max(g (p - lower), g (p - upper)), g the gradient."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BoxProblem:
    """The problem; images are (n, C)."""

    transport: SplitTransport
    target: FloatArray
    lower: float
    upper: float
    metric: FloatArray | None = None
    """(n, C, C) Ω, symmetric positive semidefinite; None: the identity."""

    def at(self, p: FloatArray) -> State:
        """Evaluate the objective, its gradient and the gap."""
        residual = self.transport.forward(p) - self.target
        weighted = self.weighted(residual)
        gradient = self.transport.adjoint(weighted)
        gap = np.maximum(gradient * (p - self.lower), gradient * (p - self.upper)).sum()
        objective = float(np.vdot(residual, weighted)) / 2
        return State(p=p, residual=residual, gradient=gradient, objective=objective, gap=float(gap))

    def weighted(self, c: FloatArray) -> FloatArray:
        """Ω c."""
        return c if self.metric is None else np.einsum("nbc,nc->nb", self.metric, c)

    def hessian(self, p: FloatArray) -> FloatArray:
        """TᵀΩT p."""
        return self.transport.adjoint(self.weighted(self.transport.forward(p)))

    def relative_gap(self, state: State) -> float:
        """Gap over the objective, or over the least objective that counts."""
        return max(state.gap, 0.0) / max(state.objective, self._least, np.finfo(float).tiny)

    def shortfall(self, state: State) -> float:
        """How far, at most, the RMS residual is above the optimum, as a share."""
        share = state.gap / max(state.objective, self._least, np.finfo(float).tiny)
        return 1 - float(np.sqrt(max(1 - max(share, 0.0), 0.0)))

    def at_bounds(self, state: State) -> BoolArray:
        """Values that the gradient presses against a bound."""
        at_lower = (state.p <= self.lower) & (state.gradient >= 0)
        return np.asarray(at_lower | ((state.p >= self.upper) & (state.gradient <= 0)))

    def kkt_residual(self, state: State) -> float:
        """Length of the scaled projected gradient, relative to the target's."""
        step = np.clip(state.p - state.gradient / self.curvature, self.lower, self.upper) - state.p
        length = float(np.linalg.norm(np.sqrt(self.curvature) * step))
        return length / max(self._target_length, np.finfo(float).tiny)

    @cached_property
    def blocks(self) -> FloatArray:
        """(n, C, C) Kᵀ D Ω D K: direct light's part of TᵀΩT."""
        return direct_blocks(self.transport, self.metric)

    @cached_property
    def curvature(self) -> FloatArray:
        """(n, C) about the diagonal of TᵀΩT: direct light, and indirect light by patch."""
        total = np.einsum("ncc->nc", self.blocks) + self._indirect_curvature
        return np.asarray(np.maximum(total, max(1e-12 * float(total.max()), np.finfo(float).tiny ** 0.5)))

    @cached_property
    def _indirect_curvature(self) -> FloatArray:
        bands = []
        for b, interreflection in enumerate(self.transport.interreflections):
            H, V = interreflection.patch_to_patch, interreflection.view
            weighted = V if self.metric is None else V.multiply(self.metric[:, b, b][:, None]).tocsr()
            returned = np.einsum("wl,wl->l", H, (interreflection.view_adjoint @ weighted) @ H)
            bands.append(interreflection.emission_adjoint.power(2) @ returned)
        return np.asarray(np.stack(bands, axis=-1) @ self.transport.mixing**2)

    @property
    def is_blurred(self) -> bool:
        """Whether the projector's picture is."""
        return self.transport.blur is not None

    @cached_property
    def _target_length(self) -> float:
        return float(np.sqrt(max(float(np.vdot(self.target, self.weighted(self.target))), 0.0)))

    @cached_property
    def _least(self) -> float:
        return FLOOR * self._target_length**2 / 2


@dataclass(frozen=True, eq=False, kw_only=True)
class Optimum:
    """The best image found, and its certificate."""

    p: FloatArray
    """(n, C)."""
    at_bounds: BoolArray
    """(n, C) values that the range holds back."""
    objective: float
    steps: int
    notes: dict[str, float | str]
    """gap, kkt_residual, short_of_optimum, optimal_rms_at_least, products."""


def optimum(problem: BoxProblem, start: FloatArray, tolerance: float | None, limit: int | None) -> Optimum:
    """Improve a start (n, C) until the relative gap is within the tolerance, or the steps run out; None: the usual."""
    usual = (BLURRED_TOLERANCE, BLURRED_LIMIT) if problem.is_blurred else (TOLERANCE, LIMIT)
    tolerance, limit = (usual[0] if tolerance is None else tolerance), (usual[1] if limit is None else limit)
    state, steps, products = minimise(problem, problem.transport.sharpened(start, 1), tolerance, limit)
    notes: dict[str, float | str] = {
        "gap": problem.relative_gap(state),
        "kkt_residual": problem.kkt_residual(state),
        "short_of_optimum": problem.shortfall(state),
        "optimal_rms_at_least": (2 * max(state.objective - state.gap, 0.0) / state.p.size) ** 0.5,
        "products": products,
    }
    return Optimum(p=state.p, at_bounds=problem.at_bounds(state), objective=state.objective, steps=steps, notes=notes)


def minimise(problem: BoxProblem, start: FloatArray, tolerance: float, limit: int) -> tuple[State, int, int]:
    """Take steps; return the state, the steps, and the products with TᵀΩT inside them.

    A primal-dual active set method (Hintermüller, Ito and Kunisch, SIAM J. Optim. 13, 2002): values that
    their pixel alone would take to a bound are put there, the others take the least-squares step. Where that does not
    descend, a projected Newton or gradient step with Armijo's rule does (Bertsekas, SIAM J. Control Optim. 20, 1982).
    """
    state = problem.at(np.clip(start, problem.lower, problem.upper))
    steps, products, damping = 0, 0, 1e-6
    most = BLURRED_DAMPING if problem.is_blurred else DAMPING_RANGE[1]
    while steps < limit and problem.relative_gap(state) > tolerance:
        better, spent = _improved(problem, state, damping, FORCING[min(steps, 1)])
        products += spent
        if better is None and damping >= most:
            break
        poor = better is None or better.gap > ENOUGH * state.gap
        damping = float(np.clip(damping * (30.0 if poor else 0.1), DAMPING_RANGE[0], most))
        state, steps = better or state, steps + 1
    return state, steps, products


def _improved(problem: BoxProblem, state: State, damping: float, forcing: float) -> tuple[State | None, int]:
    """Take a step that descends: active set, projected Newton or projected gradient; None if none does."""
    local = pixel_optimum(problem, state.p, state.gradient)
    low, high = local <= problem.lower, local >= problem.upper
    moved = problem.at(np.where(low, problem.lower, np.where(high, problem.upper, state.p)))
    step, spent = _newton_step(problem, moved, ~(low | high), damping=damping, forcing=forcing)
    trial = problem.at(np.clip(moved.p + step, problem.lower, problem.upper))
    if trial.objective < state.objective and trial.gap < ENOUGH * state.gap:
        return trial, spent
    step, more = _newton_step(problem, state, ~problem.at_bounds(state), damping=damping, forcing=forcing)
    newton = _searched(problem, state, step)
    descending = [each for each in (trial, newton) if each is not None and each.objective < state.objective]
    if descending:
        return min(descending, key=lambda each: each.objective), spent + more
    return _searched(problem, state, -state.gradient / problem.curvature), spent + more


def pixel_optimum(problem: BoxProblem, p: FloatArray, gradient: FloatArray) -> FloatArray:
    """Where each pixel would go alone: the best of its C x C block in the box, by coordinate descent.

    Parameters
    ----------
    p, gradient : (n, C)
        An image in the box, and the gradient there.
    """
    x = np.empty_like(p)
    for first in range(0, len(p), CHUNK):
        part = slice(first, first + CHUNK)
        x[part] = _descended(
            problem.blocks[part].transpose(1, 2, 0).copy(),
            problem.curvature[part].T.copy(),
            p[part].T.copy(),
            gradient[part].T.copy(),
            box=(problem.lower, problem.upper),
        ).T
    return x


def _descended(
    blocks: FloatArray, curvature: FloatArray, x: FloatArray, slope: FloatArray, *, box: tuple[float, float]
) -> FloatArray:
    """Coordinate descent at each pixel; blocks (C, C, n), the others (C, n), x and slope overwritten."""
    channels, settled = len(x), 1e-3 * (box[1] - box[0])
    for _ in range(SWEEPS if channels > 1 else 1):
        largest = 0.0
        for c in range(channels):
            change = np.clip(x[c] - slope[c] / curvature[c], *box) - x[c]
            x[c] += change
            for b in range(channels):
                slope[b] += (curvature[c] if b == c else blocks[b, c]) * change
            largest = max(largest, float(np.abs(change).max(initial=0.0)))
        if largest <= settled:
            break
    return x


def _newton_step(
    problem: BoxProblem, state: State, free: BoolArray, *, damping: float, forcing: float
) -> tuple[FloatArray, int]:
    """Minimise over the free values by preconditioned conjugate gradients: (TᵀΩT + damping) step = -gradient there."""
    damped = damping * problem.curvature
    inverse = _inverse_blocks(problem, free, damped)
    residual = np.where(free, -state.gradient, 0.0)
    x = np.zeros_like(residual)
    z = np.einsum("nbc,nc->nb", inverse, residual)
    direction, rho = z, float(np.vdot(residual, z))
    enough = forcing**2 * rho
    limit = BLURRED_CG_LIMIT if problem.is_blurred else CG_LIMIT
    for count in range(limit):
        if rho <= enough:
            return x, count
        image = np.where(free, problem.hessian(direction) + damped * direction, 0.0)
        share = rho / max(float(np.vdot(direction, image)), np.finfo(float).tiny)
        x = x + share * direction
        residual = residual - share * image
        z = np.einsum("nbc,nc->nb", inverse, residual)
        rho, before = float(np.vdot(residual, z)), rho
        direction = z + rho / before * direction
    return x, limit


def _inverse_blocks(problem: BoxProblem, free: BoolArray, damped: FloatArray) -> FloatArray:
    """(n, C, C) inverse of direct light's blocks, with indirect light on their diagonals, over the free values."""
    some = np.flatnonzero(free.any(axis=1))
    blocks, loose = problem.blocks[some], free[some]
    both = loose[:, :, None] & loose[:, None, :]
    extra = (problem.curvature + damped)[some] - np.einsum("ncc->nc", blocks)
    diagonal = np.where(loose, extra, 1.0)
    blocks = np.where(both, blocks, 0.0) + diagonal[:, :, None] * np.eye(free.shape[1])
    inverse = np.zeros_like(problem.blocks)
    inverse[some] = np.where(both, np.linalg.inv(blocks), 0.0)
    return inverse


def _searched(problem: BoxProblem, state: State, step: FloatArray) -> State | None:
    """Armijo's rule along the projected path; None if nothing descends."""
    share = 1.0
    while share > 1e-4:
        trial = problem.at(np.clip(state.p + share * step, problem.lower, problem.upper))
        decrease = float(np.vdot(state.gradient, trial.p - state.p))
        if trial.objective < state.objective and trial.objective <= state.objective + 1e-4 * decrease:
            return trial
        share /= 2
    return None
