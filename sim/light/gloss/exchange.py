"""Form factors by way of gloss: what matte patches send each other over any number of glossy reflections.

K_ij = A_i F_ij is extended by what leaves i, meets a glossy patch g, and reaches j from its lobe, straight or over
further lobes: B = E + ρ (F + F_s) B stays the radiosity system of the matte parts, its matrix symmetric since lobes
are reciprocal. For a point of g, one direction from the cosine and one from the lobe about it, a pair of patches
(i, j) that they meet is worth A_g ρ_s w; rays are counted in both orders.

References
----------
Sillion and Puech, A general two-pass method integrating specular and diffuse reflection, SIGGRAPH 1989: extended form
factors, there of mirrors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_array, csr_array

from sim.arrays import FloatArray, IntArray
from sim.errors import SimulationError
from sim.form_factors.factors import FormFactors
from sim.geometry.surface import Surface
from sim.light.gloss.lobe import frames_of
from sim.light.gloss.material import Gloss
from sim.light.gloss.walks import GlossySurface, even_points
from sim.light.radiosity import FormFactorOperator
from sim.progress import OnProgress, unheard

RAYS_AT_A_TIME = 1 << 16
"""Their arrays take some 70 MB."""
MOST_RAYS = 1 << 16
_SCALINGS, _SUMS_ERROR = 40, 1e-4
"""Rounds of scaling rows to their sums, and what may be left, of an area: noise of the rays is above it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class GlossyFormFactors:
    """Form factors without a dense matrix, extended by those by way of gloss; a ``FormFactorOperator``."""

    base: FormFactorOperator
    """Straight from patch to patch."""
    by_gloss: csr_array
    """(P, P) exchange areas by way of gloss, symmetric [m²]."""

    @property
    def areas(self) -> FloatArray:
        """(P,) patch areas [m²]."""
        return self.base.areas

    @property
    def row_sums(self) -> FloatArray:
        """(P,) row sums of F + F_s: above 1 where light meets gloss, and is counted again where that sends it."""
        return np.asarray(self.base.row_sums + np.asarray(self.by_gloss.sum(axis=1)).ravel() / self.areas)

    @property
    def closure_max(self) -> float:
        """Of the factors straight from patch to patch."""
        return self.base.closure_max

    @property
    def method(self) -> str:
        """How they were made."""
        return f"{self.base.method}, and gloss by rays"

    def apply(self, x: ArrayLike) -> FloatArray:
        """Return (F + F_s) x for x (P,) or (P, K)."""
        values = np.asarray(x, dtype=np.float64)
        areas = self.areas if values.ndim == 1 else self.areas[:, None]
        return np.asarray(self.base.apply(values) + self.by_gloss @ values / areas)

    def exchange(self, x: FloatArray) -> FloatArray:
        """Return diag(A) (F + F_s) x for x (P,) or (P, K)."""
        return np.asarray(self.base.exchange(x) + self.by_gloss @ x)


@dataclass(frozen=True, eq=False, kw_only=True)
class DenseGlossyFormFactors(FormFactors):
    """A dense matrix F + F_s, whose diagonal is not 0: a patch sees itself in others, as none does straight."""

    def exchange(self, x: FloatArray) -> FloatArray:
        """Return diag(A) (F + F_s) x for x (P,) or (P, K)."""
        product = super().exchange(x)
        if x.ndim > 1:
            return product
        # The kernel's product reads one half of the matrix, without its diagonal.
        return np.asarray(product + self.areas * np.diagonal(self.matrix) * x)


