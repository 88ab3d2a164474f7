"""Vignetting of both lenses, and the reflectance of every patch of a room, from direct and global light.

Camera value at pixel x that sees patch i, projector white: direct d = V_c V_p ρ_i κ e, global g = V_c ρ_i (F B)_i, with
B = E + ρ F B (the paper's eqs. 1, 2), E_i = ρ_i κ e_i; e is the irradiance of unit flux, geometry only. Direct light
alone gives the products ρ κ; only the amount of global light tells κ, and with it the reflectance.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from calibration.records import BoolArray, CalibrationError, FloatArray

LEAST_REFLECTANCE, MOST_REFLECTANCE = 0.02, 0.98
_UNSEEN_SPREAD = 0.05
"""Standard deviation by which unseen patches may differ from the mean of the seen ones."""


@dataclass(frozen=True, slots=True)
class Vignetting:
    """Relative illumination 1 + v2 r² + v4 r⁴ of each lens, r = distance from the axis / half diagonal."""

    camera: tuple[float, float]
    projector: tuple[float, float]
    rms: float
    """Residual, relative: what the walls' texture leaves."""


def fit_vignetting(
    gain: FloatArray, irradiance: FloatArray, face: NDArray[np.integer], camera_r: FloatArray, projector_r: FloatArray
) -> Vignetting:
    """Both lenses' radial fall-off and one reflectance level a face, by robust least squares of log(d / e).

    Assumes that within a face the reflectance has no trend along either lens's radius; texture averages out.

    Parameters
    ----------
    gain : (N,)
        Direct light d of white at sample pixels, above 0.
    irradiance : (N,)
        e at the same surface points, above 0.
    face : (N,) int
        Index of the wall.
    camera_r, projector_r : (N,)
        Distances from each lens's axis over half its diagonal.
    """
    _, group = np.unique(face, return_inverse=True)
    ratio = np.log(gain / irradiance)
    levels = np.array([np.median(ratio[group == k]) for k in range(group.max() + 1)])

    def residual(z: FloatArray) -> FloatArray:
        fit = z[4:][group] + np.log(_illumination(z[:2], camera_r)) + np.log(_illumination(z[2:4], projector_r))
        # Ties that matter only where the data say nothing: lenses darken outwards by some tens of percent.
        return np.concatenate([ratio - fit, np.sqrt(len(ratio)) * 0.02 * z[:4]])

    result = least_squares(residual, np.concatenate([np.zeros(4), levels]), loss="soft_l1", f_scale=0.05)
    rms = float(np.sqrt(np.mean(residual(result.x)[: len(ratio)] ** 2)))
    v = [float(value) for value in result.x[:4]]
    return Vignetting((v[0], v[1]), (v[2], v[3]), rms)


def _illumination(v: FloatArray, r: FloatArray) -> FloatArray:
    return np.asarray(np.maximum(1 + r**2 * (v[0] + r**2 * v[1]), 0.05))


class Source(IntEnum):
    """What a patch's reflectance rests on."""

    DIRECT = 0
    """Lit and seen."""
    GLOBAL = 1
    """Seen in the light of the others only."""
    UNSEEN = 2
    """The box closes the room there; one common value, from the amount of global light."""


@dataclass(frozen=True, eq=False)
class ReflectanceFit:
    """Reflectance of every patch and the projector's flux in the camera's unit."""

    reflectance: FloatArray
    """(P,)."""
    source: NDArray[np.uint8]
    """(P,) Source codes."""
    flux: float
    """κ."""
    unseen_reflectance: float
    global_rms: float
    """Relative residual of the global light over lit, seen patches."""
    flux_sigma: float
    unseen_sigma: float


