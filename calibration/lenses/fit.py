"""A fit that finds its own noise: robust first, then least squares without the rows that do not belong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from calibration.arrays import BoolArray, FloatArray
from calibration.lenses.bundle import (
    BEND,
    BOARD,
    LEAST_GAIN,
    PROJECTOR,
    RELATIVE,
    SHARED,
    STRETCH,
    Bundle,
    NormalEquations,
    adjust_bundle,
    by_device,
    linearise,
    normal_equations,
    only,
    residuals,
    row_slices,
    shared_values,
    weights_of,
)
from calibration.lenses.lens import free_parameters
from calibration.lenses.records import POSE, BoardSightings, RigState

CAUCHY = 2.4
"""Scale of the robust loss in standard deviations: Cauchy's loss keeps 95 % of its efficiency on normal noise."""
_OUTLIER = 4.5
"""Length of a residual in standard deviations of one coordinate: exceeded by 4 in 100,000 corners of normal noise."""
_LEAST_OUTLIER_PX = 0.05
"""Below, a residual is no mistake, however small the others are."""
_BAD_VIEW = 5.0
"""Median residual of a view over that of all: further views fit none of the lenses (the camera moved, or zoomed). One
misread corner, as at the rim of a projector's light, would spoil a mean, and the whole view with it."""
_MEDIAN_LENGTH = 1.1774
"""Median length of a two-dimensional normal deviate of standard deviation 1."""
_LEAST_NOISE_PX = 1e-3
_ROUGH, _FAIR = 1e-3, 1e-6
"""Gains at which a fit ends while mistakes are looked for."""
_DOUBTFUL = 1.5
"""Residual of a view over the median of all: above, its other pose is tried."""
_ROBUST_ROUNDS, _CLEAN_ROUNDS = 3, 3


@dataclass(frozen=True, eq=False, kw_only=True)
class Settled:
    """A fit with its noise and its mistakes found."""

    bundle: Bundle
    sightings: BoardSightings
    """Weights are inverse standard deviations [1/px]; 0 where a row is left out."""
    noise_px: FloatArray
    """(devices,) standard deviation of one coordinate."""
    free: BoolArray
    """(S,)"""
    prior: FloatArray
    """(S,) inverse variances of the shared unknowns about zero, from before any view."""

    @property
    def state(self) -> RigState:
        """Lenses and poses."""
        return self.bundle.state

    @property
    def used(self) -> BoolArray:
        """(N, devices) rows that the fit rests on."""
        return weights_of(self.sightings) > 0

    def equations(self) -> NormalEquations:
        """Return the normal equations at the solution, in units of the noise."""
        return self.equations_of(self.sightings, self.state)

    def equations_of(self, sightings: BoardSightings, state: RigState) -> NormalEquations:
        """Return those of other views of the same lenses."""
        known = self.prior[self.free], shared_values(state)[self.free]
        lines = only(linearise(sightings, state), self.free)
        return normal_equations(lines, weights_of(sightings), sightings.view, sightings.views, known=known)


def free_shared(camera: str, projector: str | None, *, flex: bool, stretch: bool = False) -> BoolArray:
    """(S,) shared unknowns that are fitted.

    Parameters
    ----------
    camera, projector : str
        Distortion models of ``TERMS``; no projector: None.
    flex : bool
        Whether the board may be bent.
    stretch : bool
        Whether its squares may be longer than wide.
    """
    free = np.zeros(SHARED, dtype=bool)
    free[: len(free_parameters(camera))] = free_parameters(camera)
    if projector is not None:
        free[PROJECTOR] = free_parameters(projector)
        free[RELATIVE] = True
    free[BEND] = flex
    free[STRETCH] = stretch
    return free


