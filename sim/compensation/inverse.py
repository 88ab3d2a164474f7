"""The inverse of a transport at pixel level, found through its patches by Woodbury's identity.

With H S D⁻¹ V = L (patch to patch, so small), T⁻¹ = D⁻¹ - D⁻¹ V (I + L)⁻¹ H S D⁻¹ in every band.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.linalg import lu_factor, lu_solve
from scipy.sparse.linalg import LinearOperator, gmres

from sim.arrays import FloatArray
from sim.compensation.split_transport import SplitTransport, divide_where_lit
from sim.errors import SimulationError
from sim.light.interreflection_operator import InterreflectionOperator

DENSE_LIMIT = 4000
"""Viewed patches up to which I + L is factorised."""


@dataclass(frozen=True, eq=False)
class Inverse:
    """T⁻¹ without limits; pixels without direct light stay at 0."""

    transport: SplitTransport
    steps: list[int] = field(default_factory=list)
    """Iterations of each patch solve so far; 1 for a factorised one."""

    @property
    def iterations(self) -> int:
        """Of the longest patch solve so far."""
        return max(self.steps, default=0)

    def apply(self, c: FloatArray) -> FloatArray:
        """T⁻¹ c, (n, C): the projector image whose camera image is c."""
        return self.transport.unmixed(self._by_band(c, adjoint=False))

    def adjoint(self, p: FloatArray) -> FloatArray:
        """T⁻ᵀ p, (n, C)."""
        return self._by_band((self.transport.unmixing.T @ p.T).T, adjoint=True)

    def _by_band(self, values: FloatArray, adjoint: bool) -> FloatArray:
        return np.stack([band.apply(values[:, b], adjoint) for b, band in enumerate(self._bands)]).T

    @cached_property
    def _bands(self) -> list[_BandInverse]:
        reciprocals = divide_where_lit(np.ones_like(self.transport.diagonal), self.transport.diagonal)
        return [
            _BandInverse(each, reciprocals[:, b], self.steps) for b, each in enumerate(self.transport.interreflections)
        ]


@dataclass(frozen=True, eq=False)
class _BandInverse:
    interreflection: InterreflectionOperator
    reciprocal: FloatArray
    """(n,) 1 / D."""
    steps: list[int]

    def apply(self, values: FloatArray, adjoint: bool) -> FloatArray:
        interreflection, scaled = self.interreflection, self.reciprocal * values
        H = interreflection.patch_to_patch
        if adjoint:
            q = H.T @ self._solve(interreflection.view_adjoint @ scaled, trans=1)
            return np.asarray(scaled - self.reciprocal * (interreflection.emission_adjoint @ q))
        q = self._solve(H @ (interreflection.emission @ scaled), trans=0)
        return np.asarray(scaled - self.reciprocal * (interreflection.view @ q))

    def _solve(self, right: FloatArray, trans: int) -> FloatArray:
        if len(right) <= DENSE_LIMIT:
            self.steps.append(1)
            return np.asarray(lu_solve(self._factors, right, trans=trans, check_finite=False))
        return self._iterated(right, trans)

    @cached_property
    def _factors(self) -> tuple[FloatArray, FloatArray]:
        H = self.interreflection.patch_to_patch
        loop = self.interreflection.emission @ self.interreflection.view.multiply(self.reciprocal[:, None]).tocsr()
        factors, pivots = lu_factor(np.eye(len(H)) + (loop.T @ H.T).T, check_finite=False)
        return factors, pivots

    def _iterated(self, right: FloatArray, trans: int) -> FloatArray:
        interreflection, H = self.interreflection, self.interreflection.patch_to_patch

        def forward(q: FloatArray) -> FloatArray:
            return np.asarray(q + H @ (interreflection.emission @ (self.reciprocal * (interreflection.view @ q))))

        def backward(q: FloatArray) -> FloatArray:
            return np.asarray(
                q + interreflection.view_adjoint @ (self.reciprocal * (interreflection.emission_adjoint @ (H.T @ q)))
            )

        steps: list[float] = []
        operator = LinearOperator(
            (len(right), len(right)), matvec=backward if trans else forward, dtype=np.dtype(np.float64)
        )
        q, failed = gmres(operator, right, rtol=1e-10, restart=100, callback=steps.append, callback_type="pr_norm")
        if failed:
            raise SimulationError(
                f"exact compensation: GMRES not at 1e-10 after {len(steps)} steps; use the bounded strategy"
            )
        self.steps.append(len(steps))
        return np.asarray(q)
