"""The reflectance of every patch of a room, from direct and global light.

Camera value at pixel x that sees patch i, projector white: direct d = V_c V_p ρ_i κ e, global g = V_c ρ_i (F B)_i, with
B = E + ρ F B (the paper's eqs. 1, 2), E_i = ρ_i κ e_i; e is the irradiance of unit flux, geometry only. Direct light
alone gives the products ρ κ; only the amount of global light tells κ, and with it the reflectance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.sparse import csr_array, eye_array

from calibration.arrays import BoolArray, FloatArray
from calibration.errors import CalibrationError
from calibration.light.alike import Alike, expected_reflectance

LEAST_REFLECTANCE, MOST_REFLECTANCE = 0.02, 0.98
"""Of any wall: below is velvet, above is no paint."""
_UNSEEN_SPREAD = 0.03
"""Standard deviation by which an unseen patch differs from what is unseen of its wall: texture is some percent."""
COMMON_REFLECTANCE = 0.6
"""Of a painted wall: where an open scene sends little light around, the flux is all but undetermined, so start here."""
COMMON_SPREAD = 0.2
"""Standard deviation of that among painted walls."""
_COARSE_MISFIT = 0.05
"""Relative residual of global light that patches a fourteenth of the room wide leave in rooms that are right."""
_LEAST_TYPICAL = 0.05
"""Of the median lit patch: bounds the flux from above."""
_UNSEEN_RANGE = (0.05, 0.97)
_GLOBAL_ERROR = 0.02
"""Relative standard deviation of a patch's mean global light: noise and texture within the patch."""
_INDEPENDENT_PATCHES = 12
"""All patches together are worth so many observations: what the model is too coarse for is alike in neighbours, and
half a percent of it in all."""
_FAR_OFF = 0.03
"""Of a patch's global light, relative, from which on it counts less: its seen part may be a corner of it."""
_STEP, _STEP_OF_NOTHING = 1e-3, 0.1
"""Of an unknown, by which it is moved for a slope; of one that is nearly 0, as if it were so large."""
_REFITS, _MOST_MISFIT = 3, 1.5
_DIRECT_ERROR = 0.018
"""Relative standard deviation of a patch's mean direct light: what is not seen of it differs from what is."""
_GLOBAL_ALONE = 0.06
"""Relative standard deviation of a reflectance that the light of all others tells: 0.05 (rms) on bent things of five
simulated rooms."""
_MOSTLY = 0.5
"""Told by global light, from which on a patch does not tell whether the room's light is explained."""
_ITERATIONS = 60
"""Of the light's way to and fro: at a mean reflectance of 0.8 what is left after them is 1e-6."""
_FIRST = 2.0
"""Radiosity over emission, to start with: of a mean reflectance of 0.5."""
_SETTLED = 1e-8
"""Of the most light that arrives anywhere: what one more way to and fro may change when they end. Slopes are taken over
steps of 1e-3, so that they are true to 1e-5."""


class ReflectanceSource(IntEnum):
    """What a patch's reflectance rests on."""

    DIRECT = 0
    """Lit and seen."""
    GLOBAL = 1
    """Seen in the light of the others only."""
    UNSEEN = 2
    """The box closes the room there; one value a wall, from the global light and what is seen of that wall."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ReflectanceFit:
    """Reflectance of every patch and the projector's flux in the camera's unit."""

    reflectance: FloatArray
    """(P,). [1]"""
    source: NDArray[np.uint8]
    """(P,) ReflectanceSource codes."""
    flux: float
    """κ. [camera unit]"""
    sigma: FloatArray
    """(P,) standard deviation of each patch's reflectance."""
    unseen_reflectance: float
    """Mean over the unseen patches."""
    global_rms: float
    """Relative residual of the global light over lit, seen patches."""
    flux_sigma: float
    unseen_sigma: float
    usual_misfit: float = 0.0
    """As `global_rms`, but patches that are far off count less: what most of them leave."""
    returned_share: float = 0.0
    """Of a lone wall's mean radiosity, what arrives at it again, evenly, from surfaces that the model has not."""
    lit_part: FloatArray | None = None
    """(P,) reflectance of each patch's lit part over the whole patch's, or by how much more light it gets of the
    projector than its slant says; None: all alike."""


