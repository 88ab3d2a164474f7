"""The radiosity system (I - diag(rho) F) B = E and its transpose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import cho_factor, cho_solve

from sim.errors import SimulationError
from sim.form_factors import FormFactors
from sim.scene import FloatArray

DIRECT_LIMIT = 1500
"""Up to this many patches a kept Cholesky factor (P³ / 3) costs less than a few dozen iterative solves."""


@dataclass(frozen=True)
class Accuracy:
    """What a solution leaves over."""

    residual: float
    """max |E - (I - G) B| over max |E|."""
    error_bound: float
    """Bound of max |B - B exact| over max |E|: residual / (1 - largest row sum of G), or infinite."""


class Radiosity:
    """The radiosity system of a scene, solved for any number of right-hand sides.

    With M = sqrt(rho/A) K sqrt(rho/A), where K = A F is symmetric, the solution is B = E + sqrt(rho/A) y with
    (I - M) y = sqrt(rho/A) K E. M stays symmetric where rho is 0. A Cholesky factor is kept up to 1,500
    patches, and beyond once a call brings many right-hand sides (P³ / 3 against 16 products of 2 P² each);
    otherwise conjugate gradients run on all right-hand sides together.

    Parameters
    ----------
    form_factors : FormFactors
    reflectance : float or (P,)

    Raises
    ------
    SimulationError
        If a reflectance lies outside 0 ... 1, or if the spectral radius of G = diag(rho) F reaches 1, so that
        the light would never fade (the paper's quadrature at rho > 0.9807 in its room).
    """

    def __init__(self, form_factors: FormFactors, reflectance: ArrayLike, tolerance: float = 1e-12) -> None:
        n = len(form_factors.areas)
        rho = np.asarray(reflectance, dtype=np.float64)
        if rho.shape not in ((), (n,)):
            raise SimulationError(f"reflectance of shape {rho.shape} for {n} patches; one number or one a patch")
        if not ((rho >= 0) & (rho <= 1)).all():
            raise SimulationError(f"reflectance {rho.min():.4g} ... {rho.max():.4g}; it must lie in 0 ... 1")
        self.form_factors = form_factors
        self.reflectance: FloatArray = np.broadcast_to(rho, (n,)).copy()
        self.tolerance = tolerance
        self._scale: FloatArray = np.sqrt(self.reflectance / form_factors.areas)
        self._row_sum_max = float((self.reflectance * form_factors.row_sums).max())
        if self._row_sum_max >= 1 and (radius := self.spectral_radius()) >= 1 - 1e-12:
            raise SimulationError(
                f"spectral radius of rho F is {radius:.6f}, the limit is 1: the light never fades "
                f"(form factors: {form_factors.method}); lower the reflectance or use method 'closed_form'"
            )

    @property
    def n_patches(self) -> int:
        """Number of patches, P."""
        return len(self.reflectance)

    def solve(self, E: ArrayLike) -> FloatArray:
        """Radiosity B of the emission E, (P,) or (P, K)."""
        E = self._checked(E)
        scale, areas = self._columns(E)
        right = scale * areas * (self.form_factors.matrix @ E)
        return np.asarray(E + scale * self._solve_symmetric(right))

    def solve_adjoint(self, e: ArrayLike) -> FloatArray:
        """Solve the transposed system (I - G)ᵀ x = e for x, (P,) or (P, K)."""
        e = self._checked(e)
        scale, areas = self._columns(e)
        y = self._solve_symmetric(scale * e)
        return np.asarray(e + areas * (self.form_factors.matrix @ (scale * y)))

    def gather(self, B: FloatArray) -> FloatArray:
        """G B = rho F B: the light that B sends to every patch and that is reflected there."""
        rho = self.reflectance if B.ndim == 1 else self.reflectance[:, None]
        return np.asarray(rho * (self.form_factors.matrix @ B))

    def accuracy(self, B: FloatArray, E: FloatArray) -> Accuracy:
        """Residual and error bound of a solution."""
        scale = max(float(np.abs(E).max()), np.finfo(float).tiny)
        residual = float(np.abs(E - B + self.gather(B)).max()) / scale
        slack = 1 - self._row_sum_max
        return Accuracy(residual, residual / slack if slack > 0 else np.inf)

    def spectral_radius(self, iterations: int = 1000, tolerance: float = 1e-12) -> float:
        """Spectral radius of G = diag(rho) F by power iteration on the symmetric form."""
        x = self._scale * self.form_factors.areas
        norm = float(np.linalg.norm(x))
        radius = 0.0
        for _ in range(iterations):
            if norm == 0:
                return 0.0
            x = self._multiply(x / norm)
            previous, radius = radius, float(np.linalg.norm(x))
            if abs(radius - previous) <= tolerance * radius:
                break
            norm = radius
        return radius

    def _multiply(self, x: FloatArray) -> FloatArray:
        scale, areas = self._columns(x)
        return np.asarray(scale * areas * (self.form_factors.matrix @ (scale * x)))

    def _columns(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        scale, areas = self._scale, self.form_factors.areas
        return (scale, areas) if x.ndim == 1 else (scale[:, None], areas[:, None])

    def _checked(self, E: ArrayLike) -> FloatArray:
        values = np.asarray(E, dtype=np.float64)
        if values.ndim not in (1, 2) or len(values) != self.n_patches:
            raise SimulationError(f"right-hand side of shape {values.shape} for {self.n_patches} patches")
        return values

    def _solve_symmetric(self, right: FloatArray) -> FloatArray:
        columns = 1 if right.ndim == 1 else right.shape[1]
        if self.n_patches <= DIRECT_LIMIT or "_factor" in self.__dict__ or 96 * columns > self.n_patches:
            return np.asarray(cho_solve(self._factor, right, check_finite=False))
        return _conjugate_gradients(lambda x: x - self._multiply(x), right, self.tolerance)

    @cached_property
    def _factor(self) -> tuple[FloatArray, bool]:
        K = self.form_factors.areas[:, None] * self.form_factors.matrix
        system = np.eye(self.n_patches) - self._scale[:, None] * K * self._scale
        factor, lower = cho_factor(system, check_finite=False)
        return np.asarray(factor), bool(lower)


def _conjugate_gradients(
    multiply: Callable[[FloatArray], FloatArray], right: FloatArray, tolerance: float, limit: int = 2000
) -> FloatArray:
    """Solve a symmetric positive system for every column until its residual is ``tolerance`` of its norm."""
    x, r = np.zeros_like(right), right.copy()
    p, rr = r, (r * r).sum(axis=0)
    goal = tolerance**2 * rr
    for _ in range(limit):
        if (rr <= goal).all():
            return x
        Ap = multiply(p)
        curvature = (p * Ap).sum(axis=0)
        # A column that has converged exactly has p = 0: leave it where it is.
        step = np.divide(rr, curvature, out=np.zeros_like(rr), where=curvature > 0)
        x, r = x + step * p, r - step * Ap
        before, rr = rr, (r * r).sum(axis=0)
        p = r + np.divide(rr, before, out=np.zeros_like(rr), where=before > 0) * p
    worst = float(np.sqrt((rr / np.maximum(goal, np.finfo(float).tiny)).max()) * tolerance)
    raise SimulationError(
        f"conjugate gradients: relative residual {worst:.1e} after {limit} steps, wanted {tolerance:.0e}; "
        "the reflectance is too close to 1 for this tolerance"
    )


def jacobi(G: FloatArray, E: FloatArray, tolerance: float = 1e-10, limit: int = 20_000) -> tuple[FloatArray, int]:
    """Solve (I - G) B = E by Jacobi's iteration (eq. 6), a bounce of light a step; returns B, steps."""
    B = E.copy()
    for step in range(1, limit + 1):
        previous, B = B, E + G @ B
        if np.abs(B - previous).max() <= tolerance * np.abs(E).max():
            return B, step
    raise SimulationError(f"Jacobi: not within {tolerance:.0e} after {limit} steps; the spectral radius is near 1")


def gauss_seidel(G: FloatArray, E: FloatArray, tolerance: float = 1e-10, limit: int = 5_000) -> tuple[FloatArray, int]:
    """Solve (I - G) B = E by Gauss and Seidel's iteration (eq. 6); returns B, sweeps."""
    B = E.copy()
    for sweep in range(1, limit + 1):
        largest = 0.0
        for i, row in enumerate(G):
            value = (E[i] + row @ B - row[i] * B[i]) / (1 - row[i])
            largest, B[i] = max(largest, abs(value - B[i])), value
        if largest <= tolerance * np.abs(E).max():
            return B, sweep
    raise SimulationError(
        f"Gauss-Seidel: not within {tolerance:.0e} after {limit} sweeps; the spectral radius is near 1"
    )
