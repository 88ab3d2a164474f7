"""Coordinates of the code made finer by the light of its own stripes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from calibration import StructuredLightCode
from calibration.errors import CalibrationError
from calibration.light.blur import fit_point_spread
from calibration.light.check_size import stripes_that_tell
from calibration.light.places import LEAST_PAIRS, places_by_light
from calibration.structured_light.correspondence import Correspondence
from calibration.structured_light.patterns import Pattern
from rig.session import Session
from rig.stages.radiometry import load_radiometric_calibration

_INVERSE = "-inverse"
_LIT_SHARE = 0.2
"""Of the brightest tenth: darker pixels say little of the blur."""
_SOFT_PX2 = 4.0
"""Variance of a lens's blur from which stripes tell more of it than of places."""


def finer_places(
    correspondence: Correspondence,
    code: StructuredLightCode,
    frame: Callable[[str], NDArray[np.uint16]],
    session: Session,
) -> Correspondence:
    """Move refined codes to where the light of the stripes says that they are, for codes of stripes and inverses.

    Parameters
    ----------
    correspondence
        Refined over a window.
    code
        That was shown.
    frame
        Gives the (H, W, B) frame of a pattern. [dn]
    session
        With step `response` finished.

    Returns
    -------
    Correspondence
        As it was for any other code, and where the stripes do not tell the blur of the lenses.
    """
    patterns = {pattern.name: pattern for pattern in code.patterns(session.profile.projector.shape)}
    pairs = [each for name, each in patterns.items() if f"{name}{_INVERSE}" in patterns]
    tell = stripes_that_tell(list(patterns.values()))
    if not tell or len(pairs) < 2 * LEAST_PAIRS:
        return correspondence
    radiometric = load_radiometric_calibration(session)
    table = radiometric.table()

    def light(name: str) -> NDArray[np.float32]:
        return np.asarray(table[frame(name)].mean(axis=-1), dtype=np.float32)

    white, black = light("white"), light("black")
    unclipped = (frame("white") < radiometric.saturation_dn).all(axis=-1)
    lit = (white - black > _LIT_SHARE * np.quantile(white - black, 0.9)) & unclipped
    try:
        spread = fit_point_spread(
            [light(each.name) - black for each in tell], [each.codes for each in tell], correspondence, lit
        )
    except CalibrationError:
        return correspondence
    if max(spread.camera.coefficients_px2[0], spread.projector.coefficients_px2[0]) > _SOFT_PX2:
        return correspondence
    differences = [light(each.name) - light(f"{each.name}{_INVERSE}") for each in _stripes(pairs)]
    codes = [each.codes for each in _stripes(pairs)]
    movable = unclipped & ~_is_whole(correspondence)
    return places_by_light(differences, codes, correspondence, spread, movable)


def _stripes(pairs: list[Pattern]) -> list[Pattern]:
    return [each for each in pairs if np.isin(each.codes, (0, 255)).all()]


def _is_whole(correspondence: Correspondence) -> NDArray[np.bool_]:
    """(H, W) pixels whose code was not refined: beside edges, where the blur mixes two walls."""
    xy = correspondence.projector_xy_px
    with np.errstate(invalid="ignore"):
        return np.asarray((np.abs(xy * 2 - np.round(xy * 2)) < 1e-6).all(axis=-1))