def arriving_light(fit: ReflectanceFit, irradiance: FloatArray, form_factors: FloatArray) -> FloatArray:
    """Return (P,) indirect irradiance of white on each patch by a fit, of e (P,) and F (P, P), in the camera's unit."""
    rho = fit.reflectance
    emission = rho * fit.flux * irradiance * (1.0 if fit.lit_part is None else fit.lit_part)
    radiosity = np.linalg.solve(np.eye(len(rho)) - rho[:, None] * form_factors, emission)
    return np.asarray(form_factors @ radiosity)


def lit_and_seen(direct_over_irradiance: FloatArray, global_light: FloatArray) -> tuple[BoolArray, BoolArray]:
    """(P,) patches that the projector lights, and (P,) that the camera sees.

    Raises
    ------
    CalibrationError
        If no patch is both.
    """
    lit = np.isfinite(direct_over_irradiance) & (np.nan_to_num(direct_over_irradiance) > 0)
    seen = np.isfinite(global_light)
    if not (lit & seen).any():
        raise CalibrationError(
            "no patch is both lit and seen: the camera and the projector look at different places; aim both at one wall"
        )
    return lit, seen


def estimate_reflectance(
    direct_over_irradiance: FloatArray,
    global_light: FloatArray,
    irradiance: FloatArray,
    form_factors: FloatArray,
    *,
    wall: NDArray[np.integer] | None = None,
    seen_from: FloatArray | csr_array | None = None,
    alike: Alike | None = None,
    irradiance_error: FloatArray | None = None,
) -> ReflectanceFit:
    """Solve the inverse radiosity problem of a room that is partly lit and partly seen.

    The flux and one reflectance for what is unseen of each wall are fitted to the global light of the patches that are
    lit and seen; a wall's unseen part is expected to be like its seen part, a wall that nobody sees like the others, a
    thing's back like its front.

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
    wall : (P,) int, optional
        Of each patch; default: all are of one.
    seen_from : (P, P), optional
        Weights of the patches' irradiance where the camera saw a patch: it may have seen a part of it only. Default:
        its own.
    alike
        What the surfaces that `wall` numbers are to each other; default: all are walls.
    irradiance_error : (P,), optional
        Relative standard deviation of `irradiance`, where a patch's slant to the light is badly known: there, global
        light tells more of its reflectance than direct light does. Default: 0.

    Returns
    -------
    ReflectanceFit
        With standard deviations.

    Raises
    ------
    CalibrationError
        If no patch is both lit and seen, or the global light cannot be explained by any reflectance.

    References
    ----------
    J. Dehos et al., 2014, doi 10.1007/s10055-013-0233-x, equations 1 and 2: the model that is inverted.
    """
    lit, seen = lit_and_seen(direct_over_irradiance, global_light)
    n = len(irradiance)
    walls = np.zeros(n, dtype=np.intp) if wall is None else np.asarray(wall, dtype=np.intp)
    problem = _Room(
        direct_over_irradiance=np.where(lit, direct_over_irradiance, 0.0),
        global_light=np.where(seen, global_light, 0.0),
        lit=lit,
        seen=seen,
        irradiance=irradiance,
        form_factors=form_factors,
        wall=walls,
        alike=Alike.only_walls(int(walls.max()) + 1) if alike is None else alike,
        seen_from=eye_array(n, format="csr") if seen_from is None else seen_from,
        irradiance_error=np.zeros(n) if irradiance_error is None else irradiance_error,
    )
    typical = float(np.median(direct_over_irradiance[lit]))
    lower = np.concatenate([[np.log(typical / MOST_REFLECTANCE)], np.full(problem.n_walls, _UNSEEN_RANGE[0])])
    upper = np.concatenate([[np.log(typical / _LEAST_TYPICAL)], np.full(problem.n_walls, _UNSEEN_RANGE[1])])
    start = np.concatenate([[np.log(typical / COMMON_REFLECTANCE)], np.full(problem.n_walls, COMMON_REFLECTANCE)])
    for _ in range(_REFITS):
        bounds = _Bounds(lower, upper)
        result = least_squares(problem.residual, start, _slopes_of(problem, bounds), bounds=bounds, loss="soft_l1")
        found = problem.fit(result.x, np.asarray(np.linalg.pinv(result.jac.T @ result.jac)))
        if found.global_rms <= _MOST_MISFIT * problem.global_error:
            break
        # The model of the room explains the light less well than it should: it decides less, the prior more.
        problem, start = replace(problem, global_error=found.global_rms), result.x
    return found


