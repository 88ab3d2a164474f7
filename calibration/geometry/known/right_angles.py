"""What rests on right angles that were promised: how far all would move if the walls stood a little askew."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from calibration.arrays import FloatArray
from calibration.geometry.bundle_unknowns import PLANES, unknowns_of
from calibration.geometry.known.nominal import NominalIntrinsics
from calibration.geometry.noise import covariance
from calibration.geometry.plane_bundle import BundleSolution
from calibration.geometry.plane_search import candidates
from calibration.geometry.planes import USUAL_ASKEW_DEG


def by_askew_walls(bundle: BundleSolution, askew_deg: float = USUAL_ASKEW_DEG) -> FloatArray:
    """Return the covariance that a fit's unknowns have because its walls are not as square as it takes them to be.

    Parameters
    ----------
    bundle : BundleSolution
        Of n unknowns; walls on the room's axes are taken to be perpendicular to them.
    askew_deg : float
        Standard deviation of each such wall's two tilts. [degrees]

    Returns
    -------
    (n, n)
        Beside that from noise; zeros of a fit whose walls are free.

    Notes
    -----
    At the solution the slope of half the cost is zero. Tilts t change it by J' W T t, with the derivatives J of the
    residuals by the unknowns, T by the tilts, and weights W; so the solution moves by -H^-1 J' W T t, with H the
    curvature. A wall tilts about the foot of the camera's perpendicular: what else it does, its distance takes up.
    """
    fit = bundle.fit
    n, inverse = len(fit.z), covariance(fit, 1.0)
    free = replace(bundle.error, axes=bundle.with_planes(bundle.planes).axes)
    by_plane = free.jacobian(unknowns_of(bundle.with_planes(bundle.planes), free.nominal))[PLANES:]
    pull = (fit.jacobian * fit.weight[:, None]).reshape(n, -1)
    shifts = [np.zeros((n, 0))]
    for k, axis in enumerate(bundle.axes.of_plane):
        if axis >= 0 and not bundle.axes.turns_freely[k]:
            tilted = np.delete(bundle.axes.directions, axis, axis=0) * np.linalg.norm(bundle.planes[k])
            by_tilt = np.tensordot(tilted, by_plane[3 * k : 3 * k + 3], 1).reshape(2, -1)
            shifts.append(inverse @ pull @ by_tilt.T)
    shift = np.concatenate(shifts, axis=1) * np.radians(askew_deg)
    return np.asarray(shift @ shift.T)


def found_square(
    x1: FloatArray, x2: FloatArray, nominal: NominalIntrinsics, *, right_angles: bool, askew_deg: float
) -> Iterator[BundleSolution]:
    """Yield what the walls may be: searched for as exactly square ones, and free to stand askew from then on.

    Parameters
    ----------
    x1, x2 : (N, 2)
        Corresponding pixels in an order drawn by chance. [px]
    nominal : NominalIntrinsics
        Of both lenses.
    right_angles : bool
        Planes that are nearly perpendicular are so, ...
    askew_deg : float
        ... to within this: standard deviation of each of a plane's two tilts; 0: exactly. [degrees]

    Yields
    ------
    BundleSolution
        The most promising first.
    """
    for bundle in candidates(x1, x2, nominal, right_angles=right_angles):
        yield replace(bundle, axes=replace(bundle.axes, askew_rad=float(np.radians(askew_deg))))
