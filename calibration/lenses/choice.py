"""How many terms of distortion a lens needs: judged on views that were left out of the fit.

A model that is too rich follows the noise; one that is too lean is sure of what it does not know (its sigmas hold
only if the terms that it lacks are zero). So the usual four terms are taken unless left-out views speak against them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtrit

from calibration.arrays import FloatArray, IntArray
from calibration.lenses.bundle import SHARED, adjust_bundle, by_device, residuals, row_slices, weights_of
from calibration.lenses.fit import Settled, in_noise, robust_scales
from calibration.lenses.lens import TERMS
from calibration.lenses.records import BoardSightings, RigState

_FOLDS = 5
_FOLDED_VIEWS = 20
"""With more views than this, two folds tell as much as five."""
_CLIP = 7.0
"""Standard deviations at which a left-out residual stops counting more: a mistake is no lens."""
USUAL = "k1k2p1p2"
"""Distortion model that is taken unless views speak against it."""
_SURE = 0.99
"""Probability with which another model has to predict better than the usual one (Student's t over the views)."""
_HARM = 1.05
"""How much worse the usual model has to predict before a leaner one is taken: three needless terms cost far less, and
their lack was seen to put principal points off by three of their sigmas."""
_EQUAL = 1.02
"""Of the best model's error: richer than the usual one, and no worse than this, the leanest is taken."""
_FAIR = 1e-5
"""Share of the cost below which a step no longer decides between models."""

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
    """Choose the usual distortion model, or another that predicts left-out views clearly better.

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
        scores.append(_score(model, sightings, fits[model], device=device))
    chosen = _chosen(scores)
    return chosen.model, fits[chosen.model], tuple(scores)


def _chosen(scores: list[ModelScore]) -> ModelScore:
    """The usual model if it predicts as well as the best; else the leanest that does, on the best one's side of it."""
    best = min(scores, key=lambda score: float(np.nanmean(score.of_views)))
    usual = next((score for score in scores if score.model == USUAL), best)
    if _as_good(usual, best):
        return usual
    if scores.index(best) > scores.index(usual):
        return next(score for score in scores[scores.index(usual) :] if score.left_out_px <= _EQUAL * best.left_out_px)
    if usual.left_out_px < _HARM * best.left_out_px:
        return usual
    return next(score for score in scores if _as_good(score, best))


def _as_good(score: ModelScore, best: ModelScore) -> bool:
    with np.errstate(divide="ignore", invalid="ignore"):
        worse = np.log(score.of_views / best.of_views)  # or a few poor views would hide what all of them say
    worse = worse[np.isfinite(worse)]
    if len(worse) < 2:
        return True
    error = float(worse.std(ddof=1)) / np.sqrt(len(worse))
    return bool(float(worse.mean()) <= float(stdtrit(len(worse) - 1, _SURE)) * error)


def folds_of(views: int) -> list[IntArray]:
    """Views to leave out, fold by fold."""
    count = min(views, _FOLDS) if views <= _FOLDED_VIEWS else 2
    return [np.arange(k, views, count) for k in range(count)]


def _score(model: str, sightings: BoardSightings, fit: Settled, *, device: int) -> ModelScore:
    squares = left_out_squares(sightings, fit, device=device)
    return ModelScore(model, float(np.sqrt(np.nanmean(squares))), squares)


def left_out_squares(sightings: BoardSightings, fit: Settled, *, device: int) -> FloatArray:
    """Return the mean square residual (V,) of each view while it only gives its pose, mistakes clipped.

    Parameters
    ----------
    sightings : BoardSightings
        All rows, with their own weights.
    fit : Settled
        To all of them.
    device : int
        Whose residuals: 0 the camera, 1 the projector.
    """
    squares = np.full(sightings.views, np.nan)
    for left_out in folds_of(sightings.views):
        rest = np.setdiff1d(np.arange(sightings.views), left_out)
        others = fit.sightings.of_views(rest)
        lenses = adjust_bundle(others, fit.state.of_views(rest), fit.free, prior=fit.prior, least_gain=_FAIR).state
        squares[left_out] = _squares(sightings.of_views(left_out), lenses, fit, views=left_out, device=device)
    return squares


def _squares(rows: BoardSightings, lenses: RigState, fit: Settled, *, views: IntArray, device: int) -> FloatArray:
    if device == 1 and not rows.has_projector:  # it lights none of these views: they say nothing of its lens
        return np.full(rows.views, np.nan)
    near = fit.state.of_views(views)
    start = replace(lenses, rotations=near.rotations, translations_m=near.translations_m)
    poses_only = np.zeros(SHARED, dtype=bool)
    weighed = in_noise(rows, fit.noise_px)
    state = adjust_bundle(weighed, start, poses_only, scales_px=robust_scales(rows), steps=15, least_gain=_FAIR).state
    length = np.linalg.norm(by_device(residuals(rows, state)), axis=2)[:, device]
    squares = np.minimum(length, _CLIP * float(fit.noise_px[device])) ** 2
    there = weights_of(rows)[:, device] > 0
    means = [squares[r][there[r]].mean() if there[r].any() else np.nan for _, r in row_slices(rows.view, rows.views)]
    return np.asarray(means)