class _Bounds(NamedTuple):
    lower: FloatArray
    upper: FloatArray


def _slopes_of(problem: _Room, bounds: _Bounds) -> Callable[[FloatArray], FloatArray]:
    """The Jacobian of the residual by differences: rooms of all unknowns moved one by one are solved together."""

    def slopes(z: FloatArray) -> FloatArray:
        step = _STEP * np.maximum(np.abs(z), _STEP_OF_NOTHING)
        step = np.where(z + step > bounds.upper, -step, step)
        moved = np.column_stack([z, z[:, None] + np.diag(step)])
        rho, arriving = problem.solve_all(moved)
        residual = np.stack(
            [problem.residual_of(moved[:, k], rho[:, k], arriving[:, k]) for k in range(moved.shape[1])], axis=1
        )
        return np.asarray((residual[:, 1:] - residual[:, :1]) / step)

    return slopes


@dataclass(frozen=True, eq=False, kw_only=True)
class _Room:
    """What was measured; z is the logarithm of the flux, then the unseen reflectance of each wall."""

    direct_over_irradiance: FloatArray
    global_light: FloatArray
    lit: BoolArray
    seen: BoolArray
    irradiance: FloatArray
    form_factors: FloatArray
    wall: NDArray[np.intp]
    alike: Alike
    seen_from: FloatArray | csr_array
    irradiance_error: FloatArray
    global_error: float = _GLOBAL_ERROR

    @property
    def n_walls(self) -> int:
        return len(self.alike.front)

    @cached_property
    def fitted(self) -> BoolArray:
        """(P,) patches whose global light is held against the model; all that are lit and seen where none is flat."""
        by_direct = self.told_twice & (self.by_global < _MOSTLY)
        return np.asarray(by_direct if by_direct.any() else self.told_twice)

    @cached_property
    def told_twice(self) -> BoolArray:
        """(P,) patches of which direct and global light tell."""
        return np.asarray(self.lit & self.seen & (self.global_light > 0))

    @cached_property
    def global_only(self) -> BoolArray:
        return np.asarray(self.seen & ~self.lit)

    @cached_property
    def by_global(self) -> FloatArray:
        """(P,) how much of a reflectance's logarithm global light tells: by the inverse of variances."""
        share = self.irradiance_error**2 / (self.irradiance_error**2 + _GLOBAL_ALONE**2)
        return np.where(self.told_twice, share, self.global_only)

    def residual(self, z: FloatArray) -> FloatArray:
        return self.residual_of(z, *self.solve(z))

    def residual_of(self, z: FloatArray, rho: FloatArray, arriving: FloatArray) -> FloatArray:
        error = self.global_errors(rho, arriving) / self.global_error
        expected, spread = expected_reflectance(rho, self.lit | self.global_only, surface=self.wall, alike=self.alike)
        typical = (rho[self.lit].mean() - COMMON_REFLECTANCE) / COMMON_SPREAD
        return np.concatenate(
            [
                error / np.sqrt(max(self.fitted.sum() / _INDEPENDENT_PATCHES, 1.0)),
                (z[1:] - expected) / spread,
                [typical],
            ]
        )

    def _lit_part(self, z: FloatArray, rho: FloatArray) -> FloatArray | None:
        """(P,) what lit patches send of the projector's light over what their reflectance says; None: as much."""
        bent = self.lit & (self.by_global > 0)
        return np.where(bent, self.told_first(z[:, None])[:, 0] / rho, 1.0) if bent.any() else None

    def global_errors(self, rho: FloatArray, arriving: FloatArray) -> FloatArray:
        """Logarithm of measured over modelled global light of the fitted patches."""
        modelled = rho[self.fitted] * arriving[self.fitted]
        return np.asarray(np.log(self.global_light[self.fitted] / np.maximum(modelled, 1e-12)))

    @cached_property
    def _asked(self) -> tuple[NDArray[np.intp], FloatArray | csr_array]:
        """(A,) numbers of the patches of which global light tells, and (A, P) rows of `seen_from`."""
        asked = np.flatnonzero(self.by_global > 0)
        return asked, self.seen_from[asked]

    @cached_property
    def _settled(self) -> dict[str, FloatArray]:
        """(P,) F B of the room solved last, from which the light of the next one, nearly the same, settles sooner."""
        return {}

    def solve(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(P,) reflectance and indirect irradiance F B where seen; patches in global light only give ρ = g / (F B)."""
        rho, arriving = self.solve_all(z[:, None])
        return rho[:, 0], arriving[:, 0]

    def solve_all(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(P, K) the same of K columns of unknowns: one product of matrices costs far less than K with vectors."""
        flux = np.exp(z[0])
        lit, (asked, seen_from) = self.lit[:, None], self._asked
        by_global, global_light = self.by_global[asked, None], self.global_light[asked, None]
        direct = self.told_first(z)
        rho = direct.copy()
        lighting = flux * self.irradiance[:, None]
        arriving = self._settled["FB"][:, None] if self._settled else self.form_factors @ (_FIRST * rho * lighting)
        for _ in range(_ITERATIONS):
            if len(asked):
                own = global_light / np.maximum(seen_from @ arriving, 1e-12)
                own = np.clip(own, LEAST_REFLECTANCE, MOST_REFLECTANCE)
                rho[asked] = direct[asked] * (own / direct[asked]) ** by_global
            # what a lit patch sends out of the projector's light was measured, whatever its slant
            radiosity = np.where(lit, direct, rho) * lighting + rho * arriving
            before, arriving = arriving, self.form_factors @ radiosity
            if np.abs(arriving - before).max() <= _SETTLED * arriving.max():
                break
        self._settled["FB"] = arriving[:, 0]
        return rho, np.asarray(self.seen_from @ arriving)

    def told_first(self, z: FloatArray) -> FloatArray:
        """(P, K) reflectance of K columns of unknowns, as direct light or the wall tells it."""
        direct = self.direct_over_irradiance[:, None] / np.exp(z[0])
        return np.clip(np.where(self.lit[:, None], direct, z[1:][self.wall]), LEAST_REFLECTANCE, MOST_REFLECTANCE)

    def fit(self, z: FloatArray, covariance: FloatArray) -> ReflectanceFit:
        """The result, with what the covariance of z makes of every patch."""
        rho, arriving = self.solve(z)
        errors = self.global_errors(rho, arriving)
        rms = float(np.sqrt(np.mean(errors**2)))
        # A misfit beyond that of coarse patches is a wrong room: it does not average out, and the flux bears it.
        covariance = covariance.copy()
        covariance[0, 0] += max(rms - _COARSE_MISFIT, 0.0) ** 2
        steps = np.sqrt(np.maximum(np.diag(covariance), 1e-12))
        moves = 0.1 * steps
        turned = ((self.solve_all(z[:, None] + np.diag(moves))[0] - rho[:, None]) / moves).T
        of_lit = rho * np.hypot(_DIRECT_ERROR, np.sqrt(self.by_global) * _GLOBAL_ALONE)
        own = np.where(self.lit, of_lit, np.where(self.seen, self.global_error * rho, _UNSEEN_SPREAD))
        variance = np.einsum("zp,zy,yp->p", turned, covariance, turned) + own**2
        unseen = ~self.lit & ~self.seen
        unlit = np.where(self.seen, ReflectanceSource.GLOBAL, ReflectanceSource.UNSEEN)
        shares = np.bincount(self.wall[unseen], minlength=self.n_walls) / max(int(unseen.sum()), 1)
        return ReflectanceFit(
            reflectance=rho,
            source=np.where(self.lit, ReflectanceSource.DIRECT, unlit).astype(np.uint8),
            sigma=np.sqrt(variance),
            flux=float(np.exp(z[0])),
            unseen_reflectance=float(rho[unseen].mean()) if unseen.any() else float(rho.mean()),
            global_rms=rms,
            usual_misfit=float(_FAR_OFF * np.sqrt(np.mean(2 * (np.hypot(1.0, errors / _FAR_OFF) - 1)))),
            flux_sigma=float(np.exp(z[0]) * steps[0]),
            unseen_sigma=float(np.sqrt(shares @ covariance[1:, 1:] @ shares)),
            lit_part=self._lit_part(z, rho),
        )
