"""What a camera reads without any light, from frames of projector black at several exposures."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from calibration.arrays import FloatArray
from calibration.radiometry.flicker import MAINS_LIGHT_HZ, SWELL, InStep, swell_in_step
from calibration.radiometry.light_groups import ROUNDING_VARIANCE, rounding_bias

_CLIPPED_SHARE, _BELOW, _WELL_ABOVE = 0.3, 0.02, 0.01
"""Of pixels: so many at one level, hardly one below and some more than one step above it, so noise is cut off there."""
_DRIFT = 0.02
"""Of the light on black, from frame to frame, where it swells by :data:`SWELL`; in proportion to that elsewhere."""
_SHARES = (0.0, 0.1, 0.3, 1.0, 2.0)
"""Of :data:`SWELL`, out of step with the frames: none, hardly any, and what bright room lights do."""
_ROUNDS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class BlackLevel:
    """A camera's reading without light."""

    offset_dn: float
    sigma_dn: float
    """Standard error."""
    in_step: InStep
    """What else may have made these levels: the same is in frames of anything else that begin at the same phase."""
    is_clipped: bool
    """Noise below it is cut off, as cameras with a tone curve do."""


def fit_black_level(levels: ArrayLike, exposures: ArrayLike) -> BlackLevel:
    """Find the level at exposure 0.

    Parameters
    ----------
    levels : (F, N)
        Digital numbers of N pixels in F frames, whole numbers.
    exposures : (F,)
        In any order; if all are one, light on black counts as none. [s]

    Returns
    -------
    BlackLevel
        The level that most pixels of the shortest exposure have where noise is cut off; else the straight line through
        the means, continued to 0. Pixels that light reaches hardly change either.

    Notes
    -----
    Room light that swells by a share m at a frequency f adds a m / (2 pi f) (cos p - cos(p + 2 pi f t)) to an exposure
    t that begins at phase p, beside a t. In step with the frames p is one phase: the first cosine passes for black at
    every exposure, but the second leaves the straight line, unless all exposures are whole periods, where both are
    gone. So a swell in step is fitted beside the line, held to a tenth of the light: the level's standard error has in
    it what these exposures cannot tell. Out of step p is another in each frame; how much of it there is counts by how
    likely it makes the means.
    """
    frames, times = np.asarray(levels, dtype=np.float64), np.asarray(exposures, dtype=np.float64)
    shortest = frames[times == times.min()]
    lowest = float(np.quantile(shortest, 0.05, method="lower"))
    if _is_clipped(shortest, lowest):
        sigma = float(np.sqrt(ROUNDING_VARIANCE))
        return BlackLevel(offset_dn=lowest, sigma_dn=sigma, in_step=InStep.unknown(sigma), is_clipped=True)
    means = frames.mean(axis=1)
    rounding = rounding_bias(means, frames.var(axis=1), frames.shape[1])
    variance = frames.var(axis=1) / frames.shape[1] + rounding.variance + 1e-8
    # all frames of a camera without noise are rounded alike
    return _with_sigma(_extended(times, means - rounding.bias_dn, variance), float(np.sqrt(rounding.variance.min())))


def _with_sigma(found: BlackLevel, sigma_dn: float) -> BlackLevel:
    """Add an error of the level that has nothing to do with light."""
    covariance = found.in_step.covariance + np.diag([sigma_dn**2, 0.0, 0.0, 0.0, 0.0])
    total = float(np.hypot(found.sigma_dn, sigma_dn))
    return replace(found, sigma_dn=total, in_step=replace(found.in_step, covariance=covariance))


def _is_clipped(shortest: FloatArray, lowest: float) -> bool:
    at_lowest = float((shortest == lowest).mean())
    return bool(
        at_lowest > _CLIPPED_SHARE
        and (shortest < lowest).mean() < _BELOW
        and (shortest > lowest + 1.5).mean() > _WELL_ABOVE
    )


def _extended(times: FloatArray, means: FloatArray, variance: FloatArray) -> BlackLevel:
    """Straight line beside a swell in step; the mean over how much the light may swell out of step."""
    if len(np.unique(times)) < 2:
        sigma = float(np.sqrt(variance.mean() / len(means)))
        in_step = InStep.unknown(sigma)
        return BlackLevel(offset_dn=float(means.mean()), sigma_dn=sigma, in_step=in_step, is_clipped=False)
    light_dn_per_s = max(float(np.ptp(means)), 0.0) / float(times.max())
    for _ in range(_ROUNDS):
        noise = variance + _out_of_step(times, light_dn_per_s)
        light_dn_per_s = max(_line(times, means, noise, light_dn_per_s).light_dn_per_s, 0.0)
    out_of_step = _out_of_step(times, light_dn_per_s)
    lines = [_line(times, means, variance + share**2 * out_of_step, light_dn_per_s) for share in _SHARES]
    odds = np.exp(np.array([one.log_likelihood for one in lines]) - max(one.log_likelihood for one in lines))
    found = np.average([one.found for one in lines], axis=0, weights=odds)
    away = np.array([np.outer(one.found - found, one.found - found) for one in lines])
    covariance = np.average(np.array([one.covariance for one in lines]) + away, axis=0, weights=odds)
    return BlackLevel(
        offset_dn=float(found[0]),
        sigma_dn=float(np.sqrt(covariance[0, 0])),
        in_step=InStep(swell=found[1:], covariance=covariance),
        is_clipped=False,
    )


def _out_of_step(times: FloatArray, light_dn_per_s: float) -> FloatArray:
    """(F,) variance of what a swell that begins at any phase adds, and slow changes of the light."""
    swell_s = SWELL * np.minimum(times, 1 / (2 * np.pi * MAINS_LIGHT_HZ[0]))
    return np.asarray(light_dn_per_s**2 * (swell_s**2 + (_DRIFT * times) ** 2))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Line:
    light_dn_per_s: float
    found: FloatArray
    """(5,) the level at exposure 0, and the swell in step."""
    covariance: FloatArray
    """(5, 5)"""
    log_likelihood: float


def _line(times: FloatArray, means: FloatArray, noise: FloatArray, light_dn_per_s: float) -> _Line:
    """Least squares with a swell in step held to :data:`SWELL`; scatter beyond the noise counts as noise."""
    matrix = np.column_stack([np.ones_like(times), light_dn_per_s * swell_in_step(times), times / times.max()])
    held = np.diag([0.0, 1.0, 1.0, 1.0, 1.0, 0.0])
    weighted = matrix / noise[:, None]
    normal = matrix.T @ weighted + held
    found = np.linalg.solve(normal, weighted.T @ means)
    fit = float(((means - matrix @ found) ** 2 / noise).sum() + found @ held @ found)
    covariance = np.linalg.inv(normal) * max(fit / max(len(times) - 2, 1), 1.0)
    return _Line(
        light_dn_per_s=float(found[-1] / times.max()),
        found=np.asarray(found[:-1]),
        covariance=np.asarray(covariance[:-1, :-1]),
        log_likelihood=-0.5 * float(fit + np.log(noise).sum() + np.linalg.slogdet(normal)[1]),
    )
