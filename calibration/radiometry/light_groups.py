"""Pixels of about one light as one: means of their levels in each frame, and how well these are known.

Levels are whole numbers: where noise is below one of them, rounding does not average out.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr

from calibration.arrays import BoolArray, FloatArray, IntArray
from calibration.radiometry.flicker import InStep, swell_in_step

_GROUPS, _GROUP_PIXELS = 80, 30
"""Of pixels of about one light: rounding averages out in each, and its noise is known."""
USABLE = (0.005, 0.97)
"""Shares of full scale between which a group counts: below is rounding, above it may clip in one of the frames."""
_NOISE_CLEAR = 3.0
"""Standard deviations of a pixel's noise that a group stays away from black, where tone curves cut noise off."""

ROUNDING_VARIANCE = 1 / 12
"""Of one level, where many are rounded differently. [dn²]"""
_WIDEST_DN, _STEP_DN = 0.7, 0.01
"""Of spreads before rounding: with more, a mean is off by less than 2e-5."""
_REACH_DN = 0.6
"""About a whole number: half, and what a mean that is known badly may be beyond."""
_SHAPE_DN = 0.01
"""Of mean and variance, by which levels that are no normal distribution differ from one."""
_AT_ONCE = 64


@dataclass(frozen=True, eq=False, kw_only=True)
class LightBesides:
    """What else than the picture lights the pixels, and may swell in step with the frames."""

    dark: FloatArray
    """(N,) levels above black of the pixels in darkness, at the longest exposure. [dn]"""
    in_step: InStep
    """What frames of darkness tell of black and of the swell."""


class Scatter(NamedTuple):
    """Squared residuals over their variances."""

    between: float
    """Of means over the repeats of an exposure: what noise does not explain is the same in all of them."""
    within: float
    """Of the repeats about these means."""
    means: int
    repeats: int
    """Beyond one of each mean."""

    def explained(self, unknowns: int, has_repeats: bool) -> tuple[float, float]:
        """Take scatter beyond what noise explains as a common factor of all variances, of means and of repeats.

        Parameters
        ----------
        unknowns
            That were fitted to the means.
        has_repeats
            Whether the variances are known; else the factor may be below 1.

        Returns
        -------
        tuple[float, float]
            The factor of the means, and the logarithm of the likelihood with both.
        """
        chi2, least = self.between / max(self.means - unknowns, 1), 1.0 if has_repeats else 1e-12
        of_means, of_repeats = max(chi2, least), max(self.within / max(self.repeats, 1), 1.0)
        squares = self.between / of_means + self.within / of_repeats
        return of_means, -0.5 * (squares + self.means * np.log(of_means) + self.repeats * np.log(of_repeats))


@dataclass(frozen=True, eq=False, kw_only=True)
class LightGroups:
    """Means of groups of pixels of about one light, in F frames, shares of full scale."""

    y: FloatArray
    """(F, G)"""
    variance: FloatArray
    """(F, G) of these means."""
    bent: FloatArray
    """(F, G) half the variance of a group's pixels: where a curve is bent, their mean level is not that of their mean
    light."""
    usable: BoolArray
    """(F, G)"""
    log_time: FloatArray
    """(F,) logarithm of the exposure over the longest."""
    dark: FloatArray
    """(G,) levels of the room light at the longest exposure, share of full scale; 0 where nothing is known of it."""
    swell: FloatArray
    """(F, 4) what each unknown of a swell in step adds to the exposure of the room light, share of the exposure."""
    swell_found: FloatArray
    """(F,) the same of all of them, as far as frames of darkness tell."""
    has_repeats: bool
    """Whether the variances come from frames of equal exposure; else they are a guess."""

    @property
    def brightest(self) -> float:
        """Share of full scale up to which levels were measured; 0 where no group counts."""
        return float(self.y[self.usable].max(initial=0.0))

    @cached_property
    def exposure_of(self) -> IntArray:
        """(F,) number of each frame's exposure, from 0."""
        return np.unique(self.log_time, return_inverse=True)[1]

    def scatter(self, residual: FloatArray) -> Scatter:
        """Compare residuals (F, G) of the means with their variances."""
        members = np.eye(self.exposure_of.max() + 1)[:, self.exposure_of]
        weight = np.where(self.usable, 1 / self.variance, 0.0)
        off, total = np.nan_to_num(residual), members @ weight
        between = float(((members @ (weight * off)) ** 2 / np.where(total > 0, total, 1.0)).sum())
        within, means = float((weight * off**2).sum()) - between, int((total > 0).sum())
        return Scatter(between, max(within, 0.0), means, int(self.usable.sum()) - means)


