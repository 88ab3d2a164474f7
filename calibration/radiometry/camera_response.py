"""A camera's response from frames of one still picture at several exposures, whatever its tone curve.

Levels are predicted from light: level = S y(t_k (1 + e_k) L_n) + o, with y the curve of :mod:`.tone_curve`, t_k the
exposure of frame k, L_n the light of a group of pixels, e_k a small change of all light in that frame and o what is
left of the black level. What changes is partly the same in all frames of an exposure (the camera's exposure is not what
it says; room light that flickers in step with the projector), partly a frame's own (a lamp). All are fitted together
to the means of groups, each with its own variance. How much a curve may bend, and how much light may change between
frames, is taken from the frames themselves: of a few candidates the one counts under which they are most likely (the
evidence, by Laplace's method). A straight sensor comes out straight, and a tone curve as bent as it is, each with a
standard error that includes what the frames cannot tell.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from calibration.arrays import FloatArray, IntArray
from calibration.errors import CalibrationError
from calibration.radiometry.flicker import InStep
from calibration.radiometry.light_change import (
    MOST_CHANGE,
    ChangeSpread,
    likeliest_change,
    refuse_changes,
    rms_change,
)
from calibration.radiometry.light_groups import USABLE, LightBesides, LightGroups, grouped_by_light
from calibration.radiometry.response import Response
from calibration.radiometry.tone_curve import FAMILIES, KNOTS, CurveBend, Family, ToneCurve, shoulder, tone_curve

_BLACK_SIGMA_DN = 0.05
"""Of the black level, where nothing else is said."""
_USUAL_CHANGE = 0.01
"""Of light between frames: how probable larger ones are held to be falls by e with each step of this size."""
_GAMMAS = (0.33, 3.6)
"""Local gamma of cameras, median over the measured levels: 0.4 to 3, with a margin."""
_MOST_LEFT = 0.02
"""Of full scale, rms: what may be left when one curve is laid through all frames."""
_ROUNDS, _STILL = 25, 1e-5
_FIRST_CHANGE = len(KNOTS) + 1 + 4
"""Of the unknowns but light: after the curve, black and the swell."""
_MOST_ASIDE = 0.9
"""Of its light, by which a pixel is held to differ from its group's: nothing is darker than black."""
_STEEPEST = 2.5
"""Of log local gamma, on the way to the solution: 12, and 1 / 12."""


