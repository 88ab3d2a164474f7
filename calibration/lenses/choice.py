"""How many terms of distortion a lens needs: as many as predict views that were left out of the fit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from calibration.arrays import FloatArray, IntArray
from calibration.lenses.bundle import SHARED, adjust_bundle, by_device, residuals, row_slices, weights_of
from calibration.lenses.fit import Settled, in_noise
from calibration.lenses.lens import TERMS
from calibration.lenses.records import BoardSightings, RigState

_FOLDS = 5
_FOLDED_VIEWS = 20
"""With more views than this, two folds tell as much as five."""
_CLIP = 5.0
"""Standard deviations at which a left-out residual stops counting more: a mistake is no lens."""
_SURE = 1.0
"""Standard errors by which a richer model has to predict better than a leaner one."""

Attempt = Callable[[str, BoardSightings, RigState | None], Settled]
"""Fits a model to sightings, from a state of the same views or from none."""


@dataclass(frozen=True, eq=False)
class ModelScore:
    """How a distortion model does on views that it was not fitted to."""

    model: str
    left_out_px: float
    """RMS of a corner of a view that only gave its pose."""
    of_views: FloatArray
    """(V,) mean square of each view. [px²]"""


def choose_model(
    sightings: BoardSightings,
    attempt: Attempt,
    models: tuple[str, ...] = tuple(TERMS),
    *,
    device: int = 0,
) -> tuple[str, Settled, tuple[ModelScore, ...]]:
    """Choose the leanest distortion model that predicts left-out views as well as the best.

    Parameters
    ----------
    sightings : BoardSightings
        Rows in the order of their views.
    attempt : callable (model, sightings, start or None) -> Settled
    models : tuple of str
        Names of ``TERMS`` from lean to rich.
    device : int
        Whose residuals judge: 0 the camera, 1 the projector.

    Returns
    -------
    str, Settled, tuple of ModelScore
        The model, its fit to all views, and the scores of all models.
    """
    fits: dict[str, Settled] = {}
    scores: list[ModelScore] = []
    start: RigState | None = None
    for model in models:
        fits[model] = attempt(model, sightings, start)
        start = fits[model].state
        scores.append(_score(model, sightings, fits[model], attempt=attempt, device=device))
    best = min(scores, key=lambda score: float(np.nanmean(score.of_views)))
    chosen = next(score.model for score in scores if score is best or _as_good(score, best))
    return chosen, fits[chosen], tuple(scores)


def _as_good(lean: ModelScore, best: ModelScore) -> bool:
    worse = lean.of_views - best.of_views
    worse = worse[np.isfinite(worse)]
    error = float(worse.std(ddof=1)) / np.sqrt(len(worse)) if len(worse) > 1 else 0.0
    return bool(float(worse.mean()) <= _SURE * error)


def folds_of(views: int) -> list[IntArray]:
    """Views to leave out, fold by fold."""
    count = min(views, _FOLDS) if views <= _FOLDED_VIEWS else 2
    return [np.arange(k, views, count) for k in range(count)]


def _score(model: str, sightings: BoardSightings, fit: Settled, *, attempt: Attempt, device: int) -> ModelScore:
    squares = np.full(sightings.views, np.nan)
    noise = float(fit.noise_px[device])
    for left_out in folds_of(sightings.views):
        rest = np.setdiff1d(np.arange(sightings.views), left_out)
        fitted = attempt(model, sightings.of_views(rest), fit.state.of_views(rest))
        squares[left_out] = left_out_squares(fitted, sightings, fit.state, views=left_out, device=device, noise=noise)
    return ModelScore(model, float(np.sqrt(np.nanmean(squares))), squares)


def left_out_squares(
    fitted: Settled, sightings: BoardSightings, near: RigState, *, views: IntArray, device: int, noise: float
) -> FloatArray:
    """(len(views),) mean square residual of views whose poses alone are fitted, mistakes clipped. [px²]"""
    rows = sightings.of_views(views)
    start = with_poses(fitted.state, near.of_views(views))
    weighed = in_noise(rows, fitted.noise_px)
    scales = np.full(len(fitted.noise_px), 2.4)
    state = adjust_bundle(weighed, start, np.zeros(SHARED, dtype=bool), scales_px=scales, steps=15, least_gain=1e-5).state
    length = np.linalg.norm(by_device(residuals(rows, state)), axis=2)[:, device]
    squares = np.minimum(length, _CLIP * 1.4 * noise) ** 2
    there = weights_of(rows)[:, device] > 0
    means = [squares[r][there[r]].mean() if there[r].any() else np.nan for _, r in row_slices(rows.view, rows.views)]
    return np.asarray(means)


def with_poses(lenses: RigState, poses: RigState) -> RigState:
    """Return the lenses of one state with the poses of another."""
    return replace(lenses, rotations=poses.rotations, translations_m=poses.translations_m)
