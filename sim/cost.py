"""What a model costs: seconds and memory from its size, for the machine that is running.

Form factors cost a time a pair that is measured while the plan is made, with the scene's own faces and
occluders. Solving is bound by reading the matrix once for each of the solver's products; that speed comes from
a probe of a few milliseconds.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sim import _kernel

DENSE_LIMIT = 12_000
"""Patches beyond which compressed blocks take less time than the whole matrix."""
PROBE_SIZE = 2000
MB = 1e6
SMALLEST_MB = 1.0
DENSE_MATRICES = 1.15
"""Peak memory of the dense model over that of its matrix."""
BYTES_PER_PATCH_COMPRESSED = 30_000.0
"""Of blocks compressed to 0.1 %, measured between 12,500 and 100,000 patches."""


@dataclass(frozen=True)
class Machine:
    """Speed of linear algebra."""

    read_mb_per_s: float


@dataclass(frozen=True)
class Timing:
    """What a solved model took."""

    patches: int
    factors_s: float
    solve_s: float


@dataclass(frozen=True)
class Cost:
    """An estimate."""

    seconds: float
    peak_mb: float


def measured_machine() -> Machine:
    """Time a product of a matrix with a vector, the best of three."""
    areas, out = np.ones(PROBE_SIZE), np.empty(PROBE_SIZE)
    matrix = np.full((PROBE_SIZE, PROBE_SIZE), 1 / PROBE_SIZE)
    product_s = _best_s(lambda: _kernel.reciprocal_product(matrix, areas, areas, out))
    return Machine(matrix.nbytes / MB / product_s)


def _best_s(work: Callable[[], object]) -> float:
    taken = []
    for _ in range(3):
        started = time.perf_counter()
        work()
        taken.append(time.perf_counter() - started)
    return max(min(taken), 1e-7)


def products_needed(spectral_radius: float, residual: float) -> int:
    """Bound of the products that conjugate gradients need for eigenvalues of I - M in 1 - r ... 1 + r / 3."""
    root = np.sqrt((1 + spectral_radius / 3) / max(1 - spectral_radius, 1e-6))
    return int(np.ceil(np.log(2 / residual) / np.log((root + 1) / (root - 1)))) if spectral_radius > 0 else 1


def dense_cost(patches: int, products: int, channels: int, timing: Timing, machine: Machine) -> Cost:
    """Estimate the cost of the whole matrix, from the timing of a smaller model of the same scene."""
    factors_s = timing.factors_s * (patches / timing.patches) ** 2
    read_s = 8 * patches**2 / MB / machine.read_mb_per_s
    return Cost(factors_s + channels * products * read_s, dense_mb(patches))


def dense_mb(patches: int) -> float:
    """Peak memory of the dense model: the matrix, and a little for what is made beside it."""
    return DENSE_MATRICES * 8 * patches**2 / MB + SMALLEST_MB


def largest_dense(memory_mb: float) -> int:
    """Most patches whose dense model fits."""
    return int(np.sqrt(max(memory_mb - SMALLEST_MB, 0.0) * MB / (8 * DENSE_MATRICES)))
