"""Form factors by rays: each patch sends some as it sends light, and the patches that they meet are counted.

Rays leave evenly from a patch, by the cosine to its normal, along Sobol's points with Owen's scrambling; a row can be
lengthened by going on in its sequence. What a ray meets first is found by a tree
(``sim/kernel/geometry/wide_tree.hpp``).

A ray of i stands for nu_i = rays_i / A_i rays a square metre. Both patches of a pair tell of one exchange area, and
their counts are weighed by these densities,

    K_ij = (c_ij + c_ji) / (nu_i + nu_j),

so that a small patch's many rays a square metre count for more. The rows of K are then scaled, on both sides alike, to
their own measured sums A_i s_i, which a row's own even points know far better than any single entry. K stays
symmetric, and no row may sum to more than A_i: the spectral radius of diag(rho) F is at most the largest rho.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array

from sim import _kernel
from sim.arrays import FloatArray, IntArray
from sim.errors import SimulationError
from sim.form_factors.sparse import product, scale_both_sides
from sim.geometry.surface import Surface
from sim.kept import Kept

FEWEST_RAYS, MOST_RAYS = 16, 1 << 20
"""Of a patch: two halves of 8, and as far as single precision finds its hits."""
MOST_SCALINGS = 30
"""Rounds of scaling rows to their sums at most: for closed surfaces, whose sums are known."""
SUMS_ERROR, SUMS_NOISE, TOTAL_ERROR = 1e-4, 0.2, 1e-4
"""Scaling ends where rows miss their sums, RMS over the surface, by the first, or by this share of what independent
rays would leave, and all together by this share of their areas: rows need not follow their sums' noise further, but
what they miss alike grows where light is trapped. Open corners take 3 or 4 rounds, a closed room of 11,082 patches 8;
light is as good as after 30."""
FIRST_RAYS = 32
"""Of each patch, to learn what it needs."""
COUNT_BYTES = 16
"""That the kernel takes a ray while it counts: a column and a number, once by rows and once transposed."""
RAYS_AT_A_TIME = 1 << 22
"""Their indices take 17 MB."""


_tree = Kept[Surface, _kernel.RayTree]("_ray_tree")


def tree_of(surface: Surface) -> _kernel.RayTree:
    """Return the tree over a surface's patches that tells what a ray meets first, built once."""
    return _tree.once(surface, lambda: _kernel.RayTree(np.ascontiguousarray(surface.vertices, dtype=np.float64)))


@dataclass(frozen=True, eq=False)
class _Batch:
    """Rays of some rows, one piece of their sequences."""

    rows: IntArray
    first: int
    """Where in the sequence the piece begins."""
    met: NDArray[np.int32]
    """(rows, rays) patch that each ray meets; below 0: none, or one from behind."""

    @cached_property
    def sums(self) -> FloatArray:
        """(rows,) share of the rays that meet a lit side."""
        return self.means(np.ones(int(self.met.max(initial=0)) + 1))

    def means(self, values: FloatArray) -> FloatArray:
        """(rows,) mean of what each row's rays meet, of (P,) values."""
        means = np.empty(len(self.rows))
        _kernel.ray_means(self.met, values, means)
        return means


_first = Kept[Surface, tuple[int, tuple[_Batch, ...]]]("_first_rays")


@dataclass(frozen=True, eq=False, kw_only=True)
class Halves:
    """A mean over rays, and over the first and the second half of each row's sequence: (P,) or (P, K) each."""

    mean: FloatArray
    first: FloatArray
    second: FloatArray

    @property
    def standard_error(self) -> FloatArray:
        """Half the difference of the halves: the sequence as a whole is a little more even than that tells."""
        return np.asarray(np.abs(self.first - self.second) / 2)


@dataclass(frozen=True, eq=False, kw_only=True)
class CountedExchange:
    """Exchange areas as rays count them, before rows are scaled to their sums."""

    exchange_areas: csr_array
    """(P, P) K_ij = (c_ij + c_ji) / (nu_i + nu_j), symmetric [m²]."""
    by_others: FloatArray
    """(P,) share of what a row is made of that other patches' rays tell."""
    row_sums: FloatArray
    """(P,) shares of each patch's own rays that meet a lit side."""


