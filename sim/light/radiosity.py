"""The radiosity system (I - diag(rho) F) B = E and its transpose."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import cho_factor, cho_solve

from sim.arguments import array_of
from sim.arrays import FloatArray
from sim.errors import SimulationError
from sim.form_factors import FormFactors
from sim.light.solvers import TINY, Iterate, conjugate_gradients, gauss_seidel, jacobi, refined

__all__ = ["Accuracy", "FormFactorOperator", "Radiosity", "Solution", "gauss_seidel", "jacobi"]

Solver = Literal["auto", "repeated", "conjugate_gradients", "direct"]
Precision = Literal["double", "mixed"]
DIRECT_LIMIT = 4000
"""Up to this many patches a kept Cholesky factor (P³ / 3) pays after a few dozen right-hand sides: in a room of 1,482
after 48, of 2,304 after 24 (there 0.35 s for the factor, then 6.5 ms a call instead of 21.7, on one core); of 4,000 it
takes 128 MB."""
RIGHT_HAND_SIDES = 96
"""Beyond P / 96 columns in one call the factor costs less than a few products with F for each."""


class FormFactorOperator(Protocol):
    """Form factors as the solver needs them: dense or compressed."""

    @property
    def areas(self) -> FloatArray:
        """(P,) patch areas [m²]."""
        ...

    @property
    def row_sums(self) -> FloatArray:
        """(P,) row sums of F."""
        ...

    @property
    def closure_max(self) -> float:
        """Closed scene: largest |row sum - 1|. Any other: largest excess of a row sum over 1."""
        ...

    @property
    def method(self) -> str:
        """How they were made."""
        ...

    def apply(self, x: FloatArray) -> FloatArray:
        """Return F x for x (P,) or (P, K)."""
        ...

    def exchange(self, x: FloatArray) -> FloatArray:
        """Return diag(A) F x for x (P,) or (P, K)."""
        ...


@dataclass(frozen=True)
class Accuracy:
    """What a solution leaves over."""

    residual: float
    """max |E - (I - G) B| over max |E|."""
    error_bound: float
    """Bound of max |B - B exact| over max |E|; B exact is the solution with these form factors. May be infinite."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Solution:
    """A radiosity, how it was found, and how far off it can be."""

    B: FloatArray
    """(P,) or (P, K)."""
    residual: float
    """As in :class:`Accuracy`."""
    error_bound: float
    iterations: int
    """0 for the direct solver."""
    products: int
    """Products with F in double precision, for right-hand side and iterations."""
    products_single: int