def settle(
    sightings: BoardSightings,
    start: RigState,
    free: BoolArray,
    *,
    prior: FloatArray,
    least_gain: float = LEAST_GAIN,
) -> Settled:
    """Fit until noise, mistakes and lenses agree.

    Parameters
    ----------
    sightings : BoardSightings
        Rows in the order of their views.
    start : RigState
    free : (S,) bool
        Shared unknowns to fit.
    prior : (S,)
        Inverse variances of the shared unknowns about zero, from before any view.
    least_gain : float
        Share of the cost that a step of the last fit has to gain, or the fit ends.

    Returns
    -------
    Settled
    """
    state = start
    weighed, scale = sightings, robust_scales(sightings)
    for _ in range(_ROBUST_ROUNDS):
        weighed = in_noise(sightings, _robust_noise(sightings, state))
        state = adjust_bundle(weighed, state, free, prior=prior, scales_px=scale, steps=25, least_gain=_ROUGH).state
    state = turned_over(weighed, state)
    noise, kept = _robust_noise(sightings, state), weights_of(sightings) > 0
    for _ in range(_CLEAN_ROUNDS):
        kept = _belonging(sightings, state, noise)
        weighed = in_noise(_without(sightings, kept), noise)
        bundle = adjust_bundle(weighed, state, free, prior=prior, least_gain=max(least_gain, _FAIR))
        state, noise = bundle.state, _noise(_without(sightings, kept), bundle, free)
        if (kept == _belonging(sightings, state, noise)).all():
            break
    final = in_noise(_without(sightings, kept), noise)
    bundle = adjust_bundle(final, state, free, prior=prior, least_gain=least_gain)
    return Settled(bundle=bundle, sightings=final, noise_px=noise, free=free, prior=prior)


def turned_over(sightings: BoardSightings, state: RigState) -> RigState:
    """Return the state with views whose board leans the other way, where that fits better.

    A small or distant board looks nearly the same when its tilt is mirrored along the line of sight, so a pose may have
    settled in the wrong one of two minima: D. Oberkampf et al., Computer Vision and Image Understanding 63 (1996).

    Parameters
    ----------
    sightings : BoardSightings
        Weights in units of the noise.
    state : RigState
    """
    rms = _view_miss(sightings, state)
    doubtful = np.flatnonzero(rms > _DOUBTFUL * np.nanmedian(rms))
    if not len(doubtful):
        return state
    part = sightings.of_views(doubtful)
    start = _leaning_back(part, state.of_views(doubtful))
    poses_only = np.zeros(SHARED, dtype=bool)
    scale = robust_scales(part)
    other = adjust_bundle(part, start, poses_only, scales_px=scale, steps=30, least_gain=_FAIR).state
    better = _view_miss(part, other) < rms[doubtful]
    rotations, places = state.rotations.copy(), state.translations_m.copy()
    rotations[doubtful[better]], places[doubtful[better]] = other.rotations[better], other.translations_m[better]
    return replace(state, rotations=rotations, translations_m=places)


def _leaning_back(sightings: BoardSightings, state: RigState) -> RigState:
    """Mirror each board along the line of sight to its middle."""
    middle = np.array([*sightings.half_size_m, 0.0])
    centre = state.rotations @ middle + state.translations_m
    sight = centre / np.linalg.norm(centre, axis=1, keepdims=True)
    mirror = np.eye(3) - 2 * sight[:, :, None] * sight[:, None, :]
    rotations = mirror @ state.rotations @ np.diag([1.0, 1.0, -1.0])
    return replace(state, rotations=rotations, translations_m=centre - rotations @ middle)


def _view_miss(sightings: BoardSightings, state: RigState) -> FloatArray:
    """(V,) median length of the camera's residuals in a view, in units of the noise."""
    return _view_medians(_lengths(sightings, state), weights_of(sightings) > 0, sightings)[:, 0]


def _view_medians(length: FloatArray, there: BoolArray, sightings: BoardSightings) -> FloatArray:
    """(V, devices) median residual length in each view; NaN where there is none."""
    return _view_figures(np.median, length, there, sightings)


def robust_scales(sightings: BoardSightings) -> FloatArray:
    """(devices,) scales of the robust loss, of sightings with weights in units of the noise."""
    return np.full(2 if sightings.has_projector else 1, CAUCHY)


