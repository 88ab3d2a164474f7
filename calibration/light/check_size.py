"""How large checks have to be on this rig, from the blur of stripes that are photographed before them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibration.arrays import BoolArray, FloatArray
from calibration.light.blur import PointSpread, footprint_map
from calibration.structured_light.correspondence import Correspondence
from calibration.structured_light.patterns import Pattern

PICTURES_AN_AXIS = 4
"""Of the finest stripes: two and their inverses, or four."""
_TOO_FINE, _LARGE_ENOUGH = 3.0, 4.0
"""Standard deviations of what a camera pixel sees of the picture, in a check. With 3.4 a random rig's direct light is
right to 0.9 %; checks that are too fine are made so large that blur leaves their middles alone."""
_SHARE = 0.9
"""Of the lit pixels that the checks have to suit; the others are at grazing walls."""
_LEAST_CHECKS = 8
"""Along the picture's shorter side: with fewer, light of other walls changes from check to check."""
_BLACK_AND_WHITE = (0, 255)


def finest_stripes(patterns: Sequence[Pattern]) -> list[Pattern]:
    """Return the stripes with the most edges, the same number along columns and rows; none where either is missing."""
    stripes = [pattern for pattern in patterns if np.isin(pattern.codes, _BLACK_AND_WHITE).all()]
    found = []
    for axis in (0, 1):
        counts = [_edges(pattern, axis) for pattern in stripes]
        order = np.argsort([-count for count in counts], kind="stable")[:PICTURES_AN_AXIS]
        found.append([stripes[k] for k in order if counts[k] > 0])
    return found[0] + found[1] if min(map(len, found)) == PICTURES_AN_AXIS else []


def _edges(pattern: Pattern, axis: int) -> int:
    """Changes along the first column (0) or the first row (1)."""
    line = pattern.codes[:, 0] if axis == 0 else pattern.codes[0]
    return int((line[1:] != line[:-1]).sum())


def blur_of_picture_px(spread: PointSpread, correspondence: Correspondence, lit: BoolArray) -> float:
    """Return the standard deviation in projector pixels that nine lit camera pixels out of ten stay below."""
    variance: FloatArray = footprint_map(spread, correspondence).variance_px2[lit & correspondence.valid]
    return float(np.sqrt(np.quantile(variance.max(axis=-1), _SHARE)))


def check_size_px(least_px: int, blur_px: float, projector_shape: tuple[int, int]) -> int:
    """Return the side of a check: as small as was asked for, unless blur makes that too fine; then even.

    Parameters
    ----------
    least_px : int
        What was asked for.
    blur_px : float
        Of :func:`blur_of_picture_px`.
    projector_shape : (height, width)
    """
    if least_px >= _TOO_FINE * blur_px:
        return least_px
    wanted = 2 * int(np.ceil(_LARGE_ENOUGH * blur_px / 2))
    return max(least_px, min(wanted, min(projector_shape) // _LEAST_CHECKS))