def grouped_by_light(
    levels: FloatArray,
    times: FloatArray,
    full_scale_dn: float,
    room: LightBesides | None = None,
    *,
    black_dn: float = 0.0,
) -> LightGroups:
    """Sort pixels by their light, and take means of neighbours.

    Parameters
    ----------
    levels : (F, N)
        Digital numbers above black of N pixels in F frames.
    times : (F,)
        Exposures; equal ones are repeats, whose difference is noise.
    full_scale_dn : float
        Digital number above black where the sensor clips.
    room : LightBesides or None
        Its pixels are those of `levels`, and times are seconds then.
    black_dn : float
        What was subtracted: with it levels are the camera's whole numbers.

    Returns
    -------
    LightGroups
        Only groups that are usable in two frames or more.
    """
    order = np.argsort(np.minimum(levels, full_scale_dn).sum(axis=0), kind="stable")
    members = _parts(order)
    parts = [levels[:, part] for part in members]
    noise = [_temporal_variance(part, times) for part in parts]
    mean = np.stack([part.mean(axis=1) for part in parts], axis=1)
    spread = np.stack([part.var(axis=1) for part in parts], axis=1)
    size = np.array([part.shape[1] for part in parts])
    has_repeats = len(np.unique(times)) < len(times)
    temporal = (
        np.stack(noise, axis=1) if has_repeats else ROUNDING_VARIANCE + 1e-5 * full_scale_dn * np.maximum(mean, 0)
    )
    # it does not average out in a group whose pixels all have one level, or two
    rounding = rounding_bias(mean + black_dn, spread, size)
    mean = mean - rounding.bias_dn
    variance = (temporal + ROUNDING_VARIANCE) / size + rounding.variance
    pixel_sigma = np.sqrt(temporal) / full_scale_dn
    largest = np.stack([np.quantile(part, 0.99, axis=1) for part in parts], axis=1) / full_scale_dn
    y = mean / full_scale_dn
    least = np.maximum(USABLE[0], np.maximum(_NOISE_CLEAR * pixel_sigma, 1.5 / full_scale_dn))
    usable = (y > least) & (largest < USABLE[1])
    bent = np.maximum(spread - ROUNDING_VARIANCE, 0) / 2 / full_scale_dn**2
    dark = np.zeros(len(parts)) if room is None else np.array([room.dark[part].mean() for part in members])
    swell = swell_in_step(times) / times[:, None]
    kept = usable.sum(axis=0) >= 2
    return LightGroups(
        y=y[:, kept],
        variance=variance[:, kept] / full_scale_dn**2,
        bent=bent[:, kept],
        usable=usable[:, kept],
        log_time=np.log(times / times.max()),
        dark=np.maximum(dark[kept], 0.0) / full_scale_dn,
        swell=swell,
        swell_found=swell @ (np.zeros(swell.shape[1]) if room is None else room.in_step.swell),
        has_repeats=has_repeats,
    )


def _parts(order: IntArray) -> list[IntArray]:
    """Alike in size, but for the brightest, which is halved again and again.

    Few pixels may be far brighter than all others (a wall beside the projector): as one group they would clip together
    with the brightest of them, and no level near full scale would be measured.
    """
    *parts, rest = np.array_split(order, max(1, min(_GROUPS, len(order) // _GROUP_PIXELS)))
    while len(rest) >= 2 * _GROUP_PIXELS:
        parts.append(rest[: len(rest) // 2])
        rest = rest[len(rest) // 2 :]
    return [*parts, rest]


def _temporal_variance(part: FloatArray, times: FloatArray) -> FloatArray:
    """(F,) variance of one pixel over time in a group, from frames of equal exposure; changes in common left out."""
    variance = np.full(len(times), np.nan)
    for time in np.unique(times):
        same = np.flatnonzero(times == time)
        if len(same) > 1:
            alone = part[same] - part[same].mean(axis=1, keepdims=True)
            pixels = max(part.shape[1] - 1, 1)
            variance[same] = (alone - alone.mean(axis=0)).var(axis=0, ddof=1).sum() / pixels
    known = np.isfinite(variance)
    return np.where(known, variance, np.nanmax(variance)) if known.any() else variance


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