def glossy_form_factors(
    surface: Surface,
    form_factors: FormFactorOperator,
    gloss: Gloss,
    *,
    rays: int = 256,
    seed: int = 0,
    on_progress: OnProgress = unheard,
) -> DenseGlossyFormFactors | GlossyFormFactors:
    """Return form factors extended by light that glossy patches pass on between others.

    Parameters
    ----------
    surface : Surface
    form_factors : FormFactorOperator
        Of that surface, straight from patch to patch.
    gloss : Gloss
    rays : int
        Pairs of rays from each glossy patch.
    seed : int
        Another one for other rays; the same one for the same, whatever the number of threads.
    on_progress : callable
        Is told the share of the rays that have been sent.

    Returns
    -------
    DenseGlossyFormFactors or GlossyFormFactors
        Dense if the given ones are; no light is created: ρ (F + F_s) keeps at most the largest ρ / (1 - ρ_s).

    Raises
    ------
    SimulationError
        If the parts do not belong together, create light, or for a number of rays outside 16 ... 65,536.
    """
    glossy = GlossySurface.of(surface, gloss)
    if len(form_factors.areas) != surface.n_patches:
        raise SimulationError(
            f"form factors of {len(form_factors.areas)} patches for {surface.name} of {surface.n_patches}; "
            "compute them from the same surface"
        )
    if not 16 <= rays <= MOST_RAYS:
        raise SimulationError(f"{rays} rays from a glossy patch; give 16 ... {MOST_RAYS:,}")
    pairs = _pairs(glossy, rays, seed, on_progress)
    by_gloss = _scaled(pairs, form_factors.exchange(gloss.share), 1 - gloss.share)
    if not isinstance(form_factors, FormFactors):
        return GlossyFormFactors(base=form_factors, by_gloss=by_gloss)
    matrix = form_factors.matrix + by_gloss.toarray() / form_factors.areas[:, None]
    return DenseGlossyFormFactors(
        matrix=matrix,
        areas=form_factors.areas,
        row_sums=matrix.sum(axis=1),
        closure_max=form_factors.closure_max,
        method=f"{form_factors.method}, and gloss by rays",
        visibility=form_factors.visibility,
        seconds=form_factors.seconds,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class _Pairs:
    """Exchange areas by way of gloss as the rays counted them."""

    exchange: csr_array
    """(P, P), symmetric [m²]."""
    kept: FloatArray
    """(P,) of a patch's light that meets gloss, the share that comes to rest: leaves no further lobe and no opening."""


def _pairs(glossy: GlossySurface, rays: int, seed: int, on_progress: OnProgress) -> _Pairs:
    n = glossy.surface.n_patches
    patches = np.flatnonzero(glossy.gloss.glossy)
    square = even_points(rays, 6)
    total = csr_array((n, n))
    met, rest = np.zeros(n), np.zeros(n)
    step = max(1, RAYS_AT_A_TIME // rays)
    for first in range(0, len(patches), step):
        some = patches[first : first + step]
        random = np.random.default_rng((seed, 1, first))
        chances = (square + random.uniform(size=(len(some), 1, 6))) % 1.0
        found = _counted(glossy, np.repeat(some, rays), chances.reshape(-1, 6), random)
        values = glossy.surface.areas[some].repeat(rays) / rays
        total = total + coo_array((values[found.pair] * found.share, (found.one, found.other)), shape=(n, n)).tocsr()
        met += np.bincount(found.first, values[found.started] * glossy.gloss.share[found.glossy], minlength=n)
        settled = values[found.pair] * found.share * (1 - glossy.gloss.share[found.other])
        rest += np.bincount(found.one, settled, minlength=n)
        on_progress((first + len(some)) / len(patches))
    kept = np.divide(rest, met, out=np.zeros(n), where=met > 0)
    return _Pairs(exchange=csr_array((total + total.T) / 2), kept=kept)


@dataclass(frozen=True, eq=False, kw_only=True)
class _MetPairs:
    """What pairs of rays met."""

    started: IntArray
    """(M,) number of each pair whose first ray met a patch."""
    first: IntArray
    """(M,) that patch."""
    glossy: IntArray
    """(M,) the patch between."""
    pair: IntArray
    """(N,) number of the pair, for each leg of its other way."""
    one: IntArray
    other: IntArray
    """(N,) patches at the ends."""
    share: FloatArray
    """(N,) ρ_s w of all lobes on the way."""


def _counted(glossy: GlossySurface, patch: IntArray, chances: FloatArray, random: np.random.Generator) -> _MetPairs:
    points = glossy.lifted(patch, points_on(glossy.surface, patch, chances[:, :2]))
    rays = cosine_directions(glossy.surface, patch, chances[:, 2:4])
    begin = glossy.first_leg(points, rays, np.ones(len(patch)))
    one = np.full(len(patch), -1, dtype=np.intp)
    one[begin.walk] = begin.patch
    # As if a ray had come along: the lobe is about where the first one went.
    ways, weight = glossy.reflected(patch[begin.walk], -rays[begin.walk], chances[begin.walk, 4:])
    share = glossy.gloss.share[patch[begin.walk]] * weight
    on = np.flatnonzero(share > 0)
    leg = glossy.first_leg(points[begin.walk[on]], ways[on], share[on], begin.walk[on])
    legs = [leg]
    going = leg.of(glossy.gloss.glossy[leg.patch])
    if len(going.walk):
        legs += glossy.further(going, random.uniform(size=(len(going.walk), 2)), random)
    pair = np.concatenate([leg.walk for leg in legs])
    return _MetPairs(
        started=begin.walk,
        first=begin.patch,
        glossy=patch[begin.walk],
        pair=pair,
        one=one[pair],
        other=np.concatenate([leg.patch for leg in legs]),
        share=np.concatenate([leg.share for leg in legs]),
    )


def _scaled(pairs: _Pairs, arriving: FloatArray, weight: FloatArray) -> csr_array:
    """Scale exchange areas on both sides until each row passes on what exact factors say arrives on gloss.

    Rows K_s (1 - ρ_s) sum to what is kept of ``arriving``, K ρ_s, and never to more than all of it: then rows of
    (K + K_s) (1 - ρ_s) are at most those of K, and ρ (F + F_s) is a contraction wherever ρ F is.
    """
    K = pairs.exchange
    wanted = arriving * pairs.kept
    scale = np.ones(K.shape[0])
    limit = _SUMS_ERROR * max(float(wanted.max(initial=0.0)), np.finfo(float).tiny)
    for _ in range(_SCALINGS):
        here = np.asarray(scale * (K @ (scale * weight)))
        if (np.abs(here - wanted) <= limit)[here > 0].all():
            break
        scale *= np.sqrt(np.divide(wanted, here, out=np.zeros_like(wanted), where=here > 0))
    here = np.asarray(scale * (K @ (scale * weight)))
    scale *= np.minimum(1.0, np.divide(arriving, here, out=np.ones_like(here), where=here > arriving) * (1 - 1e-12))
    rows = np.repeat(np.arange(K.shape[0]), np.diff(K.indptr))
    return csr_array((K.data * (scale[rows] * scale[K.indices]), K.indices, K.indptr), shape=K.shape)


def points_on(surface: Surface, patch: IntArray, chances: FloatArray) -> FloatArray:
    """Return (N, 3) points spread evenly over patches, of even chances (N, 2) [m]."""
    a, b, c, d = (np.asarray(surface.vertices)[patch, k] for k in range(4))
    first = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    second = np.linalg.norm(np.cross(c - a, d - a), axis=1)
    share = first / (first + second)
    s, in_first = chances[:, 0], chances[:, 0] < share
    s = np.where(in_first, s / share, (s - share) / np.maximum(1 - share, np.finfo(float).tiny))
    corner = np.where(in_first[:, None], b, d)
    root, t = np.sqrt(s)[:, None], chances[:, 1][:, None]
    return np.asarray((1 - root) * a + root * ((1 - t) * corner + t * c))


def cosine_directions(surface: Surface, patch: IntArray, chances: FloatArray) -> FloatArray:
    """Return (N, 3) directions from patches, as many as their cosine, of even chances (N, 2)."""
    radius, angle = np.sqrt(chances[:, 0]), 2 * np.pi * chances[:, 1]
    local = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - chances[:, 0])], axis=1)
    return np.asarray(np.einsum("nij,ni->nj", frames_of(surface.normals[patch]), local))
