"""Pixels of about one light as one: means of their levels in each frame, and how well these are known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.arrays import BoolArray, FloatArray, IntArray
from calibration.radiometry.flicker import InStep, swell_in_step
from calibration.radiometry.rounding import ROUNDING_VARIANCE, rounding_bias

_GROUPS, _GROUP_PIXELS = 80, 30
"""Of pixels of about one light: rounding averages out in each, and its noise is known."""
USABLE = (0.005, 0.97)
"""Shares of full scale between which a group counts: below is rounding, above it may clip in one of the frames."""
_NOISE_CLEAR = 3.0
"""Standard deviations of a pixel's noise that a group stays away from black, where tone curves cut noise off."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LightBesides:
    """What else than the picture lights the pixels, and may swell in step with the frames."""

    dark: FloatArray
    """(N,) levels above black of the pixels in darkness, at the longest exposure. [dn]"""
    in_step: InStep
    """What frames of darkness tell of black and of the swell."""


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


def grouped_by_light(
    levels: FloatArray, times: FloatArray, full_scale_dn: float, room: LightBesides | None = None
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
    rounding = rounding_bias(mean, spread, size)
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
