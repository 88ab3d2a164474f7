"""Vignetting of both lenses: how their light falls off towards the corners, from direct light on the walls."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from calibration.arrays import FloatArray

_OUTLIER = 0.05
"""Logarithm of light off the fit from which on a sample counts less: painted walls vary by some percent."""
_PRIOR = np.array([-0.15, 0.0, -0.15, 0.0])
_PRIOR_WEIGHT = np.array([0.04, 0.2, 0.04, 0.2])
"""Of (v2, v4) of both lenses, a coefficient of 1 against the samples: lenses darken by some tens of percent towards
their corners, nearly as r². It decides only where the samples say nothing."""
_ONE_WALL_WEIGHT = 0.5
"""Of all four where only one wall is seen: there both radii grow together, and a wrong distance looks like a lens."""
_LEAST_ILLUMINATION = 0.05
"""Below, a trial of the fit is no lens."""


@dataclass(frozen=True, slots=True)
class Vignetting:
    """Relative illumination 1 + v2 r² + v4 r⁴ of each lens, r = distance from the axis / half diagonal."""

    camera: tuple[float, float]
    projector: tuple[float, float]
    rms: float
    """Residual, relative: what the walls' texture leaves."""


def fit_vignetting(
    gain: FloatArray,
    irradiance: FloatArray,
    *,
    face: NDArray[np.integer],
    camera_r: FloatArray,
    projector_r: FloatArray,
) -> Vignetting:
    """Fit both lenses' radial fall-off and one reflectance level a face, by robust least squares of log(d / e).

    Assumes that within a face the reflectance has no trend along either lens's radius; texture averages out.

    Parameters
    ----------
    gain : (N,)
        Direct light d of white at sample pixels, above 0. [camera unit]
    irradiance : (N,)
        e at the same surface points, above 0.
    face : (N,) int
        Index of the wall.
    camera_r, projector_r : (N,)
        Distances from each lens's axis over half its diagonal. [1]

    Returns
    -------
    Vignetting
        (v2, v4) of each lens.
    """
    _, group = np.unique(face, return_inverse=True)
    ratio = np.log(gain / irradiance)
    weight = _PRIOR_WEIGHT if group.max() > 0 else np.full(4, _ONE_WALL_WEIGHT)
    levels = np.array([np.median(ratio[group == k]) for k in range(group.max() + 1)])

    def off(z: FloatArray) -> FloatArray:
        return ratio - z[4:][group] - np.log(_illumination(z[:2], camera_r) * _illumination(z[2:4], projector_r))

    def residual(z: FloatArray, loss: Callable[[FloatArray], FloatArray]) -> FloatArray:
        # What is known beforehand is no outlier, however far off the samples are: only they are robust.
        return np.concatenate([loss(off(z)) / np.sqrt(len(ratio)), weight * (z[:4] - _PRIOR)])

    start = least_squares(residual, np.concatenate([_PRIOR, levels]), args=(_soft,)).x
    # A poster is no wall with a trend: what lies far off does not count at all.
    result = least_squares(residual, start, args=(_cauchy,))
    rms = float(np.sqrt(np.mean(off(result.x) ** 2)))
    v = [float(value) for value in result.x[:4]]
    return Vignetting((v[0], v[1]), (v[2], v[3]), rms)


def _illumination(v: FloatArray, r: FloatArray) -> FloatArray:
    return np.asarray(np.maximum(1 + r**2 * (v[0] + r**2 * v[1]), _LEAST_ILLUMINATION))


def _soft(off: FloatArray) -> FloatArray:
    """Residuals whose squares grow as far outliers do."""
    return np.asarray(np.sign(off) * _OUTLIER * np.sqrt(2 * (np.hypot(1.0, off / _OUTLIER) - 1)))


def _cauchy(off: FloatArray) -> FloatArray:
    """Residuals whose squares hardly grow any more far off."""
    return np.asarray(np.sign(off) * _OUTLIER * np.sqrt(np.log1p((off / _OUTLIER) ** 2)))