class Radiosity:
    """The radiosity system of a scene, solved for any number of right-hand sides.

    With M = sqrt(rho/A) K sqrt(rho/A), where K = A F is symmetric, the solution is B = E + sqrt(rho/A) y with
    (I - M) y = sqrt(rho/A) K E. M stays symmetric where rho is 0.

    Parameters
    ----------
    form_factors : FormFactors, CompressedFormFactors or any other :class:`FormFactorOperator`
    reflectance : float or (P,) array
        In [0, 1].
    tolerance : float
        Residual of the iterations over the norm of the right-hand side.
    solver : {"auto", "repeated", "conjugate_gradients", "direct"}
        ``auto``: conjugate gradients, and a Cholesky factor for a call with more than P / 96 right-hand sides.
        ``repeated``: the factor up to 4,000 patches whatever the call, for hundreds of calls.
    precision : {"double", "mixed"}
        ``mixed``: conjugate gradients in a copy of F in single precision, refined in double.

    Raises
    ------
    SimulationError
        If a reflectance lies outside 0 ... 1, or if the spectral radius of G = diag(rho) F reaches 1, so that
        the light would never fade (the paper's quadrature at rho > 0.9807 in its room).
    """

    def __init__(
        self,
        form_factors: FormFactorOperator,
        reflectance: ArrayLike,
        *,
        tolerance: float = 1e-12,
        solver: Solver = "auto",
        precision: Precision = "double",
    ) -> None:
        n = len(form_factors.areas)
        rho = array_of("reflectance", reflectance)
        if rho.shape not in ((), (n,)):
            raise SimulationError(f"reflectance of shape {rho.shape} for {n} patches; one number or one a patch")
        if not ((rho >= 0) & (rho <= 1)).all():
            raise SimulationError(f"reflectance {rho.min():.4g} ... {rho.max():.4g}; it must lie in 0 ... 1")
        self.form_factors = form_factors
        self.reflectance: FloatArray = np.broadcast_to(rho, (n,)).copy()
        self.tolerance = tolerance
        self._scale: FloatArray = np.sqrt(self.reflectance / form_factors.areas)
        self._repeated = solver == "repeated" and n <= DIRECT_LIMIT
        self._solver, self._precision = solver, precision
        self._check_choices()
        row_sum_max = float((self.reflectance * form_factors.row_sums).max())
        if row_sum_max >= 1 - 1e-9 and (radius := self.spectral_radius()) >= 1 - 1e-12:
            raise SimulationError(
                f"spectral radius of rho F is {radius:.6f}, the limit is 1: the light never fades "
                f"(form factors: {form_factors.method}); lower the reflectance or use method 'closed_form'"
            )

    def _check_choices(self) -> None:
        if self._solver not in ("auto", "repeated", "conjugate_gradients", "direct"):
            raise SimulationError(
                f"unknown solver {self._solver!r}; there are auto, repeated, conjugate_gradients, direct"
            )
        if self._precision not in ("double", "mixed"):
            raise SimulationError(f"unknown precision {self._precision!r}; there are double, mixed")
        dense = isinstance(self.form_factors, FormFactors)
        if not dense and (self._solver == "direct" or self._precision == "mixed"):
            raise SimulationError(
                f"{self.form_factors.method} form factors have no dense matrix to factorise or copy; "
                "use solver 'conjugate_gradients', precision 'double'"
            )

    @property
    def n_patches(self) -> int:
        """Number of patches, P."""
        return len(self.reflectance)

    def solve(self, E: ArrayLike) -> FloatArray:
        """Return the radiosity B of an emission E (eq. 6).

        Parameters
        ----------
        E : (P,) or (P, K) array
            Light that each patch sends back of what the projector sends to it, a column for each of K lights.

        Returns
        -------
        (P,) or (P, K) array
            In the unit of E.

        Raises
        ------
        SimulationError
            For an array of another shape, or iterations that do not reach the tolerance.

        References
        ----------
        Dehos, Zéghers, Sarry, Rousselle and Renaud, Virtual Reality 18(2), 2014; equations 1, 2 and 6.
        """
        E = self._checked(E)
        y = self._solve_symmetric(self._right(E))
        return np.asarray(E + self._column(self._scale, y) * y)

    def solution(self, E: ArrayLike) -> Solution:
        """Return the radiosity of an emission with its accuracy and what it took.

        Parameters
        ----------
        E : (P,) or (P, K) array
            As for :meth:`solve`.

        Returns
        -------
        Solution

        Raises
        ------
        SimulationError
            As :meth:`solve` does.
        """
        E = self._checked(E)
        found = self._iterate(self._right(E))
        B = np.asarray(E + self._column(self._scale, E) * found.x)
        accuracy = self.accuracy(B, E)
        return Solution(
            B=B,
            residual=accuracy.residual,
            error_bound=accuracy.error_bound,
            iterations=found.iterations,
            products=found.products + 1,
            products_single=found.products_single,
        )

    def solve_adjoint(self, e: ArrayLike) -> FloatArray:
        """Return the solution x of the transposed system (I - G)ᵀ x = e.

        Parameters
        ----------
        e : (P,) or (P, K) array

        Returns
        -------
        (P,) or (P, K) array

        Raises
        ------
        SimulationError
            As :meth:`solve` does.
        """
        e = self._checked(e)
        scale = self._column(self._scale, e)
        y = self._solve_symmetric(scale * e)
        return np.asarray(e + self.form_factors.exchange(scale * y))

    def gather(self, B: FloatArray) -> FloatArray:
        """Return G B = rho F B: the light that B sends to every patch and that is reflected there.

        Parameters
        ----------
        B : (P,) or (P, K) array
            Radiosity.

        Returns
        -------
        (P,) or (P, K) array
            In the unit of B.
        """
        return np.asarray(self._column(self.reflectance, B) * self.form_factors.apply(B))

    def accuracy(self, B: FloatArray, E: FloatArray) -> Accuracy:
        """Return the residual and an error bound of a solution.

        For any positive x with G x <= gamma x, gamma < 1, the largest ``|error / x|`` is at most the largest
        ``|residual / x|`` over 1 - gamma; the roundoff of the residual itself is allowed for.

        Parameters
        ----------
        B, E : (P,) or (P, K) array
            Radiosity and the emission that it is the solution for.

        Returns
        -------
        Accuracy

        References
        ----------
        Collatz, Einschliessungssatz für die charakteristischen Zahlen von Matrizen, Mathematische Zeitschrift 48, 1942:
        the bound of the spectral radius.
        """
        scale = max(float(np.abs(E).max()), TINY)
        residual = np.abs(E - B + self.gather(B))
        x, gamma = self._contraction
        if gamma >= 1:
            return Accuracy(float(residual.max()) / scale, np.inf)
        roundoff = np.finfo(float).eps * np.sqrt(self.n_patches) * float(np.abs(B).max())
        weighted = float(((residual + roundoff) / self._column(x, B)).max())
        return Accuracy(float(residual.max()) / scale, weighted * float(x.max()) / (1 - gamma) / scale)

    def spectral_radius(self, iterations: int = 1000, tolerance: float = 1e-12) -> float:
        """Return the spectral radius of G = diag(rho) F, by power iteration on the symmetric form.

        Parameters
        ----------
        iterations : int
            At most.
        tolerance : float
            Relative change of the radius at which it ends.

        Returns
        -------
        float
            The share of the light that a bounce keeps.
        """
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

    @cached_property
    def _contraction(self) -> tuple[FloatArray, float]:
        """A positive vector and the gamma that bounds G's spectral radius from above with it."""
        x = np.ones(self.n_patches)
        gamma = float((self.reflectance * self.form_factors.row_sums).max())
        for _ in range(50):
            if gamma < 1:
                break
            # Towards the largest eigenvector, kept positive where nothing arrives.
            x = self.gather(x) + 1e-6 * x
            gamma = float((self.gather(x) / x).max())
        return x, gamma

    def _right(self, E: FloatArray) -> FloatArray:
        return np.asarray(self._column(self._scale, E) * self.form_factors.exchange(E))

    def _multiply(self, x: FloatArray) -> FloatArray:
        scale = self._column(self._scale, x)
        return np.asarray(scale * self.form_factors.exchange(scale * x))

    def _column(self, values: FloatArray, like: FloatArray) -> FloatArray:
        return values if like.ndim == 1 else values[:, None]

    def _checked(self, E: ArrayLike) -> FloatArray:
        values = array_of("right-hand side", E)
        if values.ndim not in (1, 2) or len(values) != self.n_patches:
            raise SimulationError(
                f"right-hand side of shape {values.shape} for {self.n_patches} patches; one value a patch"
            )
        return values

    def _solve_symmetric(self, right: FloatArray) -> FloatArray:
        return self._iterate(right).x

    def _iterate(self, right: FloatArray) -> Iterate:
        columns = 1 if right.ndim == 1 else right.shape[1]
        many = self._solver == "auto" and RIGHT_HAND_SIDES * columns > self.n_patches
        dense = isinstance(self.form_factors, FormFactors)
        if dense and (self._repeated or self._solver == "direct" or (many and columns > 1)):
            return Iterate(np.asarray(cho_solve(self._factor, right, check_finite=False)), 0, 0)
        if self._precision == "mixed":
            return refined(self._system, self._system_single, right, self.tolerance)
        return conjugate_gradients(self._system, right, self.tolerance)

    def _system(self, x: FloatArray) -> FloatArray:
        return x - self._multiply(x)

    def _system_single(self, x: FloatArray) -> FloatArray:
        scale = self._column(self._scale, x)
        return np.asarray(x - scale * self._single.exchange(scale * x))

    @cached_property
    def _single(self) -> FormFactors:
        return self._dense.in_single_precision()

    @cached_property
    def _factor(self) -> tuple[FloatArray, bool]:
        dense = self._dense
        K = dense.areas[:, None] * dense.matrix
        system = np.eye(self.n_patches) - self._scale[:, None] * K * self._scale
        factor, lower = cho_factor(system, check_finite=False)
        return np.asarray(factor), bool(lower)

    @property
    def _dense(self) -> FormFactors:
        if not isinstance(self.form_factors, FormFactors):
            raise SimulationError(
                f"{self.form_factors.method} form factors have no dense matrix; apply them to light instead"
            )
        return self.form_factors