@dataclass(frozen=True, eq=False, kw_only=True)
class _State:
    """Unknowns of the fit, and the standard that they are beside."""

    standard: FloatArray
    """(P,)"""
    log_gamma: FloatArray
    """(J,)"""
    black: float
    """What is left of the black level, share of full scale."""
    swell: FloatArray
    """(4,) of a swell in step, what is off from what frames of darkness tell."""
    change: FloatArray
    """(F,) logarithm of the change of light in each frame."""
    log_light: FloatArray
    """(G,)"""

    @cached_property
    def curve(self) -> ToneCurve:
        """What local gamma and standard make."""
        return tone_curve(self.log_gamma, self.standard)

    @property
    def curve_part(self) -> FloatArray:
        """(P,) all unknowns but light, in the order of the fields."""
        return np.concatenate([self.log_gamma, [self.black], self.swell, self.change])

    def moved(self, by: FloatArray, light_by: FloatArray) -> _State:
        """With all unknowns changed."""
        j = len(self.log_gamma)
        return replace(
            self,
            log_gamma=np.clip(self.log_gamma + by[:j], -_STEEPEST, _STEEPEST),
            black=self.black + float(by[j]),
            swell=self.swell + by[j + 1 : _FIRST_CHANGE],
            change=self.change + by[_FIRST_CHANGE:],
            log_light=self.log_light + light_by,
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class _Solution:
    state: _State
    curve: ToneCurve
    covariance: FloatArray
    """(P, P) of all unknowns but light, in the order of the state."""
    residual: FloatArray
    """(F, G) of levels, share of full scale; NaN where a group does not count."""
    log_evidence: float
    measured: float
    """Share of full scale up to which levels were measured."""

    @property
    def light_change(self) -> float:
        """Of light between frames, rms."""
        return rms_change(self.state.change)

    @property
    def left(self) -> float:
        """Of full scale, rms, beyond the curve."""
        return float(np.sqrt(np.nanmean(self.residual**2)))


def fit_camera_response(
    levels: ArrayLike,
    exposures: ArrayLike,
    full_scale_dn: float,
    *,
    black_dn: float = 0.0,
    black_sigma_dn: float = _BLACK_SIGMA_DN,
    room: LightBesides | None = None,
) -> Response:
    """Find a camera's curve, straight or with any tone curve, from frames of one still picture.

    Light of full scale is 1. Frames of the same exposure tell the noise from their difference; without any it is
    taken from what is left.

    Parameters
    ----------
    levels : (F, N)
        Digital numbers above black of N pixels in F frames.
    exposures : (F,)
        In any unit and order; equal ones are repeats.
    full_scale_dn : float
        Digital number above black where the sensor clips.
    black_dn : float
        Black level that was subtracted: with it levels are the camera's whole numbers, which tells what rounding did.
    black_sigma_dn : float
        Standard error of the black level that was subtracted, where `room` does not tell it. [dn]
    room : LightBesides or None
        Light beside the picture's, which may swell in step with the frames; exposures are seconds then.

    Returns
    -------
    Response
        513 levels up to full scale with standard errors of their light; the first is where light is 0, which differs
        from 0 by what is left of the black level.

    Raises
    ------
    CalibrationError
        If too few samples lie between noise and clipping, the light or the curve changes between the frames, or the
        exposures cannot be true.

    References
    ----------
    After T. Mitsunaga and S. K. Nayar, Radiometric self calibration, CVPR 1999; P. E. Debevec and J. Malik,
    Recovering high dynamic range radiance maps from photographs, SIGGRAPH 1997.
    """
    times = np.asarray(exposures, dtype=np.float64)
    if not full_scale_dn > 0:
        raise CalibrationError(
            f"the camera's black is where it clips ({full_scale_dn:.3g} dn below full scale are left for light): lower "
            "its black level or offset, or shut out room light"
        )
    groups = grouped_by_light(np.asarray(levels, np.float64), times, full_scale_dn, room, black_dn=black_dn)
    in_step = InStep.unknown(black_sigma_dn) if room is None else room.in_step
    _refuse_few(groups)
    found = [one for family in FAMILIES for one in _solutions(groups, family, in_step.precision(full_scale_dn))]
    sound = [one for one in found if one.light_change <= MOST_CHANGE and one.left <= _MOST_LEFT] or found
    best = max(sound, key=lambda one: one.log_evidence)
    _refuse_changes(groups, best)
    return _response(best, sound, full_scale_dn)


def _solutions(groups: LightGroups, family: Family, of_black: FloatArray) -> Iterator[_Solution]:
    """Solve for each candidate of a family, begun where the one before ended.

    Some bend may explain a curve worse than none, and more bend best: no family is left before its end.
    """
    start = _start(groups, family[0].standard)
    for candidate in family:
        found = _solved(groups, candidate, start, of_black)
        start = found.state
        yield found


def _refuse_few(groups: LightGroups) -> None:
    times = np.unique(groups.log_time[groups.usable.any(axis=1)])
    if len(times) < 2 or groups.usable.sum() < 4:
        raise CalibrationError(
            f"camera response: {int(groups.usable.sum())} groups of usable samples at {len(times)} exposures, at "
            f"least 4 at 2 are needed: the exposures must overlap between {100 * USABLE[0]:g} % and "
            f"{100 * USABLE[1]:g} % of full scale; check exposure range and lamp"
        )


def _start(groups: LightGroups, standard: FloatArray) -> _State:
    """A power law beside a standard, by how fast levels rise with exposure."""
    y, flat = np.maximum(groups.y, 1e-6), np.zeros(len(KNOTS))
    log_y = np.where(groups.usable, tone_curve(flat, standard).log_light_of(y), np.nan)
    time = np.where(groups.usable, groups.log_time[:, None], np.nan)
    off_y, off_time = (v - np.nanmean(v, axis=0) for v in (log_y, time))
    gamma = np.clip(np.nansum(off_time**2) / max(np.nansum(off_time * off_y), 1e-9), 0.1, 10.0)
    log_gamma = flat + np.log(gamma)
    light = tone_curve(log_gamma, standard).log_light_of(y)
    log_light = np.average(light - groups.log_time[:, None], axis=0, weights=np.where(groups.usable, 1.0, 1e-9))
    change, swell = np.zeros(len(groups.log_time)), np.zeros(4)
    return _State(standard=standard, log_gamma=log_gamma, black=0.0, swell=swell, change=change, log_light=log_light)


def _solved(groups: LightGroups, candidate: CurveBend, start: _State, of_black: FloatArray) -> _Solution:
    """Least squares by Gauss-Newton; the change of light between frames is estimated on the way."""
    state, changes = start, ChangeSpread()
    for _ in range(_ROUNDS):
        precision = _prior(candidate, changes.precision(groups.exposure_of), of_black)
        weighed, _ = _weighed(groups, state)
        normal = _normal_equations(weighed, state)
        state, moved = _backtracked(weighed, state, normal.step(precision, state.curve_part), precision)
        changes = _light_change(state, np.asarray(np.linalg.inv(normal.reduced + precision)), groups.exposure_of)
        if moved < _STILL:
            break
    return _judged(state, groups, _prior(candidate, changes.precision(groups.exposure_of), of_black), changes.total)


def _weighed(groups: LightGroups, state: _State) -> tuple[LightGroups, float]:
    """Scale all variances so that they explain what a state leaves; and its likelihood, a logarithm."""
    scatter = groups.scatter(_residual(groups, state))
    scale, log_likelihood = scatter.explained(len(state.log_light) + 2, groups.has_repeats)
    return replace(groups, variance=scale * groups.variance), log_likelihood


def _judged(state: _State, groups: LightGroups, precision: FloatArray, change_sigma: float) -> _Solution:
    """Covariance, scatter and evidence at the solution."""
    weighed, log_likelihood = _weighed(groups, state)
    normal, flat = _normal_equations(weighed, state), state.curve_part
    posterior = normal.reduced + precision
    log_prior = 0.5 * np.linalg.slogdet(precision)[1] - 0.5 * flat @ precision @ flat - change_sigma / _USUAL_CHANGE
    log_volume = 0.5 * np.linalg.slogdet(posterior)[1] + 0.5 * np.log(normal.by_light).sum()
    return _Solution(
        state=state,
        curve=state.curve,
        covariance=np.asarray(np.linalg.inv(posterior)),
        residual=_residual(groups, state),
        log_evidence=float(log_likelihood + log_prior - log_volume),
        measured=groups.brightest,
    )


def _prior(candidate: CurveBend, of_changes: FloatArray, of_black: FloatArray) -> FloatArray:
    """(P, P) precision of all unknowns but light."""
    j, f = len(KNOTS), len(of_changes)
    precision = np.zeros((_FIRST_CHANGE + f,) * 2)
    precision[:j, :j] = candidate.precision
    precision[j:_FIRST_CHANGE, j:_FIRST_CHANGE] = of_black
    precision[_FIRST_CHANGE:, _FIRST_CHANGE:] = of_changes
    return precision


@dataclass(frozen=True, eq=False, kw_only=True)
class _NormalEquations:
    """Of all unknowns; those of light, of which each group has one, are eliminated."""

    reduced: FloatArray
    """(P, P) without light."""
    right: FloatArray
    """(P,)"""
    by_light: FloatArray
    """(G,) diagonal of light."""
    light_right: FloatArray
    """(G,)"""
    coupling: FloatArray
    """(G, P)"""

    def step(self, precision: FloatArray, curve_part: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Of all unknowns but light, and of light."""
        by = np.asarray(np.linalg.solve(self.reduced + precision, self.right - precision @ curve_part))
        return by, (self.light_right - self.coupling @ by) / self.by_light


def _normal_equations(groups: LightGroups, state: _State) -> _NormalEquations:
    curve = state.curve
    log_y = curve.log_level_of(_log_light(groups, state, curve))
    gamma, by_knots = curve.derivatives_at(log_y)
    y = np.exp(log_y)
    weight = np.where(groups.usable, 1 / np.sqrt(groups.variance), 0.0)
    slope = weight * y / gamma
    frames = np.eye(len(groups.log_time))[:, None, :] * slope[..., None]
    swell = groups.swell[:, None, :] * (slope * _room_share(groups, state, curve))[..., None]
    matrix = np.concatenate([-slope[..., None] * by_knots, (weight * (1 - y))[..., None], swell, frames], axis=-1)
    off = weight * np.nan_to_num(_residual(groups, state))
    by_light = (slope**2).sum(axis=0)
    coupling = np.einsum("fgp,fg->gp", matrix, slope)
    light_right = (slope * off).sum(axis=0)
    flat = matrix.reshape(-1, matrix.shape[-1])
    return _NormalEquations(
        reduced=flat.T @ flat - coupling.T @ (coupling / by_light[:, None]),
        right=flat.T @ off.ravel() - coupling.T @ (light_right / by_light),
        by_light=by_light,
        light_right=light_right,
        coupling=coupling,
    )


def _log_light(groups: LightGroups, state: _State, curve: ToneCurve) -> FloatArray:
    swell = groups.swell_found + groups.swell @ state.swell
    room = _room_share(groups, state, curve)
    return np.asarray(groups.log_time[:, None] + state.change[:, None] + state.log_light + swell[:, None] * room)


def _room_share(groups: LightGroups, state: _State, curve: ToneCurve) -> FloatArray:
    """(G,) of each group's light, what is the room's and may swell."""
    log_share = np.minimum(curve.log_light_of(groups.dark) - state.log_light, 0.0)
    return np.where(groups.dark > 0, np.exp(log_share), 0.0)


def _residual(groups: LightGroups, state: _State) -> FloatArray:
    """(F, G) levels that are not explained, share of full scale; NaN where a group does not count."""
    y = _mean_levels(groups, state)
    return np.where(groups.usable, groups.y - y - state.black * (1 - y), np.nan)


def _mean_levels(groups: LightGroups, state: _State) -> FloatArray:
    """(F, G) what the levels of pixels are in the mean whose light differs, by three points of the normal distribution.

    Where a tone curve turns, near black, light differs by more than the turn is long: no second derivative tells it.
    """
    curve = state.curve
    log_light = _log_light(groups, state, curve)
    log_y = curve.log_level_of(log_light)
    y = np.exp(log_y)
    aside = np.minimum(np.sqrt(3) * curve.gamma_at(log_y) * np.sqrt(2 * groups.bent) / y, _MOST_ASIDE)
    brighter, darker = (np.exp(curve.log_level_of(log_light + np.log1p(by))) for by in (aside, -aside))
    return np.asarray((4 * y + brighter + darker) / 6)


def _backtracked(
    groups: LightGroups, state: _State, step: tuple[FloatArray, FloatArray], precision: FloatArray
) -> tuple[_State, float]:
    """Go as far along a step as the fit gets better; the new state, and how far it moved."""
    before = _cost(groups, state, precision)
    for halvings in range(6):
        share = 0.5**halvings
        tried = state.moved(step[0] * share, step[1] * share)
        if _cost(groups, tried, precision) <= before:
            return tried, float(np.abs(step[0]).max() * share)
    return state, 0.0


def _cost(groups: LightGroups, state: _State, precision: FloatArray) -> float:
    flat = state.curve_part
    with np.errstate(over="ignore", invalid="ignore"):  # a step that goes too far is taken back
        squares = _residual(groups, state) ** 2 / groups.variance
    of_levels = np.where(np.isfinite(squares), squares, np.inf)[groups.usable].sum()
    return float(of_levels + flat @ precision @ flat)


def _light_change(state: _State, covariance: FloatArray, exposure_of: IntArray) -> ChangeSpread:
    """What was found, and what may be there unfound."""
    of_changes = covariance[_FIRST_CHANGE:, _FIRST_CHANGE:]
    return likeliest_change(np.outer(state.change, state.change) + of_changes, exposure_of)


def _refuse_changes(groups: LightGroups, found: _Solution) -> None:
    measured = groups.y[groups.usable]
    inside = (found.curve.y > measured.min()) & (found.curve.y < measured.max())
    gamma = float(np.median(found.curve.local_gamma[inside])) if inside.any() else 1.0
    if found.left <= _MOST_LEFT and not _GAMMAS[0] < gamma < _GAMMAS[1]:
        raise CalibrationError(
            f"camera response: levels rise with exposure as by a gamma of {gamma:.2g}, cameras have {_GAMMAS[0]:g} to "
            f"{_GAMMAS[1]:g}: the exposures that the camera tells are wrong, or its automatic exposure or gain is on; "
            "switch it off"
        )
    refuse_changes(found.state.change, groups.log_time, left=found.left, most_left=_MOST_LEFT)


def _response(best: _Solution, found: list[_Solution], full_scale_dn: float) -> Response:
    """The likeliest curve; its errors are those of all curves, by how likely they are."""
    curve, black = best.curve, best.state.black
    odds = np.exp(np.array([one.log_evidence for one in found]) - best.log_evidence)
    away = np.stack([one.curve.log_light - curve.log_light for one in found])
    each = np.stack([_relative_variance(one) for one in found])
    variance = np.average(each + away**2, axis=0, weights=odds)
    levels = full_scale_dn * (curve.y + black * (1 - curve.y))
    return Response(levels, curve.light, best.left, curve.light * np.sqrt(variance))


def _relative_variance(found: _Solution) -> FloatArray:
    """(P,) of light at each level of the curve, with what is not known of the black level."""
    curve, count = found.curve, len(KNOTS) + 1
    by_black = -curve.local_gamma * (1 - curve.y) / np.maximum(curve.y, curve.y[1])
    by = np.concatenate([curve.by_knots, by_black[:, None]], axis=1)
    known = np.einsum("pi,ij,pj->p", by, found.covariance[:count, :count], by)
    of_knots = found.covariance[: len(KNOTS), : len(KNOTS)]
    beyond = curve.by_knots @ shoulder(found.state.log_gamma, of_knots, found.measured)
    return np.asarray(known + beyond**2)
