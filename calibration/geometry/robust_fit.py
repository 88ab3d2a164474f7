"""Levenberg-Marquardt on the normal equations with robust weights, for few unknowns and many residuals."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calibration.arrays import FloatArray

Residual = Callable[[FloatArray], FloatArray]
"""Unknowns (n,) → residuals (N, d), d of them a point [px]; may have `jacobian`, unknowns → (n, N, d)."""

_STEP = 1e-6
"""Of a forward difference: unknowns are of order 1, so half of float64's digits are left for the slope."""
_LEAST_DAMPING = 1e-13
"""Of the unknowns' own curvature. Where two walls are all that is seen, focal lengths and distances lie in a valley
whose curvature is 1e-9 of theirs: damped by as much, each step goes half of the way that is left, or less."""
_SECOND_STEP = 0.1
"""Of a step, over which the residuals' second derivative along it is taken."""
_MOST_BENT = 0.375
"""Of the straight step's length: beyond, the second order is no small correction (2 |a| / |v| < 0.75 in the paper)."""
_LARGEST_DAMPING = 1e8
"""Beyond, a step no longer changes anything: the fit is at its end."""


@dataclass(frozen=True, eq=False)
class Priors:
    """What is known beforehand of the unknowns: expected values, and how surely."""

    expected: FloatArray
    precision: FloatArray
    """(n, n) inverse of their covariance; zero rows of what nothing is known of."""
    weight: float
    """What one standard deviation costs: this times the square of a residual of 1 px. [1]"""

    @classmethod
    def independent(cls, expected: FloatArray, sigma: FloatArray, weight: float) -> Priors:
        """Of unknowns that are known one by one, each with a standard deviation (infinite: nothing)."""
        return cls(expected, np.diag(1 / sigma**2), weight)

    def cost(self, z: FloatArray) -> float:
        """Weighted sum of squares."""
        off = z - self.expected
        return float(self.weight * (off @ self.precision @ off))

    @cached_property
    def spread(self) -> FloatArray:
        """(n, n) what standard normal deviates are multiplied by to be drawn from it; zero where nothing is known."""
        known = np.flatnonzero(np.diag(self.precision) > 0)
        within = np.ix_(known, known)
        result = np.zeros_like(self.precision)
        result[within] = np.linalg.cholesky(np.linalg.inv(self.precision[within]))
        return result


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
    in B. Triggs et al., Bundle adjustment - a modern synthesis, 1999. Where two walls are all that is seen, focal
    lengths and distances lie along a bent valley, in which straight steps stay short: these bend with it
    (M. Transtrum and J. Sethna, Improvements to the Levenberg-Marquardt algorithm, arXiv:1201.5885, 2012).
    """
    z, damping = start, 1e-3
    error = residual(z)
    for _ in range(iterations):
        scale = _scale(error, least_scale_px)
        at = _Slope.at(residual, z, error, priors=priors, scale=scale)
        cost = _cost(error, scale) + priors.cost(z)
        improved = False
        while not improved and damping < _LARGEST_DAMPING:
            for step in at.steps(damping):
                trial = residual(z - step)
                gain = cost - _cost(trial, scale) - priors.cost(z - step)
                improved = gain > 0
                if improved:
                    break
            damping = max(damping / 10, _LEAST_DAMPING) if improved else damping * 10
        if not improved:
            break
        z, error = z - step, trial
        if gain < 1e-9 * cost:
            break
    return Fit(z=z, residual=error, priors=priors, function=residual, least_scale_px=least_scale_px)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Slope:
    """The problem around one place, from which steps of any damping follow."""

    residual: Residual
    z: FloatArray
    error: FloatArray
    jacobian: FloatArray
    weight: FloatArray
    hessian: FloatArray
    gradient: FloatArray

    @classmethod
    def at(cls, residual: Residual, z: FloatArray, error: FloatArray, *, priors: Priors, scale: float) -> _Slope:
        jacobian, weight = _jacobian(residual, z, error), _weight(error, scale)
        hessian, gradient = _normal_equations(jacobian, error, weight, z=z, priors=priors)
        return cls(
            residual=residual,
            z=z,
            error=error,
            jacobian=jacobian,
            weight=weight,
            hessian=hessian,
            gradient=gradient,
        )

    def steps(self, damping: float) -> Iterator[FloatArray]:
        """Yield the step that bends with the residuals, unless it bends too much, then the straight one."""
        straight = self._solved(self.gradient, damping)
        moved = self.residual(self.z - _SECOND_STEP * straight)
        flat = self.jacobian.reshape(len(self.z), -1)
        by_step = (straight @ flat).reshape(self.error.shape)
        second = 2 / _SECOND_STEP * ((moved - self.error) / _SECOND_STEP + by_step)
        pull = flat @ (second * self.weight[:, None]).ravel()
        bend = 0.5 * self._solved(pull, damping)
        if _size(self.hessian, bend) < _MOST_BENT * _size(self.hessian, straight):
            yield straight + bend
        yield straight

    @cached_property
    def _units(self) -> FloatArray:
        """(n,) of the unknowns, by their own curvature."""
        return np.asarray(1 / np.sqrt(np.maximum(np.diag(self.hessian), 1e-300)))

    @cached_property
    def _in_units(self) -> FloatArray:
        return np.asarray(self.hessian * np.outer(self._units, self._units))

    def _solved(self, gradient: FloatArray, damping: float) -> FloatArray:
        damped = self._in_units.copy()
        np.einsum("kk->k", damped)[:] += damping
        return np.asarray(self._units * np.linalg.solve(damped, self._units * gradient))


def _size(hessian: FloatArray, step: FloatArray) -> float:
    """Length of a step, each unknown measured by its own curvature."""
    return float(np.sqrt((np.diag(hessian) * step**2).sum()))


def _squared(error: FloatArray) -> FloatArray:
    """(N,) squared lengths; a sum along so short an axis takes several times as long."""
    return np.asarray(np.einsum("nd,nd->n", error, error))


def _scale(error: FloatArray, least_px: float) -> float:
    return max(least_px, 2 * float(np.median(np.sqrt(_squared(error)))))


def _weight(error: FloatArray, scale: float) -> FloatArray:
    return np.asarray(1 / (1 + _squared(error) / scale**2))


def _cost(error: FloatArray, scale: float) -> float:
    return float(scale**2 * np.log1p(_squared(error) / scale**2).sum())


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
    root = np.sqrt(weight)[:, None]
    flat = (jacobian * root).reshape(len(z), -1)
    hessian = flat @ flat.T + priors.weight * priors.precision
    pull = priors.weight * priors.precision @ (z - priors.expected)
    gradient = flat @ (error * root).ravel() + pull
    return hessian, gradient
