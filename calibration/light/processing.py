"""What a camera's own processing, JPEG above all, leaves of pictures with edges, which is no noise of its sensor.

Photographs of one picture that are compressed alike are wrong alike: no repeat tells it, and no mean takes it away. In
the middle of a check, where no edge reaches, a pixel's light is the same in every picture of checks; how its blocks
are compressed is not.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from calibration.arrays import BoolArray, Codes, Float32Array, FloatArray, IntArray
from calibration.light.blur import stretch
from calibration.light.cross_check import LEAST_SAMPLES, MIDDLE, sampled_pixels
from calibration.light.two_level import Footprint, shares_and_slopes, two_level
from calibration.structured_light.correspondence import Correspondence

_SAMPLES, _LEAST_FRAMES = 5000, 4
"""Pixels, and pictures of a check's lit middle each: a variance of all is then known to a few per cent."""
_KEPT = 0.98
"""Of the pixels, those that vary least: the others saw something else."""
_SWEEPS = 5
"""Over pictures and pixels in turn, each of which sees some of the others."""
_CLEAR = 1.5
"""Times the variance that a sensor's noise lets expect: raw frames of three random rigs have 0.81 to 0.92, JPEG of nine
of quality 76 to 93 2 to 24."""


@dataclass(frozen=True, eq=False)
class MiddleScatter:
    """Light of pixels while they are in the lit middle of a check."""

    at: tuple[IntArray, IntArray]
    """Rows and columns."""
    light: FloatArray
    """(N,) mean."""
    variance: FloatArray
    """(N,) from picture to picture, beside what all of them share."""

    def beyond(self, variance: FloatArray, per_dn: FloatArray) -> float:
        """Return how many digital numbers processing adds, rms; 0 where noise alone explains all.

        Parameters
        ----------
        variance : (N,)
            Of the light, by the sensor's noise.
        per_dn : (N,)
            Light of a digital number there.
        """
        kept = self.variance <= np.quantile(self.variance, _KEPT) if len(self.variance) else np.zeros(0, bool)
        seen, expected = self.variance[kept].sum(), variance[kept].sum()
        if not seen > _CLEAR * expected:
            return 0.0
        return float(np.sqrt((seen - expected) / (per_dn[kept] ** 2).sum()))


def scatter_in_middles(
    frames: Iterable[Float32Array],
    patterns: Sequence[Codes],
    correspondence: Correspondence,
    *,
    seen: Footprint,
    direct: Float32Array,
    usable: BoolArray,
) -> MiddleScatter:
    """Measure how a pixel's light varies over the pictures of checks in which it lies in a lit middle.

    Parameters
    ----------
    frames : (K of) (H, W)
        Linear light above black.
    patterns : (K of) (h, w)
        The codes that were shown, 0 or 255.
    correspondence : Correspondence
        Which projector pixel each camera pixel sees.
    seen : Footprint
        (H, W, 2) what each pixel sees of the projector's picture.
    direct : (H, W)
        Direct light of white: what a pixel's share of a check changes by is taken out.
    usable : (H, W)
        Pixels that may be asked.

    Returns
    -------
    MiddleScatter
        Of no pixel where fewer than 200 lie in a middle four times.
    """
    shape = correspondence.projector_shape
    at = sampled_pixels(seen, stretch(correspondence), shape, usable=usable, most=_SAMPLES)
    places = Footprint(xy_px=seen.xy_px[at].astype(np.float64), variance_px2=seen.variance_px2[at])
    share = shares_and_slopes([two_level(codes) for codes in patterns], places, order=0)[0]
    lit = share > 1 - MIDDLE
    count = lit.sum(axis=0)
    enough = count >= _LEAST_FRAMES
    if enough.sum() < LEAST_SAMPLES:
        enough[:] = False
    whole = np.stack([frame[at] for frame in frames]) + (1 - share) * direct[at]
    light, lit, count = whole[:, enough], lit[:, enough], count[enough]
    mean = np.where(lit, light, 0.0).sum(axis=0) / count
    off = np.where(lit, light / mean - 1, 0.0)
    for _ in range(_SWEEPS):
        # What all pixels of a picture share is the lamp's, or a room light's.
        for axis in (1, 0):
            shared = off.sum(axis=axis, keepdims=True) / np.maximum(lit.sum(axis=axis, keepdims=True), 1)
            off = np.where(lit, off - shared, 0.0)
    return MiddleScatter((at[0][enough], at[1][enough]), mean, mean**2 * (off**2).sum(axis=0) / (count - 1))
