"""Which picture to photograph next: the one that is expected to tell most about pictures that people show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.arrays import FloatArray
from calibration.light.transport.posterior import TransportPosterior


@dataclass(frozen=True, eq=False, kw_only=True)
class Pictures:
    """Pictures as places of the camera's picture see them; J pictures, N places."""

    lit: FloatArray
    """(J, L) light on each patch, as a share of white's."""
    own: FloatArray
    """(J, N) direct light at each place, as a share of white's."""


@dataclass(frozen=True, kw_only=True)
class NextPhotograph:
    """The picture that would tell most, and what it would bring."""

    index: int
    """Among the candidates."""
    rms_now: float
    """What is expected of the model's error on pictures as people show them, in light ..."""
    rms_after: float
    """... and after one more photograph."""

    @property
    def brings(self) -> float:
        """The part of the error that goes, in light."""
        return float(np.sqrt(max(self.rms_now**2 - self.rms_after**2, 0.0)))


def next_photograph(
    known: TransportPosterior, candidates: FloatArray, usual: FloatArray, noise_variance: FloatArray
) -> NextPhotograph:
    """Choose the candidate after whose photograph usual pictures are known best.

    Parameters
    ----------
    known : TransportPosterior
        By the photographs so far.
    candidates : (N, J, D)
        Pictures that could be shown, as `TransportPrior.of_one` has them: they need not be seen anew each time.
    usual : (N, U, D)
        Pictures that people show: what counts.
    noise_variance : (N,)
        Of one photograph at each place.

    Returns
    -------
    NextPhotograph

    References
    ----------
    K. Chaloner and I. Verdinelli, Bayesian experimental design: a review, Statistical Science 10(3), 1995: the mean
    variance of predictions (V-optimality).
    """
    prior = known.prior
    asked, shown = (prior.spread_over(each) for each in (candidates, usual))
    told_asked, told_shown = _told(known, asked), _told(known, shown)
    shared = shown @ asked.transpose(0, 2, 1) - told_shown @ told_asked.transpose(0, 2, 1)
    own = (asked**2).sum(axis=2) - (told_asked**2).sum(axis=2)
    less = shared**2 / (np.maximum(own, 0.0) + noise_variance[:, None])[:, None, :]
    gain = less.mean(axis=(0, 1))
    now = ((shown**2).sum(axis=2) - (told_shown**2).sum(axis=2)).mean()
    best = int(gain.argmax())
    after = max(float(now - gain[best]), 0.0)
    return NextPhotograph(index=best, rms_now=float(np.sqrt(max(now, 0.0))), rms_after=float(np.sqrt(after)))


def _told(known: TransportPosterior, features: FloatArray) -> FloatArray:
    return np.asarray(features @ known.told.transpose(0, 2, 1))


def least_certain(known: TransportPosterior, count: int) -> FloatArray:
    """Return (count, L) pictures of black and white in the directions in which the posterior is least certain.

    Those of relative errors, for they are where a model is wrong that knows nothing of it.

    Parameters
    ----------
    known : TransportPosterior
    count : int

    Returns
    -------
    (count, L) array
        0 or 1.
    """
    prior, n_kernel = known.prior, known.prior.kernel.shape[1]
    weight = (prior.spread * prior.white) ** 2
    told = known.told[:, :, :n_kernel]
    covariance = weight.sum() * np.eye(n_kernel) - np.einsum("n,nkd,nke->de", weight, told, told)
    vectors = np.linalg.eigh(covariance)[1][:, ::-1][:, :count]
    return np.asarray((prior.kernel @ vectors > 0).T, dtype=np.float64)
