"""The exact inverse of the light transport, unlit patches eliminated (Mukaigawa et al. 2006)."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse.linalg import LinearOperator, gmres

from sim.compensation.result import Compensation, checked_target, diagonal_of, divided, finished
from sim.coupling import Coupling
from sim.errors import SimulationError
from sim.light_transport import LightTransport
from sim.scene import FloatArray

DENSE_LIMIT = 4000


def exact(transport: LightTransport, target: ArrayLike, lower: float = 0.0, upper: float = 1.0) -> Compensation:
    """Project T⁻¹ c, exact at pixel level, then clamped.

    By Woodbury's identity: (I + H S D⁻¹ V) q = H S D⁻¹ c and p = D⁻¹ (c - V q), where H = (I - G)⁻¹ G and q
    is the interreflection of the viewed patches. Patches that no pixel lights have no emission, and what they
    return is subtracted. Pixels without direct light stay at 0.
    """
    started = time.perf_counter()
    c = checked_target(transport, target, lower, upper)
    diagonal = diagonal_of(transport)
    wanted, iterations = unbounded(transport.coupling, diagonal, c)
    return finished(transport, c, wanted, lower, upper, time.perf_counter() - started, iterations)


def unbounded(coupling: Coupling, diagonal: FloatArray, c: FloatArray) -> tuple[FloatArray, int]:
    """Solve T p = c without limits; returns p and the number of solves or iterations."""
    H, S, V = coupling.interreflection, coupling.emission, coupling.view
    inverse = divided(np.ones_like(diagonal), diagonal)
    right = H @ (S @ (inverse * c))
    n = len(right)
    if n <= DENSE_LIMIT:
        loop = (S @ V.multiply(inverse[:, None]).tocsr()).toarray()
        q, iterations = np.linalg.solve(np.eye(n) + H @ loop, right), 1
    else:
        q, iterations = _iterated(coupling, inverse, right)
    return inverse * (c - V @ q), iterations


def _iterated(coupling: Coupling, inverse: FloatArray, right: FloatArray) -> tuple[FloatArray, int]:
    H, S, V = coupling.interreflection, coupling.emission, coupling.view
    steps: list[float] = []
    operator = LinearOperator(
        (len(right), len(right)),
        matvec=lambda q: q + H @ (S @ (inverse * (V @ q))),
        dtype=np.dtype(np.float64),
    )
    q, failed = gmres(operator, right, rtol=1e-10, restart=100, callback=steps.append, callback_type="pr_norm")
    if failed:
        raise SimulationError(
            f"exact compensation: GMRES not at 1e-10 after {len(steps)} steps; use the bounded strategy"
        )
    return np.asarray(q), len(steps)
