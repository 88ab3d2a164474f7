"""Levenberg-Marquardt on the normal equations with robust weights, for few unknowns and many residuals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calibration.arrays import FloatArray

Residual = Callable[[FloatArray], FloatArray]
"""Unknowns (n,) → residuals (N, d), d of them a point [px]; may have `jacobian`, unknowns → (n, N, d)."""

_STEP = 1e-6
"""Of a forward difference: unknowns are of order 1, so half of float64's digits are left for the slope."""
_LARGEST_DAMPING = 1e8
"""Beyond, a step no longer changes anything: the fit is at its end."""


@dataclass(frozen=True, eq=False)
class Priors:
    """What is known beforehand: each unknown's expected value and standard deviation (infinite: nothing)."""

    expected: FloatArray
    sigma: FloatArray
    weight: float
    """What one standard deviation costs: this times the square of a residual of 1 px. [1]"""

    def cost(self, z: FloatArray) -> float:
        """Weighted sum of squares."""
        return float(self.weight * (((z - self.expected) / self.sigma) ** 2).sum())


@dataclass(frozen=True, eq=False, kw_only=True)
class Fit:
    """Solution, and what its covariance is made of; that is computed when it is asked for."""

    z: FloatArray
    residual: FloatArray
    """(N, d) at the solution. [px]"""
    priors: Priors
    function: Residual
    least_scale_px: float

    @cached_property
    def jacobian(self) -> FloatArray:
        """(n, N, d) at the solution."""
        return _jacobian(self.function, self.z, self.residual)

    @cached_property
    def weight(self) -> FloatArray:
        """(N,) robust weights, 1 for a perfect point."""
        return _weight(self.residual, _scale(self.residual, self.least_scale_px))

    @property
    def cost(self) -> float:
        """What was minimised, priors included. [px²]."""
        return _cost(self.residual, _scale(self.residual, self.least_scale_px)) + self.priors.cost(self.z)

    @cached_property
    def hessian(self) -> FloatArray:
        """(n, n) of half the cost, priors included."""
        return _normal_equations(self.jacobian, self.residual, self.weight, z=self.z, priors=self.priors)[0]


def robust_fit(residual: Residual, start: FloatArray, priors: Priors, *, iterations: int, least_scale_px: float) -> Fit:
    """Minimise Σ s² log(1 + |r|²/s²) + priors; s follows the median residual down to `least_scale_px`.

    The scale that follows keeps a bad start from being taken for outliers. Cauchy's loss and Levenberg-Marquardt as
    in B. Triggs et al., Bundle adjustment - a modern synthesis, 1999.
    """
    z, damping = start, 1e-3
    error = residual(z)
    for _ in range(iterations):
        scale = _scale(error, least_scale_px)
        jacobian = _jacobian(residual, z, error)
        hessian, gradient = _normal_equations(jacobian, error, _weight(error, scale), z=z, priors=priors)
        cost = _cost(error, scale) + priors.cost(z)
        improved = False
        while not improved and damping < _LARGEST_DAMPING:
            step = _solve(hessian, gradient, damping)
            trial = residual(z - step)
            gain = cost - _cost(trial, scale) - priors.cost(z - step)
            improved = gain > 0
            damping = max(damping / 10, 1e-9) if improved else damping * 10
        if not improved:
            break
        z, error = z - step, trial
        if gain < 1e-9 * cost:
            break
    return Fit(z=z, residual=error, priors=priors, function=residual, least_scale_px=least_scale_px)


def _scale(error: FloatArray, least_px: float) -> float:
    return max(least_px, 2 * float(np.median(np.linalg.norm(error, axis=1))))


def _weight(error: FloatArray, scale: float) -> FloatArray:
    return np.asarray(1 / (1 + (error**2).sum(axis=1) / scale**2))


def _cost(error: FloatArray, scale: float) -> float:
    return float(scale**2 * np.log1p((error**2).sum(axis=1) / scale**2).sum())


def _jacobian(residual: Residual, z: FloatArray, error: FloatArray) -> FloatArray:
    """(n, N, d): the function's own derivative, or forward differences; unknowns are of order 1."""
    derivative = getattr(residual, "jacobian", None)
    if derivative is not None:
        return np.asarray(derivative(z))
    jacobian = np.empty((len(z), *error.shape))
    for k in range(len(z)):
        moved = z.copy()
        moved[k] += _STEP
        jacobian[k] = (residual(moved) - error) / _STEP
    return jacobian


def _normal_equations(
    jacobian: FloatArray, error: FloatArray, weight: FloatArray, *, z: FloatArray, priors: Priors
) -> tuple[FloatArray, FloatArray]:
    flat = (jacobian * np.sqrt(weight)[:, None]).reshape(len(z), -1)
    hessian = flat @ flat.T + np.diag(priors.weight / priors.sigma**2)
    gradient = (
        flat @ (error * np.sqrt(weight)[:, None]).ravel() + priors.weight * (z - priors.expected) / priors.sigma**2
    )
    return hessian, gradient


def _solve(hessian: FloatArray, gradient: FloatArray, damping: float) -> FloatArray:
    diagonal = np.diag(hessian)
    damped = hessian + np.diag(damping * diagonal + 1e-12 * diagonal.max())
    return np.asarray(np.linalg.solve(damped, gradient))
