"""Form factors of very many patches: blocks compressed to a tolerance, never the whole matrix.

Patches are sorted into a tree of clusters. The exchange areas K = A F between two clusters that are apart form a
matrix of low rank, u vᵀ, found from a few of its rows and columns by adaptive cross approximation (Bebendorf,
"Approximation of boundary element matrices", Numer. Math. 86, 2000) and cut back to the smallest rank. Blocks
partly hidden are compressed too where that pays, or divide_where_lit; what is left is kept whole. Which occluders may
stand between two clusters is found with planes (Haines, "Shaft culling for efficient ray-cast radiosity", 1991)
and handed down the tree. Each unordered pair of clusters is kept once, so that K is exactly symmetric.

The dense matrix of ``sim.form_factors`` is the plain definition of what is approximated here.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sim import _kernel
from sim.arrays import FloatArray, IntArray
from sim.errors import SimulationError
from sim.form_factors.factors import kept_within_closure
from sim.geometry.surface import Surface

FINEST, COARSEST = 1e-6, 1e-1
"""Tolerances taken: numbers are kept in single precision, and above 0.1 nothing is left of the light."""
LEAF_PATCHES = 32
"""Largest cluster that is not divide_where_lit."""
SAMPLED_ROWS = 100
"""Rows evaluated again for the estimate of the error."""


@dataclass(frozen=True)
class CompressionError:
    """What compression costs, measured on whole rows evaluated again with more points and other rays.

    Differences of F x for light x between 0 and 1: everywhere 1, smooth over the room, and random a patch. For
    light of at most 1 ("white"), they are shares of white.
    """

    max: float
    """Largest of all rows and lights."""
    rms: float
    """Of all rows and lights."""
    rows: int
    """Number of rows evaluated again."""


@dataclass(frozen=True, eq=False, kw_only=True)
class CompressedFormFactors:
    """Form factors as products: what an iterative solver needs."""

    areas: FloatArray
    """(P,) patch areas [m²]."""
    row_sums: FloatArray
    """(P,) share of each patch's power that meets any patch."""
    closure_max: float
    """Closed surface: largest |row sum - 1|. Any other: largest excess of a row sum over 1."""
    tolerance: float
    error: CompressionError
    visibility: str
    """``none`` or ``rays``: what was really done."""
    seconds: float
    """Spent, the measurement of the error included."""
    seconds_build: float
    """Spent before that."""
    stored_mb: float
    """Memory of the blocks [MB = 1e6 bytes]."""
    blocks: Blocks
    kernel: _kernel.CompressedMatrix
    kept: FloatArray
    """(P,) by which the kernel's rows and columns are multiplied: 1, or less where rows would be above 1."""
    method: str = "compressed"

    @property
    def kernel_mb(self) -> float:
        """Memory that the kernel takes [MB = 1e6 bytes]."""
        return self.stored_mb

    def apply(self, x: ArrayLike) -> FloatArray:
        """Return F x: what each patch receives from radiosities x.

        Parameters
        ----------
        x : (P,) or (P, K) array
            Radiosities, one column for each of K lights.

        Returns
        -------
        (P,) or (P, K) array
            Irradiances, in the unit of x.

        Raises
        ------
        SimulationError
            For an array of another shape.
        """
        return _apply(self.kernel, np.asarray(x, dtype=np.float64), self.kept)

    def exchange(self, x: FloatArray) -> FloatArray:
        """Return diag(A) F x, the symmetric product.

        Parameters
        ----------
        x : (P,) or (P, K) array
            Radiosities.

        Returns
        -------
        (P,) or (P, K) array
            In the unit of x times m².
        """
        areas = self.areas if np.ndim(x) == 1 else self.areas[:, None]
        return np.asarray(areas * self.apply(x))


@dataclass(frozen=True)
class Blocks:
    """Numbers stored, by kind of block [counts of 4-byte numbers]."""

    low_rank_clear: int
    low_rank_hidden: int
    """With an occluder between."""
    whole_clear: int
    whole_hidden: int


