"""What a camera reads without any light, from frames of projector black at several exposures."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from calibration.arrays import FloatArray

_CLIPPED_SHARE, _BELOW, _WELL_ABOVE = 0.3, 0.02, 0.01
"""Of pixels: so many at one level, hardly one below and some more than one step above it, so noise is cut off there."""
_ROUNDING_VARIANCE = 1 / 12
_FLICKER = 0.02
"""Of the light on black, from exposure to exposure, where nothing is known of it."""
_IN_STEP_S = 0.1 / (2 * np.pi * 100)
"""Times the light on black a second: what room light that swells by a tenth 100 times a second adds to each frame alike
where it runs in step with them, however long they are. No exposure tells it from the black level."""


@dataclass(frozen=True, kw_only=True)
class BlackLevel:
    """A camera's reading without light."""

    offset_dn: float
    sigma_dn: float
    """Standard error."""
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
    """
    frames, times = np.asarray(levels, dtype=np.float64), np.asarray(exposures, dtype=np.float64)
    shortest = frames[times == times.min()]
    lowest = float(np.quantile(shortest, 0.05, method="lower"))
    if _is_clipped(shortest, lowest):
        return BlackLevel(offset_dn=lowest, sigma_dn=float(np.sqrt(_ROUNDING_VARIANCE)), is_clipped=True)
    means = frames.mean(axis=1)
    rounding = 0.05 * np.exp(-4 * np.pi**2 * np.maximum(frames.var(axis=1) - _ROUNDING_VARIANCE, 0))
    variance = frames.var(axis=1) / frames.shape[1] + rounding + 1e-8
    found = _extended(times, means, variance)
    # all frames of a camera without noise are rounded alike
    return replace(found, sigma_dn=float(np.hypot(found.sigma_dn, np.sqrt(rounding.min()))))


def _is_clipped(shortest: FloatArray, lowest: float) -> bool:
    at_lowest = float((shortest == lowest).mean())
    return bool(
        at_lowest > _CLIPPED_SHARE
        and (shortest < lowest).mean() < _BELOW
        and (shortest > lowest + 1.5).mean() > _WELL_ABOVE
    )


def _extended(times: FloatArray, means: FloatArray, variance: FloatArray) -> BlackLevel:
    """Weighted straight line; room light that flickers makes long exposures less certain."""
    if len(np.unique(times)) < 2:
        sigma = float(np.sqrt(variance.mean() / len(means)))
        return BlackLevel(offset_dn=float(means.mean()), sigma_dn=sigma, is_clipped=False)
    matrix = np.column_stack([np.ones_like(times), times / times.max()])
    line = np.array([means.min(), max(float(np.ptp(means)), 0.0)])
    for _ in range(3):
        weight = 1 / np.sqrt(variance + (_FLICKER * line[1] * matrix[:, 1]) ** 2)
        line = np.linalg.lstsq(matrix * weight[:, None], means * weight, rcond=None)[0]
    covariance = np.linalg.pinv((matrix * weight[:, None]).T @ (matrix * weight[:, None]))
    scatter = float((((means - matrix @ line) * weight) ** 2).sum() / max(len(times) - 2, 1))
    sigma = float(np.sqrt(covariance[0, 0] * max(scatter, 1.0)))
    in_step = _IN_STEP_S * max(float(line[1]), 0.0) / float(times.max())
    return BlackLevel(offset_dn=float(line[0]), sigma_dn=float(np.hypot(sigma, in_step)), is_clipped=False)
