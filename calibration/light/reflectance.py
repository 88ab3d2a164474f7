"""The reflectance of every patch of a room, from direct and global light.

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

from calibration.arrays import BoolArray, FloatArray
from calibration.errors import CalibrationError

LEAST_REFLECTANCE, MOST_REFLECTANCE = 0.02, 0.98
"""Of any wall: below is velvet, above is no paint."""
_UNSEEN_SPREAD = 0.05
"""Standard deviation by which unseen patches may differ from the mean of the seen ones."""
_COMMON_REFLECTANCE = 0.6
"""Of a painted wall: where an open scene sends little light around, the flux is all but undetermined, so start here."""
_LEAST_TYPICAL = 0.05
"""Of the median lit patch: bounds the flux from above."""
_UNSEEN_RANGE = (0.05, 0.97)
_GLOBAL_ERROR = 0.02
"""Relative standard deviation of a patch's mean global light: noise and texture within the patch."""
_INDEPENDENT_PATCHES = 50
"""All patches together are worth so many observations: neighbours share their errors."""
_ITERATIONS = 60
"""Of the light's way to and fro: at a mean reflectance of 0.8 what is left after them is 1e-6."""


class ReflectanceSource(IntEnum):
    """What a patch's reflectance rests on."""

    DIRECT = 0
    """Lit and seen."""
    GLOBAL = 1
    """Seen in the light of the others only."""
    UNSEEN = 2
    """The box closes the room there; one common value, from the amount of global light."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ReflectanceFit:
    """Reflectance of every patch and the projector's flux in the camera's unit."""

    reflectance: FloatArray
    """(P,). [1]"""
    source: NDArray[np.uint8]
    """(P,) ReflectanceSource codes."""
    flux: float
    """κ. [camera unit]"""
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

    Returns
    -------
    ReflectanceFit
        With standard deviations of what all patches share.

    Raises
    ------
    CalibrationError
        If no patch is both lit and seen, or the global light cannot be explained by any reflectance.

    References
    ----------
    J. Dehos et al., 2014, doi 10.1007/s10055-013-0233-x, equations 1 and 2: the model that is inverted.
    """
    lit = np.isfinite(direct_over_irradiance) & (np.nan_to_num(direct_over_irradiance) > 0)
    seen = np.isfinite(global_light)
    if not (lit & seen).any():
        raise CalibrationError("no patch is both lit and seen: the camera and the projector look at different places")
    problem = _Room(
        direct_over_irradiance=np.where(lit, direct_over_irradiance, 0.0),
        global_light=np.where(seen, global_light, 0.0),
        lit=lit,
        global_only=seen & ~lit,
        irradiance=irradiance,
        form_factors=form_factors,
    )
    fitted = lit & seen & (global_light > 0)
    typical = float(np.median(direct_over_irradiance[lit]))
    start = np.array([np.log(typical / _COMMON_REFLECTANCE), _COMMON_REFLECTANCE])

    def residual(z: FloatArray) -> FloatArray:
        rho, irradiance_global = problem.solve(float(np.exp(z[0])), float(z[1]))
        expected = rho[fitted] * irradiance_global[fitted]
        error = np.log(global_light[fitted] / np.maximum(expected, 1e-12)) / _GLOBAL_ERROR
        mean = float(np.mean(rho[lit | problem.global_only]))
        return np.concatenate([error / np.sqrt(fitted.sum() / _INDEPENDENT_PATCHES), [(z[1] - mean) / _UNSEEN_SPREAD]])

    fluxes = np.log(typical / MOST_REFLECTANCE), np.log(typical / _LEAST_TYPICAL)
    bounds = ([fluxes[0], _UNSEEN_RANGE[0]], [fluxes[1], _UNSEEN_RANGE[1]])
    result = least_squares(residual, start, bounds=bounds, loss="soft_l1", diff_step=1e-3)
    flux, unseen = float(np.exp(result.x[0])), float(result.x[1])
    rho, irradiance_global = problem.solve(flux, unseen)
    relative = np.log(global_light[fitted] / np.maximum(rho[fitted] * irradiance_global[fitted], 1e-12))
    deviation = np.sqrt(np.diag(np.linalg.pinv(result.jac.T @ result.jac)))
    unlit = np.where(seen, ReflectanceSource.GLOBAL, ReflectanceSource.UNSEEN)
    return ReflectanceFit(
        reflectance=rho,
        source=np.where(lit, ReflectanceSource.DIRECT, unlit).astype(np.uint8),
        flux=flux,
        unseen_reflectance=unseen,
        global_rms=float(np.sqrt(np.mean(relative**2))),
        flux_sigma=float(flux * deviation[0]),
        unseen_sigma=float(deviation[1]),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class _Room:
    direct_over_irradiance: FloatArray
    global_light: FloatArray
    lit: BoolArray
    global_only: BoolArray
    irradiance: FloatArray
    form_factors: FloatArray

    def solve(self, flux: float, unseen: float) -> tuple[FloatArray, FloatArray]:
        """(P,) reflectance and indirect irradiance F B; patches in global light only give their own ρ = g / (F B)."""
        rho = np.where(self.lit, self.direct_over_irradiance / flux, unseen)
        rho = np.clip(rho, LEAST_REFLECTANCE, MOST_REFLECTANCE)
        emission = rho * flux * self.irradiance
        radiosity = emission / (1 - 0.5)  # a mean reflectance of 0.5, to start with
        arriving = self.form_factors @ radiosity
        for _ in range(_ITERATIONS):
            own = self.global_light / np.maximum(arriving, 1e-12)
            rho = np.where(self.global_only, np.clip(own, LEAST_REFLECTANCE, MOST_REFLECTANCE), rho)
            radiosity = rho * (flux * self.irradiance + arriving)
            arriving = self.form_factors @ radiosity
        return rho, arriving