def compressed_form_factors(
    surface: Surface,
    tolerance: float = 1e-3,
    on_progress: Callable[[float], None] | None = None,
    *,
    keep_within_closure: bool = False,
) -> CompressedFormFactors:
    """Return the form factors of a surface, compressed.

    Parameters
    ----------
    surface : Surface
        A ``Scene``, a ``Mesh`` or ``AdaptivePatches``.
    tolerance : float
        Wanted error of F x for light x of at most 1, as a share of it: 1e-3 is 0.1 % of white. It is aimed at,
        not guaranteed: ``error`` tells what was reached.
    on_progress : callable, optional
        Called with the share of the work done, 0 ... 1.
    keep_within_closure : bool
        Rows that sum to more than 1 are divided by their sums, and their columns, too, so that no light grows;
        ``closure_max`` keeps the defect that there was.

    Returns
    -------
    CompressedFormFactors

    Raises
    ------
    SimulationError
        For a tolerance outside 1e-6 ... 0.1.

    References
    ----------
    Bebendorf, Approximation of boundary element matrices, Numerische Mathematik 86, 2000.
    Haines and Wallace, Shaft culling for efficient ray-cast radiosity, Eurographics Workshop on Rendering, 1991.
    """
    if not FINEST <= tolerance <= COARSEST:
        raise SimulationError(f"tolerance {tolerance:g}; compression takes {FINEST:g} ... {COARSEST:g}")
    started = time.perf_counter()
    occluders = np.zeros((0, 4, 3)) if surface.convex else surface.occluders
    kernel = _kernel.CompressedMatrix(
        vertices=np.ascontiguousarray(surface.vertices, dtype=np.float64),
        normals=np.ascontiguousarray(surface.normals, dtype=np.float64),
        areas=np.ascontiguousarray(surface.areas, dtype=np.float64),
        region=np.ascontiguousarray(surface.region, dtype=np.int64),
        occluders=np.ascontiguousarray(occluders, dtype=np.float64),
        tolerance=tolerance,
        leaf_size=LEAF_PATCHES,
    )
    done = 0.0
    while done < 1:
        done = kernel.step(1024)
        if on_progress:
            on_progress(done)
    seconds_build = time.perf_counter() - started
    ones = np.ones(surface.n_patches)
    row_sums = _apply(kernel, ones, ones)
    excess, kept = row_sums - 1, ones
    closure = np.abs(excess).max() if surface.closed else max(excess.max(), 0.0)
    error = _measured_error(kernel, surface)
    if keep_within_closure and excess.max() > 0:
        kept = kept_within_closure(row_sums)
        row_sums = _apply(kernel, ones, kept)
    return CompressedFormFactors(
        areas=surface.areas,
        row_sums=row_sums,
        closure_max=float(closure),
        tolerance=tolerance,
        error=error,
        visibility="rays" if len(occluders) else "none",
        seconds=time.perf_counter() - started,
        seconds_build=seconds_build,
        stored_mb=4e-6 * sum(kernel.numbers()),
        blocks=Blocks(*kernel.numbers()),
        kernel=kernel,
        kept=kept,
    )


def exact_rows(factors: CompressedFormFactors, rows: IntArray, x: ArrayLike) -> FloatArray:
    """Return (len(rows), K) rows of F x with every entry evaluated again, more finely, for x of shape (P, K)."""
    return _exact_rows(factors.kernel, rows, np.asarray(x, dtype=np.float64))


def _apply(kernel: _kernel.CompressedMatrix, x: FloatArray, kept: FloatArray) -> FloatArray:
    if x.ndim not in (1, 2) or len(x) != len(kept):
        raise SimulationError(f"light of shape {x.shape} for {len(kept)} patches; one value a patch, bands as columns")
    columns = np.ascontiguousarray(x.reshape(len(kept), -1) * kept[:, None])
    y = np.empty_like(columns)
    kernel.apply(columns, y)
    y *= kept[:, None]
    return y.reshape(x.shape)


def _exact_rows(kernel: _kernel.CompressedMatrix, rows: IntArray, x: FloatArray) -> FloatArray:
    y = np.empty((len(rows), x.shape[1]))
    kernel.exact_rows(np.ascontiguousarray(rows, dtype=np.int64), np.ascontiguousarray(x), y)
    return y


def _measured_error(kernel: _kernel.CompressedMatrix, surface: Surface) -> CompressionError:
    generator = np.random.default_rng(0)
    lights = _lights(surface, generator)
    rows = generator.choice(surface.n_patches, min(SAMPLED_ROWS, surface.n_patches), replace=False)
    difference = _apply(kernel, lights, np.ones(surface.n_patches))[rows] - _exact_rows(kernel, rows, lights)
    return CompressionError(
        max=float(np.abs(difference).max()), rms=float(np.sqrt((difference**2).mean())), rows=len(rows)
    )


def _lights(surface: Surface, generator: np.random.Generator) -> FloatArray:
    """(P, 5) one everywhere, a slope along each axis, and random from patch to patch; all in 0 ... 1."""
    low, high = surface.centres.min(axis=0), surface.centres.max(axis=0)
    slopes = (surface.centres - low) / np.maximum(high - low, np.finfo(float).tiny)
    ones = np.ones((surface.n_patches, 1))
    return np.concatenate([ones, slopes, generator.uniform(size=(surface.n_patches, 1))], axis=1)