def in_noise(sightings: BoardSightings, noise_px: FloatArray) -> BoardSightings:
    """Return the sightings with weights in units of the noise."""
    return replace(
        sightings,
        camera_weight=sightings.camera_weight / noise_px[0],
        projector_weight=sightings.projector_weight / noise_px[-1],
    )


def _without(sightings: BoardSightings, kept: BoolArray) -> BoardSightings:
    return replace(
        sightings,
        camera_weight=np.where(kept[:, 0], sightings.camera_weight, 0),
        projector_weight=np.where(kept[:, -1], sightings.projector_weight, 0),
    )


def _lengths(sightings: BoardSightings, state: RigState) -> FloatArray:
    """(N, devices) length of each residual, as if it had full weight."""
    length = np.linalg.norm(by_device(residuals(sightings, state)), axis=2)
    return np.asarray(length * np.sqrt(weights_of(sightings)))


def _robust_noise(sightings: BoardSightings, state: RigState) -> FloatArray:
    length, there = _lengths(sightings, state), weights_of(sightings) > 0
    medians = [float(np.median(length[there[:, k], k])) for k in range(length.shape[1])]
    return np.maximum(np.array(medians) / _MEDIAN_LENGTH, _LEAST_NOISE_PX)


def _belonging(sightings: BoardSightings, state: RigState, noise_px: FloatArray) -> BoolArray:
    """(N, devices) rows within the noise, of views that fit."""
    length = _lengths(sightings, state)
    there = weights_of(sightings) > 0
    kept = there & (length < np.maximum(_OUTLIER * noise_px, _LEAST_OUTLIER_PX))
    miss = _view_medians(length, there, sightings)
    bad = (miss > np.maximum(_BAD_VIEW * np.nanmedian(miss, axis=0), _LEAST_OUTLIER_PX)).any(axis=1)
    bad |= _share_kept(kept[:, 0], there[:, 0], sightings) < 0.5
    return np.asarray(kept & ~bad[sightings.view][:, None])


def view_rms(length: FloatArray, there: BoolArray, sightings: BoardSightings) -> FloatArray:
    """(V, devices) root mean square of residual lengths in each view; NaN where there is none."""
    return np.asarray(np.sqrt(_view_figures(np.mean, length**2, there, sightings)))


def _view_figures(
    figure: Callable[[FloatArray], float | np.floating], values: FloatArray, there: BoolArray, sightings: BoardSightings
) -> FloatArray:
    """(V, devices) figure of the values of a view's rows; NaN where there is none."""
    found = np.full((sightings.views, values.shape[1]), np.nan)
    for k, rows in row_slices(sightings.view, sightings.views):
        for device in range(values.shape[1]):
            own = values[rows, device][there[rows, device]]
            if len(own):
                found[k, device] = figure(own)
    return found


def _share_kept(kept: BoolArray, there: BoolArray, sightings: BoardSightings) -> FloatArray:
    counts = [np.bincount(sightings.view, weights=mask, minlength=sightings.views) for mask in (kept, there)]
    return np.asarray(counts[0] / np.maximum(counts[1], 1))


def _noise(kept: BoardSightings, bundle: Bundle, free: BoolArray) -> FloatArray:
    """(devices,) standard deviation of one coordinate, what the unknowns took up allowed for."""
    weight = weights_of(kept)
    squares = (weight * (by_device(bundle.residual) ** 2).sum(axis=2)).sum(axis=0)
    counts = 2 * (weight > 0).sum(axis=0)
    lens = [int(free[: PROJECTOR.start].sum() + free[BOARD].sum()), int(free[PROJECTOR].sum() + free[RELATIVE].sum())]
    poses = POSE * kept.views * counts / max(int(counts.sum()), 1)
    freedom = np.maximum(counts - poses - lens[: len(counts)], 1)
    return np.asarray(np.maximum(np.sqrt(squares / freedom), _LEAST_NOISE_PX))
