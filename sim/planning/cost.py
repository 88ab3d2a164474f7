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

PROBE_SIZE = 2000
"""Rows of the matrix that the speed is measured with: 32 MB, more than a processor's cache."""
MB = 1e6
SMALLEST_MB = 0.05
"""Added to every estimate: what a model of a few patches takes."""
LIGHT_MB = 1.6
"""Of points in the light, at most."""
LIGHT_MB_PER_PATCH = 0.02
START_S = 2e-3
"""What form factors take however few patches there are. [s]"""
PRODUCT_S = 5e-5
"""What a product takes however few patches there are. [s]"""
OTHER_PRODUCTS = 10
"""For the spectral radius, the error bound and the residual."""
FEWEST_COMPRESSED = 1000
"""Patches below which the whole matrix is always taken."""
COMPRESSED_PATCH_S = 1.4e-3
"""A patch, with occluders: benchmarks/hundred_thousand.py on two cores, 12,500 to 100,000 patches. [s]"""
COMPRESSED_PATCHES, COMPRESSED_MB, COMPRESSED_WORK_MB = 12_518, 52.0, 30.0
"""Of the same run: memory kept, and memory beside it, for so many patches."""
COMPRESSED_MB_PER_S = 3000.0
DENSE_MATRICES = 1.15
"""Peak memory of the dense model over that of its matrix."""


@dataclass(frozen=True)
class Machine:
    """Speed of linear algebra."""

    read_mb_per_s: float


@dataclass(frozen=True)
class StepTiming:
    """What a solved model took."""

    patches: int
    factors_s: float
    light_s: float


@dataclass(frozen=True)
class Cost:
    """An estimate."""

    seconds: float
    peak_mb: float


def measured_machine() -> Machine:
    """Return the speed of a product of a matrix with a vector, the best of three."""
    areas, out = np.ones(PROBE_SIZE), np.empty(PROBE_SIZE)
    matrix = np.full((PROBE_SIZE, PROBE_SIZE), 1 / PROBE_SIZE)
    starts, ranges = _kernel.occupied_columns(matrix)
    product_s = _best_s(
        lambda: _kernel.reciprocal_product(matrix, areas, starts=starts, ranges=ranges, x=areas, out=out)
    )
    return Machine(matrix.nbytes / MB / product_s)


def _best_s(work: Callable[[], object]) -> float:
    taken = []
    for _ in range(3):
        started = time.perf_counter()
        work()
        taken.append(time.perf_counter() - started)
    return max(min(taken), 1e-7)


def products_needed(spectral_radius: float, residual: float) -> int:
    """Return a bound of the products that conjugate gradients need for eigenvalues of I - M in 1 - r ... 1 + r / 3."""
    root = np.sqrt((1 + spectral_radius / 3) / max(1 - spectral_radius, 1e-6))
    return int(np.ceil(np.log(2 / residual) / np.log((root + 1) / (root - 1)))) if spectral_radius > 0 else 1


def dense_cost(patches: int, products: int, channels: int, *, timing: StepTiming, machine: Machine) -> Cost:
    """Return the cost of the whole matrix, from the timing of a smaller model of the same scene."""
    ratio = patches / timing.patches
    factors_s = START_S + max(timing.factors_s - START_S, 0.0) * ratio**2
    read_s = 8 * patches**2 / MB / machine.read_mb_per_s + PRODUCT_S
    seconds = factors_s + timing.light_s * ratio + channels * (products + OTHER_PRODUCTS) * read_s
    return Cost(seconds, dense_mb(patches))


def compressed_cost(patches: int, products: int, channels: int, *, timing: StepTiming) -> Cost:
    """Return the cost of compressed form factors: building them takes longer than all else."""
    ratio = patches / COMPRESSED_PATCHES
    factors_s, stored_mb = COMPRESSED_PATCH_S * patches, COMPRESSED_MB * ratio**1.3
    product_s = stored_mb / COMPRESSED_MB_PER_S + PRODUCT_S
    seconds = factors_s + timing.light_s * patches / timing.patches
    return Cost(seconds + channels * (products + OTHER_PRODUCTS) * product_s, stored_mb + ratio * COMPRESSED_WORK_MB)


def compressing_pays(patches: int, dense: StepTiming) -> bool:
    """Tell if the whole matrix, at the pace of a timed smaller one, would take longer than compressed blocks."""
    dense_s = dense.factors_s * (patches / dense.patches) ** 2
    return patches >= FEWEST_COMPRESSED and dense_s > COMPRESSED_PATCH_S * patches


def largest_compressed(memory_mb: float) -> int:
    """Return the most patches whose compressed model fits."""
    return int(COMPRESSED_PATCHES * (memory_mb / (COMPRESSED_MB + COMPRESSED_WORK_MB)) ** (1 / 1.3))


def dense_mb(patches: int) -> float:
    """Return the peak memory of the dense model: the matrix, and what is made beside it."""
    return DENSE_MATRICES * 8 * patches**2 / MB + light_mb(patches)


def light_mb(patches: int) -> float:
    """Return the memory that every model takes beside its form factors: points in the light, and patches."""
    return min(LIGHT_MB, LIGHT_MB_PER_PATCH * patches) + SMALLEST_MB


def largest_dense(memory_mb: float) -> int:
    """Return the most patches whose dense model fits."""
    return int(np.sqrt(max(memory_mb - LIGHT_MB - SMALLEST_MB, 0.0) * MB / (8 * DENSE_MATRICES)))