def estimate_reflectance(
    direct_over_irradiance: FloatArray,
    global_light: FloatArray,
    irradiance: FloatArray,
    form_factors: FloatArray,
    iterations: int = 60,
) -> ReflectanceFit:
    """Solve the inverse radiosity problem of a room that is partly lit and partly seen.

    Parameters
    ----------
    direct_over_irradiance : (P,)
        ρ_i κ of patches that are lit and seen, NaN elsewhere. [camera unit]
    global_light : (P,)
        Mean global radiosity of patches that are seen, NaN elsewhere. [camera unit]
    irradiance : (P,)
        Mean e of each patch, its unlit part counted as 0.
    form_factors : (P, P)
        F[i, j], share of the power leaving i that reaches j.

    Raises
    ------
    CalibrationError
        If no patch is both lit and seen, or the global light cannot be explained by any reflectance.
    """
    lit = np.isfinite(direct_over_irradiance) & (np.nan_to_num(direct_over_irradiance) > 0)
    seen = np.isfinite(global_light)
    if not (lit & seen).any():
        raise CalibrationError("no patch is both lit and seen: the camera and the projector look at different places")
    problem = _Room(
        np.where(lit, direct_over_irradiance, 0.0),
        np.where(seen, global_light, 0.0),
        lit,
        seen & ~lit,
        irradiance,
        form_factors,
        iterations,
    )
    fitted = lit & seen & (global_light > 0)
    typical = float(np.median(direct_over_irradiance[lit]))
    # An open scene sends little light around: there the flux is all but undetermined, so start from a common wall.
    start = np.array([np.log(typical / 0.6), 0.6])

    def residual(z: FloatArray) -> FloatArray:
        rho, irradiance_global = problem.solve(float(np.exp(z[0])), float(z[1]))
        expected = rho[fitted] * irradiance_global[fitted]
        error = np.log(global_light[fitted] / np.maximum(expected, 1e-12)) / 0.02
        mean = float(np.mean(rho[lit | problem.global_only]))
        return np.concatenate([error / np.sqrt(fitted.sum() / 50), [(z[1] - mean) / _UNSEEN_SPREAD]])

    bounds = ([np.log(typical / MOST_REFLECTANCE), 0.05], [np.log(typical / 0.05), 0.97])
    result = least_squares(residual, start, bounds=bounds, loss="soft_l1", diff_step=1e-3)
    flux, unseen = float(np.exp(result.x[0])), float(result.x[1])
    rho, irradiance_global = problem.solve(flux, unseen)
    relative = np.log(global_light[fitted] / np.maximum(rho[fitted] * irradiance_global[fitted], 1e-12))
    deviation = np.sqrt(np.diag(np.linalg.pinv(result.jac.T @ result.jac)))
    source = np.where(lit, Source.DIRECT, np.where(seen, Source.GLOBAL, Source.UNSEEN)).astype(np.uint8)
    return ReflectanceFit(
        rho, source, flux, unseen, float(np.sqrt(np.mean(relative**2))), float(flux * deviation[0]), float(deviation[1])
    )


@dataclass(frozen=True, eq=False)
class _Room:
    direct_over_irradiance: FloatArray
    global_light: FloatArray
    lit: BoolArray
    global_only: BoolArray
    irradiance: FloatArray
    form_factors: FloatArray
    iterations: int

    def solve(self, flux: float, unseen: float) -> tuple[FloatArray, FloatArray]:
        """(P,) reflectance and indirect irradiance F B; patches in global light only give their own ρ = g / (F B)."""
        rho = np.where(self.lit, self.direct_over_irradiance / flux, unseen)
        rho = np.clip(rho, LEAST_REFLECTANCE, MOST_REFLECTANCE)
        emission = rho * flux * self.irradiance
        radiosity = emission / (1 - 0.5)
        arriving = self.form_factors @ radiosity
        for _ in range(self.iterations):
            own = self.global_light / np.maximum(arriving, 1e-12)
            rho = np.where(self.global_only, np.clip(own, LEAST_REFLECTANCE, MOST_REFLECTANCE), rho)
            radiosity = rho * (flux * self.irradiance + arriving)
            arriving = self.form_factors @ radiosity
        return rho, arriving
