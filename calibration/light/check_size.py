"""How large checks have to be on this rig, from the blur of stripes that are photographed before them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calibration.arrays import BoolArray, FloatArray
from calibration.light.blur import PointSpread, footprint_map, stretch
from calibration.structured_light.correspondence import Correspondence
from calibration.structured_light.patterns import Pattern

PICTURES_AN_AXIS = 4
"""Of stripes: two and their inverses, or four."""
_WIDE_ENOUGH_PX = 12
"""Stripes' least width: as :mod:`calibration.light.two_level` needs it for a blur of up to 3 px."""
_TOO_FINE, _LARGE_ENOUGH = 8.0, 9.0
"""Standard deviations of what a camera pixel sees of the picture, in a check. In random rigs' worlds without noise the
bias of direct and global light is 1.7 and 4.1 % at worst with 5.2 to 5.9, 0.6 and 1.3 % with 7, 0.3 and 0.5 % with 8 or
more (`benchmarks/calibration/check_sizes.py`): no lens's blur is a Gaussian, that of rig 7202 was told 7 % too narrow,
and where each pixel of a check has an edge near, direct light follows. Rig 120005, whose camera pixels are as large as
two of the projector's, lost 2.5 % of direct light with 6.6 and 0.6 % with 10 (decision 117)."""
_MIDDLE_SIGMAS, _MIDDLE_PX = 2.0, 0.75
"""From the edges of a check to its middle: of the blur and a camera pixel together, as in
:mod:`calibration.light.cross_check`, and so that each camera pixel lies there in some of the pictures. Where a camera
pixel is as large as two of the projector's, its square is most of the blur, and edges tell of that as of a Gaussian."""
_SHARE = 0.9
"""Of the lit pixels that the checks have to suit; the others are at grazing walls."""
_LEAST_CHECKS = 8
"""Along the picture's shorter side: with fewer, light of other walls changes from check to check."""
_BLACK_AND_WHITE = (0, 255)


def stripes_that_tell(patterns: Sequence[Pattern]) -> list[Pattern]:
    """Return the stripes with the most edges among those wide enough, the same number along columns and rows.

    None where a code has not black and white stripes along both.
    """
    stripes = [pattern for pattern in patterns if np.isin(pattern.codes, _BLACK_AND_WHITE).all()]
    found = []
    for axis in (0, 1):
        edges = [_edges(pattern, axis) for pattern in stripes]
        there = [k for k in range(len(stripes)) if len(edges[k])]
        there.sort(key=lambda k: (-min(_narrowest_px(edges[k]), _WIDE_ENOUGH_PX), -len(edges[k])))
        found.append([stripes[k] for k in there[:PICTURES_AN_AXIS]])
    return found[0] + found[1] if min(map(len, found)) == PICTURES_AN_AXIS else []


def _edges(pattern: Pattern, axis: int) -> NDArray[np.intp]:
    """Places of the changes along the first column (0) or the first row (1)."""
    line = pattern.codes[:, 0] if axis == 0 else pattern.codes[0]
    return np.flatnonzero(line[1:] != line[:-1])


def _narrowest_px(edges: NDArray[np.intp]) -> int:
    """Width of the narrowest stripe between two edges; of a single edge, wide enough."""
    return int(np.diff(edges).min(initial=_WIDE_ENOUGH_PX))


def blur_of_picture_px(spread: PointSpread, correspondence: Correspondence, lit: BoolArray) -> float:
    """Return the standard deviation in projector pixels that nine lit camera pixels out of ten stay below."""
    variance: FloatArray = footprint_map(spread, correspondence).variance_px2[lit & correspondence.valid]
    return float(np.sqrt(np.quantile(variance.max(axis=-1), _SHARE)))


def pixel_of_picture_px(correspondence: Correspondence) -> float:
    """Return the side of a camera pixel in projector pixels that nine out of ten stay below; 0 where none is known."""
    stretched = stretch(correspondence)[correspondence.valid].max(axis=-1)
    return float(np.sqrt(np.quantile(stretched, _SHARE))) if len(stretched) else 0.0


def check_size_px(
    least_px: int, blur_px: float, projector_shape: tuple[int, int], *, camera_pixel_px: float = 0.0
) -> int:
    """Return the side of a check: as small as was asked for, unless blur makes that too fine; then even.

    Parameters
    ----------
    least_px : int
        What was asked for.
    blur_px : float
        Of :func:`blur_of_picture_px`.
    projector_shape : (height, width)
    camera_pixel_px : float
        Of :func:`pixel_of_picture_px`: checks have a middle that no edge reaches.
    """
    with_middle_px = 2 * (_MIDDLE_SIGMAS * float(np.hypot(blur_px, camera_pixel_px)) + _MIDDLE_PX)
    if least_px >= max(_TOO_FINE * blur_px, with_middle_px if camera_pixel_px else 0.0):
        return least_px
    wanted_px = max(large_enough_px(blur_px), 2 * int(np.ceil(with_middle_px / 2)))
    return max(least_px, min(wanted_px, min(projector_shape) // _LEAST_CHECKS))


def large_enough_px(blur_px: float) -> int:
    """Return the side of checks, even, that a blur leaves as they are."""
    return 2 * int(np.ceil(_LARGE_ENOUGH * blur_px / 2))


def why_checks_are_larger(stripes_blur_px: float | None, camera_pixel_px: float | None) -> str:
    """Return what asks for checks of more pixels than a profile says.

    Parameters
    ----------
    stripes_blur_px : float, optional
        By the code's stripes; None where it has none.
    camera_pixel_px : float, optional
        Side of a camera pixel; None in sessions of before it was asked for. [px of the projector]

    Returns
    -------
    str
    """
    blur = (
        None if stripes_blur_px is None else f"by the code's stripes the picture is blurred by {stripes_blur_px:.1f} px"
    )
    pixel = None if camera_pixel_px is None else f"a camera pixel sees {camera_pixel_px:.1f} px of the picture"
    return ", and ".join(filter(None, (blur, pixel)))
