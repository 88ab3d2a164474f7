"""Points that leave their walls by far more than their noise and than real walls are uneven: no flat walls at all."""

from __future__ import annotations

import numpy as np

from calibration.arrays import FloatArray
from calibration.errors import CalibrationError
from calibration.geometry.pinhole import project
from calibration.geometry.room import lit_points
from calibration.geometry.stereo import StereoCalibration

MOST_NOISES, MOST_MISFIT_M = 2.5, 0.015
"""Times what the map's noise leaves, and between points and wall. Fits to 24 rooms left at most 1.2 times; plaster
may be uneven by 10 mm in 4 m (DIN 18202, finished walls). Facets for domes of 3.9 and 4.0 m: 4.3 and 3.5 times."""
_STEP = 1e-4
"""Of a point's distance: of a forward difference."""


def check_walls_fit(pair: StereoCalibration, most_left_px: float) -> None:
    """Refuse walls that the points leave by far more than their noise does, and than walls are uneven.

    Parameters
    ----------
    pair : StereoCalibration
        In metres.
    most_left_px : float
        Largest residual to be expected of a fit to these points, root mean square; NaN where it is not known. [px]

    Raises
    ------
    CalibrationError
        With the residual, what was expected, and the misfit at the walls.
    """
    misfit_m = misfit_at_walls_m(pair)
    if not pair.projector_rms_px > MOST_NOISES * most_left_px or misfit_m <= MOST_MISFIT_M:
        return
    raise CalibrationError(
        f"the points leave the {len(pair.planes)} walls that were found by {pair.projector_rms_px:.2f} px rms, "
        f"{pair.projector_rms_px / most_left_px:.1f} times what their noise explains (limit {MOST_NOISES:g}); at the "
        f"walls that is {1000 * misfit_m:.0f} mm (limit {1000 * MOST_MISFIT_M:g} mm): surfaces are curved, or "
        "something moved while they were photographed. Curved surfaces are not modelled: aim at flat walls, and keep "
        "everything where it is"
    )


def misfit_at_walls_m(pair: StereoCalibration) -> float:
    """Return how far the residual of the projector's pixels is between points and walls, at the median of the points.

    Parameters
    ----------
    pair : StereoCalibration
        In metres, as seen from the camera.
    """
    parallax = _parallax_px_per_m(pair, lit_points(pair), pair.planes[pair.explained.plane])
    return float(np.median(pair.projector_rms_px / parallax))


def _parallax_px_per_m(pair: StereoCalibration, points: FloatArray, planes: FloatArray) -> FloatArray:
    """(N,) by how much a point that the camera sees moves in the projector's picture as its wall does."""
    moved = project(pair.projector, (1 + _STEP) * points) - project(pair.projector, points)
    walls_m = _STEP / np.linalg.norm(planes, axis=1)
    return np.asarray(np.maximum(np.linalg.norm(moved, axis=1) / walls_m, np.finfo(float).tiny))
