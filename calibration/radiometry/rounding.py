"""What whole numbers hide of a mean: levels whose noise is below one digital number do not average out."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr

from calibration.arrays import FloatArray

ROUNDING_VARIANCE = 1 / 12
"""Of one level, where many are rounded differently. [dn²]"""
_WIDEST_DN, _STEP_DN = 0.7, 0.01
"""Of spreads before rounding: with more, a mean is off by less than 2e-5."""
_REACH_DN = 0.6
"""About a whole number: half, and what a mean that is known badly may be beyond."""
_SHAPE_DN = 0.01
"""Of mean and variance, by which levels that are no normal distribution differ from one."""
_AT_ONCE = 64


class RoundingBias(NamedTuple):
    """What rounding adds to means."""

    bias_dn: FloatArray
    """(...) to be taken off."""
    variance: FloatArray
    """(...) of that. [dn²]"""


def rounding_bias(means_dn: ArrayLike, variances: ArrayLike, counts: ArrayLike) -> RoundingBias:
    """Find what rounding to whole numbers has added to the means of levels.

    Parameters
    ----------
    means_dn : (...)
        Of rounded levels. [dn]
    variances : (...)
        Of the same rounded levels. [dn²]
    counts : (...)
        How many levels each is of.

    Returns
    -------
    RoundingBias

    Notes
    -----
    The mean of the normal distribution of all means and widths, by how well its rounded levels have mean and variance
    as given. Levels that are all alike tell half a number either way; of two neighbouring numbers only, the width
    remains unknown; from a standard deviation of 0.6 on nothing is added. The variance of rounded levels alone does not
    tell: it is 0.25 half way between two numbers, however narrow the levels were.
    """
    mean, variance, count = np.broadcast_arrays(
        np.asarray(means_dn, np.float64), np.asarray(variances, np.float64), np.asarray(counts, np.float64)
    )
    bias, uncertain = np.zeros(mean.shape), np.zeros(mean.shape)
    narrow = np.flatnonzero(variance.ravel() < (_WIDEST_DN - 2 * _STEP_DN) ** 2 + ROUNDING_VARIANCE)
    for k in range(0, len(narrow), _AT_ONCE):
        part = narrow[k : k + _AT_ONCE]
        of = (mean.ravel()[part, None], variance.ravel()[part, None], count.ravel()[part, None])
        bias.flat[part], uncertain.flat[part] = _expected(*of)
    return RoundingBias(bias, uncertain)


def _expected(mean: FloatArray, variance: FloatArray, count: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(K,) of (K, 1): mean and variance of what was added."""
    levels = _rounded()
    scatter = np.maximum(variance, 0.25 / count)
    of_mean = scatter / count + _SHAPE_DN**2
    # of the variance of a normal distribution, or of two numbers
    of_variance = scatter * (2 * scatter + 0.25) / count + _SHAPE_DN**2
    off = (mean - np.round(mean) - levels.mean) ** 2 / of_mean + (variance - levels.variance) ** 2 / of_variance
    odds = np.exp(-0.5 * (off - off.min(axis=1, keepdims=True)))
    odds /= odds.sum(axis=1, keepdims=True)
    added = odds @ levels.added
    return added, np.maximum(odds @ levels.added**2 - added**2, 0.0)


class _Rounded(NamedTuple):
    """Normal distributions whose levels were rounded, over means about a whole number and widths."""

    mean: FloatArray
    """(P,)"""
    variance: FloatArray
    """(P,)"""
    added: FloatArray
    """(P,) mean of the rounded levels minus that of the distribution."""


@cache
def _rounded() -> _Rounded:
    true = np.arange(-_REACH_DN, _REACH_DN + _STEP_DN / 2, _STEP_DN)[:, None, None]
    width = np.arange(_STEP_DN / 2, _WIDEST_DN, _STEP_DN)[None, :, None]
    level = np.arange(-5.0, 6.0)
    share = ndtr((level + 0.5 - true) / width) - ndtr((level - 0.5 - true) / width)
    mean = share @ level
    variance = share @ level**2 - mean**2
    return _Rounded(mean.ravel(), variance.ravel(), (mean - true[..., 0]).ravel())
