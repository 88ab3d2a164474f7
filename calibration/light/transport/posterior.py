"""From a model's light transport and photographs of known pictures to a better one, with its uncertainty.

At each of N places of the camera's picture global light is Σ T(l) u(l), u(l) the light on lit patch l as a share of
white's; the model's row T₀ is wrong by what `calibration.light.transport.prior` says. All of that is one linear
regression a place, its unknowns of variance 1 before any photograph.

References
----------
C. E. Rasmussen and C. K. I. Williams, Gaussian Processes for Machine Learning, MIT Press 2006, chapter 2.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from calibration.arrays import FloatArray, IntArray
from calibration.errors import CalibrationError
from calibration.light.transport.prior import TransportPrior

_AT_ONCE = 256
"""Places that are worked on together: their arrays stay within some tens of megabytes."""
_WHITE_SIGMA = 1e-3
"""Of white's global light, relative: it was measured, and the model is scaled to it."""
_ROUNDS, _MOST_AT_ONCE, _SPREADS = 4, 3.0, (0.01, 3.0)
"""Rounds, the factor of one of them, and the range of a spread: a lobe may send thrice what a matte wall does."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Photographs:
    """Known pictures, and by how much their light differs from what the model expects; K pictures, N places."""

    lit: FloatArray
    """(K, L) light on each patch, as a share of white's."""
    own: FloatArray
    """(K, N) direct light at each place, as a share of white's."""
    difference: FloatArray
    """(K, N) measured minus expected."""
    variance: FloatArray
    """(K, N) of what is measured; infinite where nothing was."""

    def __post_init__(self) -> None:
        shapes = {self.own.shape, self.difference.shape, self.variance.shape}
        if len(shapes) > 1 or len(self.lit) != len(self.own):
            raise CalibrationError(
                f"photographs of different numbers: lit {self.lit.shape}, own {self.own.shape}, difference "
                f"{self.difference.shape}, variance {self.variance.shape}; a row each, a column a place"
            )
        if not (self.variance > 0).all():
            raise CalibrationError("a photograph does not say everywhere how uncertain it is; give variances above 0")

    @classmethod
    def none(cls, prior: TransportPrior) -> Photographs:
        """Return no photograph at all."""
        empty = np.zeros((0, len(prior.spread)))
        return cls(lit=np.zeros((0, prior.transport.shape[1])), own=empty, difference=empty, variance=empty)

    def and_(self, other: Photographs) -> Photographs:
        """Return these, and others after them."""
        names = ("lit", "own", "difference", "variance")
        return Photographs(**{name: np.concatenate([getattr(self, name), getattr(other, name)]) for name in names})

    def at(self, places: IntArray | slice) -> Photographs:
        """Return what they say of some places."""
        return Photographs(
            lit=self.lit,
            own=self.own[:, places],
            difference=self.difference[:, places],
            variance=self.variance[:, places],
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class TransportPosterior:
    """What prior and photographs together say."""

    prior: TransportPrior
    weights: FloatArray
    """(N, D) the unknowns' means."""
    told: FloatArray
    """(N, K + 1, D) factor of what the photographs, and white, took off their covariance: 1 - toldᵀ told."""
    surprise: FloatArray
    """(N,) mean square of what was measured, in standard deviations that were expected: 1 for a prior that is right."""
    wider: FloatArray
    """(N,) factor of the variance that is left, by what photographs showed of each other; 1 before they were asked."""

    @property
    def change(self) -> FloatArray:
        """(N, L) T - T₀."""
        prior = self.prior
        ends = np.cumsum([prior.kernel.shape[1], prior.lobes.shape[1]])
        relative, left_out, open_ones = np.split(self.weights[:, :-1], ends, axis=1)
        errors = prior.base * (relative @ prior.kernel.T) + (left_out[:, None, :] @ prior.lobes)[:, 0]
        return np.asarray(prior.spread[:, None] * errors + (prior.left * open_ones) @ prior.right)

    @property
    def direct_change(self) -> FloatArray:
        """(N,) of white's direct light, taken from its global light."""
        return np.asarray(self.prior.own * self.weights[:, -1])

    def expected(self, lit: FloatArray, own: FloatArray) -> FloatArray:
        """Return (J, N) by how much pictures' light differs from the model's, for the arguments of `features`."""
        return np.asarray(np.einsum("njd,nd->jn", self.prior.features(lit, own), self.weights))

    def variance(self, lit: FloatArray, own: FloatArray) -> FloatArray:
        """Return (J, N) variance of that light: what stays open."""
        found = [self._variance(part, lit, own[:, part]) for part in _parts(len(self.weights))]
        return np.concatenate(found, axis=1)

    def _variance(self, part: slice, lit: FloatArray, own: FloatArray) -> FloatArray:
        features = self.prior.at(part).features(lit, own)
        told = features @ self.told[part].transpose(0, 2, 1)
        left = np.maximum((features**2).sum(axis=2) - (told**2).sum(axis=2), 0.0)
        return np.asarray((self.wider[part, None] * left).T)


def posterior(prior: TransportPrior, photographs: Photographs) -> TransportPosterior:
    """Combine a model's transport with photographs, place by place.

    Parameters
    ----------
    prior : TransportPrior
        Of N places.
    photographs : Photographs
        Of these places; white counts as one more, of which the model is right.

    Returns
    -------
    TransportPosterior

    Raises
    ------
    CalibrationError
        If they are of different places.
    """
    if photographs.own.shape[1] != len(prior.spread):
        raise CalibrationError(
            f"photographs of {photographs.own.shape[1]} places, a model of {len(prior.spread)}; they have to be the "
            "same places"
        )
    return _combined(prior, photographs, _of_one(prior, photographs))


def _of_one(prior: TransportPrior, photographs: Photographs) -> FloatArray:
    """(N, K + 1, D) features of white and the photographs, for a spread of 1."""
    lit = np.concatenate([np.ones((1, prior.transport.shape[1])), photographs.lit])
    own = np.concatenate([np.ones((1, len(prior.spread))), photographs.own])
    return prior.of_one(lit, own)


def _combined(prior: TransportPrior, photographs: Photographs, of_one: FloatArray) -> TransportPosterior:
    parts = [_of_places(prior.at(part), photographs.at(part), of_one[part]) for part in _parts(len(prior.spread))]
    told = np.concatenate([part.told for part in parts])
    return TransportPosterior(
        prior=prior,
        weights=np.concatenate([part.weights for part in parts]),
        told=told,
        surprise=np.concatenate([part.surprise for part in parts]),
        wider=np.ones(len(told)),
    )


def fitted(
    prior: TransportPrior, photographs: Photographs, alike: csr_array | None = None, worth: float = 1.0
) -> TransportPosterior:
    """Combine them after the prior's spread was brought to what the photographs' differences show it to be.

    Parameters
    ----------
    prior : TransportPrior
    photographs : Photographs
    alike : (N, N) csr, optional
        Weights, rows summing to 1, of the places about each at which the unknowns are taken to be the same: each has
        the means of all. None: the places are some of many.
    worth : float
        How many independent measurements such a mean is worth.

    Returns
    -------
    TransportPosterior
    """
    of_one = _of_one(prior, photographs)
    found = _combined(prior, photographs, of_one)
    for _ in range(_ROUNDS if len(photographs.lit) else 0):
        everywhere = np.full_like(found.surprise, found.surprise.mean())
        surprise = everywhere if alike is None else np.asarray(alike @ found.surprise)
        factor = np.clip(np.sqrt(surprise), 1 / _MOST_AT_ONCE, _MOST_AT_ONCE)
        spread = np.clip(found.prior.spread * factor, *_SPREADS)
        found = _combined(replace(prior, spread=spread), photographs, of_one)
    found = _combined(found.prior, replace(photographs, variance=photographs.variance / worth), of_one)
    if len(photographs.lit):
        wider = _left_out(found.prior, photographs, of_one, alike=alike, worth=worth).wider(alike)
        found = replace(found, wider=wider)
    return found if alike is None else replace(found, weights=np.asarray(alike @ found.weights))


def _parts(count: int) -> Iterator[slice]:
    return (slice(k, min(k + _AT_ONCE, count)) for k in range(0, count, _AT_ONCE))


@dataclass(frozen=True, eq=False, kw_only=True)
class SolvedPlaces:
    """The regression of some places: n of them, white and K photographs, D unknowns."""

    factor: FloatArray
    """(n, K + 1, K + 1) L, lower triangular: L Lᵀ is the covariance of what is measured over its noise, I + r rᵀ."""
    told: FloatArray
    """(n, K + 1, D) L⁻¹ r."""
    explained: FloatArray
    """(n, K + 1) L⁻¹ y."""
    known: NDArray[np.bool_]
    """(n, K + 1) what was measured."""

    @property
    def weights(self) -> FloatArray:
        """(n, D) the unknowns' means."""
        return np.asarray(np.einsum("nkd,nk->nd", self.told, self.explained))

    @property
    def surprise(self) -> FloatArray:
        """(n,) mean square of the photographs, in standard deviations that were expected."""
        count = np.maximum(self.known[:, 1:].sum(axis=1), 1)
        return np.asarray((self.explained[:, 1:] ** 2).sum(axis=1) / count)


def _of_places(prior: TransportPrior, photographs: Photographs, of_one: FloatArray) -> SolvedPlaces:
    """Solve the regression of a few places."""
    n_places, features = len(prior.spread), prior.spread_over(of_one)
    white = (_WHITE_SIGMA * np.maximum(prior.white, np.finfo(float).tiny)) ** 2
    variance = np.concatenate([white[None], photographs.variance]).T
    known = np.isfinite(variance)
    difference = np.concatenate([np.zeros((1, n_places)), photographs.difference]).T
    # Divided by its standard deviation; what was not measured tells nothing.
    scale = np.where(known, 1 / np.sqrt(np.where(known, variance, 1.0)), 0.0)
    rows, seen = features * scale[..., None], np.where(known, difference, 0.0) * scale
    factor: FloatArray = np.linalg.cholesky(rows @ rows.transpose(0, 2, 1) + np.eye(rows.shape[1])).astype(np.float64)
    solved = _solved_forward(factor, np.concatenate([rows, seen[..., None]], axis=2))
    return SolvedPlaces(factor=factor, told=solved[..., :-1], explained=solved[..., -1], known=known)


def _solved_forward(factor: FloatArray, right: FloatArray) -> FloatArray:
    """(n, k, d) L⁻¹ times the right side, of n lower triangles at once: calls a place cost far more than its sums."""
    solved = right.copy()
    for k in range(right.shape[1]):
        solved[:, k] -= (factor[:, k, None, :k] @ solved[:, :k])[:, 0]
        solved[:, k] /= factor[:, k, k, None]
    return solved


@dataclass(frozen=True, eq=False, kw_only=True)
class LeftOut:
    """Each photograph, and what all others make of it."""

    off: FloatArray
    """(K, N) measured minus what the others expect; 0 where nothing was measured."""
    noise: FloatArray
    """(K, N) variance of the photograph's own noise ..."""
    expected: FloatArray
    """(K, N) ... and of what the others leave open."""

    def wider(self, alike: csr_array | None) -> FloatArray:
        """Return (N,) by what factor the variance is larger than what is left open: 1 or more.

        Neighbours are taken together; without them all places are, each with its own measure of light.
        """
        beyond, left = (self.off**2 - self.noise).sum(axis=0), self.expected.sum(axis=0)
        tiny = np.finfo(float).tiny
        if alike is None:
            return np.full(len(left), max(float(np.mean(beyond / np.maximum(left, tiny))), 1.0))
        return np.asarray(np.maximum((alike @ beyond) / np.maximum(alike @ left, tiny), 1.0))


def left_out(
    prior: TransportPrior, photographs: Photographs, alike: csr_array | None = None, worth: float = 1.0
) -> LeftOut:
    """Return what photographs show of each other, each in its turn left out of :func:`fitted`.

    Without photograph k the unknowns' means are w - c_k rᵀ G⁻¹ e_k, c_k = (G⁻¹ y)_k / (G⁻¹)_kk, and what is left open
    of it has variance 1 / (G⁻¹)_kk - 1, over its noise; G = L Lᵀ.

    Parameters
    ----------
    prior : TransportPrior
        As brought to size by the photographs.
    photographs, alike, worth
        As for :func:`fitted`.

    Returns
    -------
    LeftOut

    References
    ----------
    Rasmussen and Williams 2006, section 5.4.2.
    """
    return _left_out(prior, photographs, _of_one(prior, photographs), alike=alike, worth=worth)


def _left_out(
    prior: TransportPrior, photographs: Photographs, of_one: FloatArray, *, alike: csr_array | None, worth: float
) -> LeftOut:
    n_places, count = len(prior.spread), len(photographs.lit)
    off, expected = np.zeros((count, n_places)), np.zeros((count, n_places))
    narrow = replace(photographs, variance=photographs.variance / worth)
    parts = list(_parts(n_places))
    solved = [_of_places(prior.at(part), narrow.at(part), of_one[part]) for part in parts]
    backwards = [np.asarray(np.linalg.inv(each.factor), dtype=np.float64) for each in solved]
    known = np.isfinite(photographs.variance)
    for k in range(count):
        ones = [_without(each, L, k + 1) for each, L in zip(solved, backwards, strict=True)]
        weights = np.concatenate([means for means, _ in ones])
        weights = weights if alike is None else np.asarray(alike @ weights)
        features = prior.spread_over(of_one[:, k + 1 : k + 2])[:, 0]
        off[k] = np.where(known[k], photographs.difference[k] - np.einsum("nd,nd->n", features, weights), 0.0)
        open_share = np.concatenate([share for _, share in ones])
        expected[k] = np.where(known[k], open_share * np.where(known[k], narrow.variance[k], 0.0), 0.0)
    return LeftOut(off=off, noise=np.where(known, photographs.variance, 0.0), expected=expected)


def _without(solved: SolvedPlaces, backwards: FloatArray, row: int) -> tuple[FloatArray, FloatArray]:
    """(n, D) the unknowns' means without a row, and (n,) what is left open of that row, over its noise."""
    column = backwards[:, :, row]
    own = (column**2).sum(axis=1)
    off = (column * solved.explained).sum(axis=1) / own
    change = np.einsum("nkd,nk->nd", solved.told, column) * off[:, None]
    return solved.weights - change, np.maximum(1 / own - 1, 0.0)
