"""Whether a camera sharpens its pictures: more light beside the edges of checks than in their middles.

A lens takes light away beside an edge; sharpening adds some within a few pixels of the camera's. A checker and its
complement light the room alike, so that their difference is direct light, and every check is held against itself.
"""

from __future__ import annotations

import numpy as np

from calibration.arrays import BoolArray, Float32Array, FloatArray, IntArray
from calibration.light.blur import stretch
from calibration.structured_light.correspondence import Correspondence

_SIDE_PX = 24.0
"""Of a check, in the camera's picture: a quarter of it lies in its middle."""
_BESIDE_PX = ((1.0, 2.0), (2.0, 3.0), (3.0, 4.5))
"""From an edge, in the camera's picture: where sharpening over one, two or three pixels overshoots."""
_MIDDLE_PX = 6.0
"""From every edge: no sharpening reaches so far."""
_LEAST_IN_MIDDLE, _LEAST_BESIDE = 20, 1000
"""Pixels of a check, and of all checks together: on a wall whose texture is 10 % they say 0.4 %."""


def side_px(correspondence: Correspondence) -> int:
    """Return how large checks have to be, even: wide enough in the camera's picture to have a middle."""
    stretched = stretch(correspondence)[correspondence.valid]
    return 2 * int(np.ceil(_SIDE_PX * np.sqrt(np.median(stretched)) / 2)) if len(stretched) else 2


def overshoot_percent(direct: FloatArray | Float32Array, correspondence: Correspondence, side_px: int) -> float | None:
    """Return by how much more direct light there is beside the edges of checks than in their middles.

    Parameters
    ----------
    direct : (H, W)
        A picture of checks less that of their complement, without its sign.
    correspondence : Correspondence
        Which projector pixel each camera pixel sees.
    side_px : int
        Of a check, in projector pixels; the first begins at the picture's corner.

    Returns
    -------
    float or None
        The largest of the medians by distance, in per cent of the middle; not above 0 but for noise, where no camera
        sharpens. None where too few pixels are beside edges, or no check has a middle.
    """
    stretched = stretch(correspondence)
    known = correspondence.valid & (stretched > 0).all(axis=-1)
    xy_px = correspondence.projector_xy_px[known].astype(np.float64) + 0.5
    cells = np.floor(xy_px / side_px).astype(np.intp)
    inside = xy_px - cells * side_px
    to_edge_px = np.minimum(inside, side_px - inside) / np.sqrt(stretched[known])
    number = cells[:, 1] * (int(cells[:, 0].max(initial=0)) + 1) + cells[:, 0]
    is_middle = np.asarray((to_edge_px > _MIDDLE_PX).all(axis=1))
    ratio = _over_middles(direct[known].astype(np.float64), number, is_middle)
    near, other = to_edge_px.min(axis=1), to_edge_px.max(axis=1)
    usable = np.isfinite(ratio) & (other > _MIDDLE_PX)
    bands = [ratio[usable & (near > low) & (near <= high)] for low, high in _BESIDE_PX]
    medians = [float(np.median(band)) for band in bands if len(band) >= _LEAST_BESIDE]
    return 100 * (max(medians) - 1) if medians else None


def _over_middles(light: FloatArray, number: IntArray, is_middle: BoolArray) -> FloatArray:
    """(N,) light over the mean of the middle of the same check; NaN where that is not known."""
    total = np.bincount(number[is_middle], weights=light[is_middle], minlength=int(number.max(initial=0)) + 1)
    count = np.bincount(number[is_middle], minlength=len(total))
    mean = np.where((count >= _LEAST_IN_MIDDLE) & (total > 0), total / np.maximum(count, 1), np.nan)
    return np.asarray(light / mean[number])
