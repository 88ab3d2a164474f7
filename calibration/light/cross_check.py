"""Whether pictures of checks agree with the direct light that was made of all of them.

The known pattern, its blur and a pixel's direct light say what each picture should be. Two things say that something
else changed them: the middle of checks, where no edge reaches, gives another direct light (a camera sharpens, or a lens
has halos), and one picture is brighter or darker than the others make of it (somebody stood in the light).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.arrays import BoolArray, Codes, Float32Array, FloatArray, IntArray
from calibration.light.blur import pixels_inside, stretch
from calibration.light.two_level import Footprint, shares_and_slopes, two_level
from calibration.structured_light.correspondence import Correspondence

_MARGINS_PX = (2.0, 1.5, 1.25, 1.0)
"""Of the camera, or of the projector where its pixels are larger: standard deviation of what is added to the blur to
tell which pixels lie in the middle of a check; the widest of which enough samples have a middle."""
MIDDLE = 0.025
"""Share of another check in the middle of one: two such standard deviations from its edges."""
_LEAST_WITH_MIDDLE = 0.3
"""Of the samples."""
_SAMPLES, LEAST_SAMPLES = 20_000, 200
_EDGE_PX = 8.0
"""From the border of the projector's picture, behind which is no check."""


@dataclass(frozen=True, eq=False, kw_only=True)
class CrossCheck:
    """What pictures of checks leave of the light that was made of them."""

    middle_percent: float | None
    """Direct light by the middles of checks alone, less that by all frames; None where checks are too small to have a
    middle. [% of direct light]"""
    off_percent: FloatArray
    """(K,) by how much each picture is brighter than the others make of it. [% of direct light]"""
    rms_ratio: FloatArray
    """(K,) what is left of each picture, rms, over what is left of the middle one of all pictures."""


def cross_check(
    frames: Sequence[Float32Array],
    patterns: Sequence[Codes],
    correspondence: Correspondence,
    *,
    seen: Footprint,
    direct: Float32Array,
    usable: BoolArray,
) -> CrossCheck | None:
    """Hold pictures of checks against the direct light that was made of them.

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
        Direct light of white.
    usable : (H, W)
        Pixels whose direct light is known and not small.

    Returns
    -------
    CrossCheck or None
        None where fewer than 200 pixels tell.
    """
    stretched = stretch(correspondence)
    at = sampled_pixels(seen, stretched, correspondence.projector_shape, usable=usable, most=_SAMPLES)
    if len(at[0]) < LEAST_SAMPLES:
        return None
    pictures = [two_level(codes) for codes in patterns]
    light, wanted = np.stack([frame[at] for frame in frames]).astype(np.float64), direct[at].astype(np.float64)
    xy_px, variance_px2 = seen.xy_px[at].astype(np.float64), seen.variance_px2[at].astype(np.float64)

    def shares(more_px2: FloatArray | float) -> FloatArray:
        wider = Footprint(xy_px=xy_px, variance_px2=variance_px2 + more_px2)
        return np.asarray(shares_and_slopes(pictures, wider, order=0)[0])

    wide_px2 = np.maximum(stretched[at], 1.0)
    middles = (_by_middles(light, shares(margin**2 * wide_px2), wanted) for margin in _MARGINS_PX)
    left = _left(light, shares(0.0), wanted)
    rms = np.sqrt((left**2).mean(axis=1))
    return CrossCheck(
        middle_percent=next((100 * found for found in middles if found is not None), None),
        off_percent=100 * left.mean(axis=1),
        rms_ratio=rms / max(float(np.median(rms)), 1e-12),
    )


def sampled_pixels(
    seen: Footprint, stretched: FloatArray, projector_shape: tuple[int, int], *, usable: BoolArray, most: int
) -> tuple[IntArray, IntArray]:
    """Choose rows and columns of usable pixels, (N,) each, that see the picture's checks away from its border."""
    told = usable & (stretched > 0).all(axis=-1)
    return pixels_inside(seen.xy_px, projector_shape, told, edge_px=_EDGE_PX, most=most)


def _by_middles(light: FloatArray, wide: FloatArray, direct: FloatArray) -> float | None:
    """Share by which the middles of checks have more direct light; None where too few samples have them."""
    bright, dark = wide > 1 - MIDDLE, wide < MIDDLE
    both = np.flatnonzero(bright.any(axis=0) & dark.any(axis=0))
    if len(both) < max(_LEAST_WITH_MIDDLE * len(direct), LEAST_SAMPLES):
        return None
    mean = [(light * part)[:, both].sum(axis=0) / part[:, both].sum(axis=0) for part in (bright, dark)]
    return float((mean[0] - mean[1]).sum() / direct[both].sum() - 1)


def _left(light: FloatArray, share: FloatArray, direct: FloatArray) -> FloatArray:
    """(K, N) what direct light leaves of the light, as a share of it; each pixel's constant light is its median."""
    rest = light - share * direct
    return np.asarray((rest - np.median(rest, axis=0)) / direct)