@dataclass(eq=False, kw_only=True)
class RaySample:
    """Rays of all patches of a surface, to which more can be added."""

    surface: Surface
    seed: int = 0
    """Another one for other rays; the same one for the same rays, whatever the number of threads."""
    rays: IntArray = field(init=False)
    """(P,) of each patch so far."""
    _batches: list[_Batch] = field(init=False, default_factory=list)

    def __post_init__(self) -> None:
        self.rays = np.zeros(self.surface.n_patches, dtype=np.intp)

    @classmethod
    def first(cls, surface: Surface, seed: int = 0) -> RaySample:
        """Return the first 32 rays of each patch, sent once however many ask: a plan, and the solution after it."""
        sample = cls(surface=surface, seed=seed)
        kept = _first.get(surface)
        if kept is not None and kept[0] == seed:
            sample._batches, sample.rays = list(kept[1]), np.full(surface.n_patches, FIRST_RAYS, dtype=np.intp)
        else:
            sample.lengthen(FIRST_RAYS)
            _first.keep(surface, (seed, tuple(sample._batches)))
        return sample

    def lengthen(self, rays: IntArray | int) -> None:
        """Send more rays, until each patch has ``rays``, a power of 2; rows that have as many keep theirs.

        Parameters
        ----------
        rays : int or (P,) int array
            16 to 1,048,576.

        Raises
        ------
        SimulationError
            For a number that is no power of 2 or out of range.
        """
        wanted = np.broadcast_to(np.asarray(rays, dtype=np.intp), self.rays.shape)
        odd = (wanted < FEWEST_RAYS) | (wanted > MOST_RAYS) | (wanted & (wanted - 1) != 0)
        if odd.any():
            raise SimulationError(
                f"{int(wanted[odd][0])} rays a patch; give a power of 2 from {FEWEST_RAYS} to {MOST_RAYS:,}"
            )
        while (short := np.flatnonzero(self.rays < wanted)).size:
            # In pieces that double a sequence, so that its second half is its last piece.
            sent = self.rays[short]
            for have in np.unique(sent):
                self._add(short[sent == have], int(have), int(max(have, FEWEST_RAYS // 2)))

    def _add(self, rows: IntArray, first: int, count: int) -> None:
        tree, step = tree_of(self.surface), max(1, RAYS_AT_A_TIME // count)
        for k in range(0, len(rows), step):
            part = np.ascontiguousarray(rows[k : k + step], dtype=np.int64)
            met = np.empty((len(part), count), dtype=np.int32)
            tree.sample(part, self.seed, first, met)
            self._batches.append(_Batch(part, first, met))
            self.rays[part] += count

    def halves(self, x: ArrayLike) -> Halves:
        """Return what each patch's rays bring from radiosities x, (P,), as a whole and by halves.

        Parameters
        ----------
        x : (P,) array
            Radiosities.

        Returns
        -------
        Halves
        """
        values = np.ascontiguousarray(x, dtype=np.float64)
        return self._halves([batch.means(values) for batch in self._batches])

    def moment_halves(self, x: FloatArray) -> Halves:
        """Return the first moments of what each patch's rays bring from radiosities x, (P,).

        Parameters
        ----------
        x : (P,) array
            Radiosities.

        Returns
        -------
        Halves
            (P, 3) means of what a ray brings, over what all of its half bring on average, times where it began, from
            the patch's centroid [unit of x times m]. Light that is the same everywhere has none, by few rays as well.
        """
        values, tree = np.ascontiguousarray(x, dtype=np.float64), tree_of(self.surface)
        means = []
        for batch in self._batches:
            means.append(np.empty((len(batch.rows), 3)))
            tree.moments(batch.rows, self.seed, batch.first, met=batch.met, values=values, means=means[-1])
        return self._halves(means)

    def _halves(self, means: list[FloatArray]) -> Halves:
        """Of each batch's means, (rows,) or (rows, K), those of all rays."""
        shape = (self.surface.n_patches, *means[0].shape[1:])
        total, first, second = np.zeros((3, *shape))
        count = np.zeros((len(total),) + (1,) * (total.ndim - 1))
        for batch, mean in zip(self._batches, means, strict=True):
            rows, n = batch.rows, batch.met.shape[1]
            first[rows] = total[rows] / np.maximum(count[rows], 1)
            second[rows] = mean
            total[rows] += n * mean
            count[rows] += n
        return Halves(mean=total / np.maximum(count, 1), first=first, second=second)

    @property
    def row_sums(self) -> Halves:
        """Shares of each patch's rays that meet a lit side, (P,), as a whole and by halves."""
        return self._halves([batch.sums for batch in self._batches])

    @property
    def met_behind(self) -> FloatArray:
        """(P,) share of each patch's rays that meet another from behind: where some are, a mesh may be inside out."""
        behind = np.zeros(self.surface.n_patches)
        for batch in self._batches:
            behind[batch.rows] += (batch.met == _MET_BEHIND).sum(axis=1)
        return behind / np.maximum(self.rays, 1)

    def exchange_areas(self) -> CountedExchange:
        """Return what the rays of both patches of each pair tell of their exchange area."""
        n, batches = self.surface.n_patches, self._batches
        counts = _kernel.RayCounts([batch.rows for batch in batches], [batch.met for batch in batches], patches=n)
        starts, columns = np.empty(n + 1, np.int64), np.empty(counts.entries, np.int32)
        values, by_others, hits = np.empty(counts.entries), np.empty(n), np.empty(n)
        density = self.rays / np.asarray(self.surface.areas)
        counts.weigh(density, starts=starts, columns=columns, values=values, by_others=by_others, hits=hits)
        # Both index arrays of one kind, or scipy would widen the long one.
        starts = starts.astype(np.int32) if counts.entries <= np.iinfo(np.int32).max else starts
        K = csr_array((values, columns, starts), shape=(n, n))
        return CountedExchange(exchange_areas=K, by_others=by_others, row_sums=hits / self.rays)


_MET_BEHIND = -2


@dataclass(frozen=True, eq=False, kw_only=True)
class SampledFormFactors:
    """Form factors counted by rays, sparse; a ``sim.light.radiosity.FormFactorOperator``."""

    areas: FloatArray
    """(P,) patch areas [m²]."""
    exchange_areas: csr_array
    """(P, P) K = diag(A) F, symmetric [m²]."""
    row_sums: FloatArray
    """(P,) row sums of F, none above 1."""
    closure_max: float
    """Closed surface: largest ``|row sum - 1|``. Any other: 0."""
    rays: IntArray
    """(P,) that each patch sent."""
    by_others: FloatArray
    """(P,) share of what a row is made of that other patches' rays tell: those of patches with more a square metre."""
    seconds: float
    method: str = "rays"
    visibility: str = "rays"

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
        """
        values = np.asarray(x, dtype=np.float64)
        areas = self.areas if values.ndim == 1 else self.areas[:, None]
        return np.asarray(self.exchange(values) / areas)

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
        return product(self.exchange_areas, x)

    @property
    def kernel_mb(self) -> float:
        """Memory that the kernel took to count the rays, at most [MB = 1e6 bytes]."""
        return COUNT_BYTES * float(self.rays.sum()) / 1e6

    @property
    def stored_mb(self) -> float:
        """Memory of the sparse matrix [MB = 1e6 bytes]."""
        K = self.exchange_areas
        return float(K.data.nbytes + K.indices.nbytes + K.indptr.nbytes) / 1e6


def sampled_form_factors(sample: RaySample) -> SampledFormFactors:
    """Return the form factors that rays have counted, made reciprocal, their row sums kept.

    Parameters
    ----------
    sample : RaySample
        Of at least 16 rays a patch.

    Returns
    -------
    SampledFormFactors

    Raises
    ------
    SimulationError
        If a patch has sent no rays.
    """
    if not sample.rays.all():
        raise SimulationError("a patch without rays has no form factors; lengthen the sample first")
    started = time.perf_counter()
    areas = np.asarray(sample.surface.areas)
    counted = sample.exchange_areas()
    sums = counted.row_sums
    K = counted.exchange_areas
    _scale(K, areas * sums, areas, variance=sums * (1 - sums) / sample.rays)
    row_sums = product(K, np.ones(len(areas))) / areas
    closure = float(np.abs(row_sums - 1).max()) if sample.surface.closed else 0.0
    return SampledFormFactors(
        areas=areas,
        exchange_areas=K,
        row_sums=row_sums,
        closure_max=closure,
        rays=sample.rays.copy(),
        by_others=counted.by_others,
        seconds=time.perf_counter() - started,
    )


def _scale(K: csr_array, sums: FloatArray, areas: FloatArray, variance: FloatArray) -> None:
    """Scale K on both sides until its rows sum to ``sums``, or nearly; none to more than its area.

    ``variance``: (P,) of the row sums of F, if rays were independent.
    """
    scale, area = np.ones(len(areas)), float(areas.sum())
    each, together = max(SUMS_NOISE**2 * float((areas * variance).sum()), SUMS_ERROR**2 * area), TOTAL_ERROR * area
    for _ in range(MOST_SCALINGS):
        here = scale * product(K, scale)
        error = here - sums
        # What is above a row's area will be cut off, from its own row and from others'.
        lost = abs(float(error.sum())) + 2 * float(np.maximum(here - areas, 0.0).sum())
        if float((error**2 / areas).sum()) <= each and lost <= together:
            break
        scale *= np.sqrt(np.divide(sums, here, out=np.zeros_like(sums), where=here > 0))
    here = scale * product(K, scale)
    # Both sides of a row shrink by what it has too much, so that it ends below its area whatever the others do.
    scale *= np.minimum(1.0, np.divide(areas, here, out=np.ones_like(areas), where=here > areas) * (1 - 1e-12))
    scale_both_sides(K, scale)
