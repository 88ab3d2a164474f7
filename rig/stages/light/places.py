"""Coordinates of the code made finer by the light of its own stripes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration import StructuredLightCode
from calibration.errors import CalibrationError
from calibration.light.blur import fit_point_spread
from calibration.light.check_size import stripes_that_tell
from calibration.light.places import LEAST_PAIRS, blur_as_window_px2, places_by_light
from calibration.structured_light.correspondence import Correspondence
from calibration.structured_light.subpixel import WINDOW_VARIANCE_PX2, refine_subpixel
from rig.session import Session
from rig.stages.radiometry import load_radiometric_calibration
from rig.stages.stripes.reading import INVERSE

_LIT_SHARE = 0.2
"""Of the brightest tenth: darker pixels say little of the blur."""
_SOFT_PX2 = 4.0
"""Variance of a lens's blur from which stripes tell more of it than of places."""


@dataclass(frozen=True)
class FinerPlaces:
    """Coordinates, and over how wide a part of the camera's picture they are means."""

    correspondence: Correspondence
    averaged_px2: float
    """Variance of that window along each axis, what blur comes to included. [px² of the camera]"""


def finer_places(
    correspondence: Correspondence,
    code: StructuredLightCode,
    frame: Callable[[str], NDArray[np.uint16]],
    session: Session,
) -> FinerPlaces:
    """Refine codes over a window; those of stripes and inverses then move to where the light of the stripes puts them.

    Parameters
    ----------
    correspondence
        As it was decoded.
    code
        That was shown.
    frame
        Gives the (H, W, B) frame of a pattern. [dn]
    session
        With step `response` finished.

    Returns
    -------
    FinerPlaces
        By the window alone for any other code, and where the stripes do not tell the blur of the lenses.
    """
    refined = refine_subpixel(correspondence)
    by_window = FinerPlaces(refined, 0.0 if refined is correspondence else WINDOW_VARIANCE_PX2)
    patterns = {pattern.name: pattern for pattern in code.patterns(session.profile.projector.shape)}
    pairs = [each for name, each in patterns.items() if f"{name}{INVERSE}" in patterns]
    tell = stripes_that_tell(list(patterns.values()))
    if not tell or len(pairs) < 2 * LEAST_PAIRS:
        return by_window
    radiometric = load_radiometric_calibration(session)
    table = radiometric.table()

    def light(name: str) -> NDArray[np.float32]:
        return np.asarray(table[frame(name)].mean(axis=-1), dtype=np.float32)

    white, black = light("white"), light("black")
    unclipped = (frame("white") < radiometric.saturation_dn).all(axis=-1)
    lit = (white - black > _LIT_SHARE * np.quantile(white - black, 0.9)) & unclipped
    try:
        spread = fit_point_spread(
            [light(each.name) - black for each in tell], [each.codes for each in tell], refined, lit
        )
    except CalibrationError:
        return by_window
    if max(spread.camera.coefficients_px2[0], spread.projector.coefficients_px2[0]) > _SOFT_PX2:
        return by_window
    stripes = [each for each in pairs if np.isin(each.codes, (0, 255)).all()]
    differences = [light(each.name) - light(f"{each.name}{INVERSE}") for each in stripes]
    codes = [each.codes for each in stripes]
    movable = unclipped & ~_is_whole(refined)
    return FinerPlaces(
        places_by_light(differences, codes, refined, spread, movable=movable), averaged_px2=blur_as_window_px2(spread)
    )


def _is_whole(correspondence: Correspondence) -> NDArray[np.bool_]:
    """(H, W) pixels whose code was not refined: beside edges, where the blur mixes two walls."""
    xy = correspondence.projector_xy_px
    with np.errstate(invalid="ignore"):
        return np.asarray((np.abs(xy * 2 - np.round(xy * 2)) < 1e-6).all(axis=-1))
