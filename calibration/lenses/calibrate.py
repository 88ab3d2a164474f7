"""Lenses from boards: choose the terms, fit everything together, say how sure it is, refuse what is not determined."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from calibration.arrays import BoolArray, FloatArray, IntArray
from calibration.errors import CalibrationError
from calibration.lenses.bundle import BEND, STRETCH, adjust_bundle, by_device, residuals, weights_of
from calibration.lenses.choice import USUAL, ModelScore, choose_model, left_out_squares
from calibration.lenses.fit import Settled, free_shared, settle
from calibration.lenses.lens import TERMS, FittedLens, ideal_coordinates, project_points
from calibration.lenses.prior import no_prior, prior_of
from calibration.lenses.records import FLEX, BoardSightings, LensCalibration, RigState
from calibration.lenses.refusals.lit_views import refuse_unlike_boards
from calibration.lenses.refusals.undetermined import refuse_undetermined
from calibration.lenses.start import camera_guesses, guess_poses, moved_projector, with_projector
from calibration.lenses.uncertainty import Confidence, confidence_of, pixel_grid

LEAST_VIEWS = 3
"""Of a flat board, for a focal length and a principal point: Z. Zhang, IEEE PAMI 22 (2000)."""
_CHOICE_VIEWS = 30
"""On which the distortion model is chosen; more change the choice rarely and its time always."""
_GUESSES = 3
"""Guessed lenses that are fitted, the best of all guesses."""
_SHIFTS = ((0.0, 0.0), (0.0, 0.5), (0.0, -0.5), (0.25, 0.0))
"""Other starts of the projector's principal point, from the first one, as shares of its picture's size."""
_FACTORS = (1.0, 0.7, 1.4)
"""Other starts of focal lengths."""
_TELLING_VIEWS = 6
"""From so many views on they alone tell which terms a lens has and whether the board is bent; with fewer the usual
terms and the bend are fitted beside what is known of them beforehand (tests/calibration/lenses/test_few_views.py)."""
_STRETCHED = 3.0
"""Standard deviations by which a board's squares have to be longer than wide, or they are taken as square."""
_FAIR = 1e-5
"""Share of the cost below which a step no longer decides between models."""
_SURE = 1.0
"""Standard errors by which a bend has to improve left-out views."""


@dataclass(frozen=True, kw_only=True)
class LensRequest:
    """What is to be calibrated."""

    camera_size_px: tuple[int, int]
    """(width, height)"""
    projector_size_px: tuple[int, int] | None = None
    camera_model: str | None = None
    """Distortion model of ``TERMS``; None: chosen by left-out views."""
    projector_model: str | None = None
    flex: bool | None = None
    """Whether the board may be bent; None: decided by left-out views, or open where there are few."""

    def models_of(self, fixed: str | None, views: int) -> tuple[str, ...]:
        """Return the distortion models to choose from, of a device whose profile may have fixed one.

        Parameters
        ----------
        fixed : str or None
            Name of the model that is wanted; None: any.
        views : int
            Of the board.

        Returns
        -------
        tuple of str
            From lean to rich; with few views no leaner ones than the usual one, with fewer still that one alone.
        """
        if fixed is not None:
            return (fixed,)
        models = tuple(TERMS)
        if views >= _TELLING_VIEWS:
            return models
        richer = models[models.index(USUAL) :]
        return richer if views > LEAST_VIEWS else richer[:1]


@dataclass(frozen=True, eq=False, kw_only=True)
class LensFit:
    """A calibration, and how its model was chosen."""

    calibration: LensCalibration
    settled: Settled
    camera_scores: tuple[ModelScore, ...]
    projector_scores: tuple[ModelScore, ...]
    starts: int
    """From how many starts the last fit was made."""
    starts_agree_px: float
    """Largest difference of any two of their lenses over the pictures, of those that end at the lowest cost."""
    worse_starts: int
    """Starts that ended in another minimum of higher cost."""


def calibrate_lenses(
    sightings: BoardSightings,
    request: LensRequest,
    *,
    names: tuple[str, ...] = (),
    on_step: Callable[[int, int], None] = lambda _done, _total: None,
) -> LensFit:
    """Calibrate a camera, and a projector that lights the boards, from corners of boards.

    Parameters
    ----------
    sightings : BoardSightings
        Rows in the order of their views.
    request : LensRequest
    names : tuple of str
        Of the views, for messages.
    on_step : callable (done, total)

    Returns
    -------
    LensFit

    Raises
    ------
    CalibrationError
        Too few views, or views that leave a lens undetermined; the message says which and why.

    References
    ----------
    Z. Zhang, A flexible new technique for camera calibration, IEEE PAMI 22 (2000); D. Moreno and G. Taubin, Simple,
    accurate, and robust projector-camera calibration, 3DIMPVT 2012.
    """
    _refuse_few(sightings.views)
    some = _spread_views(sightings.views, _CHOICE_VIEWS)
    model, shape, fit, scores = _camera_alone(sightings.of_views(some).camera_only(), request)
    on_step(1, 4)
    state = _all_views(sightings, some, fit.state)
    projector: str | None = None
    projector_scores: tuple[ModelScore, ...] = ()
    if sightings.has_projector:
        refuse_unlike_boards(sightings, names)
        projector, state, projector_scores = _projector_too(sightings, state, request, model=model, shape=shape)
    on_step(2, 4)
    settled = settle(sightings, state, shape.free(model, projector), prior=_prior(sightings))
    settled = _stretched(settled, sightings) or settled
    free = settled.free
    on_step(3, 4)
    settled, agree, starts, worse = _from_all_starts(settled, request)
    confidence = confidence_of(settled.equations(), free)
    refuse_undetermined(settled, confidence, names)
    on_step(4, 4)
    return LensFit(
        calibration=_finished(sightings, settled, confidence, request=request, models=(model, projector)),
        settled=settled,
        camera_scores=scores,
        projector_scores=projector_scores,
        starts=starts,
        starts_agree_px=agree,
        worse_starts=worse,
    )


def _refuse_few(views: int) -> None:
    if views < LEAST_VIEWS:
        raise CalibrationError(
            f"{views} views of the board, at least {LEAST_VIEWS} are needed, each with another tilt: photograph more"
        )


def _prior(sightings: BoardSightings) -> FloatArray:
    """(S,) what counts beside so many views."""
    return no_prior() if sightings.views >= _TELLING_VIEWS else prior_of(sightings)


def _spread_views(views: int, count: int) -> IntArray:
    return np.unique(np.linspace(0, views - 1, min(views, count)).round().astype(np.int64))


@dataclass(frozen=True)
class _BoardShape:
    """What of the board's shape is fitted."""

    flex: bool
    stretch: bool = False

    def free(self, model: str, projector: str | None) -> BoolArray:
        """(S,) the shared unknowns of lenses with these distortion models."""
        return free_shared(model, projector, flex=self.flex, stretch=self.stretch)


def _camera_alone(
    sightings: BoardSightings, request: LensRequest
) -> tuple[str, _BoardShape, Settled, tuple[ModelScore, ...]]:
    """Distortion model, what of the board's shape is fitted, the fit, and the scores of all models."""
    shape, prior = _BoardShape(flex=request.flex is not False), _prior(sightings)

    def attempt(model: str, seen: BoardSightings, start: RigState | None) -> Settled:
        free = shape.free(model, None)
        fits = [settle(seen, start, free, prior=prior, least_gain=_FAIR)] if start is not None else []
        if start is None or (model == "rational" and seen.views == sightings.views):
            guesses = camera_guesses(seen, request.camera_size_px, wide=model == "rational")[:_GUESSES]
            fits += [settle(seen, guess.state, free, prior=prior, least_gain=_FAIR) for guess in guesses]
        return min(fits, key=_merit)

    # Richer lenses take up what an uneven print leaves, so it is asked for before they are.
    uneven = _stretched(attempt(request.camera_model or USUAL, sightings, None), sightings)
    shape = replace(shape, stretch=uneven is not None)
    model, fit, scores = choose_model(sightings, attempt, request.models_of(request.camera_model, sightings.views))
    told = request.flex is None and sightings.views >= _TELLING_VIEWS
    if told and not _flex_helps(sightings, fit):
        shape, flat = replace(shape, flex=False), replace(fit.state, flex_m=np.zeros(FLEX))
        fit = settle(sightings, flat, shape.free(model, None), prior=prior)
    return model, shape, fit, scores


def _stretched(settled: Settled, sightings: BoardSightings) -> Settled | None:
    """The same with squares that are longer than wide; None where the views do not say so."""
    if settled.free[STRETCH].all():
        return None
    free = settled.free.copy()
    free[STRETCH] = True
    other = settle(sightings, settled.state, free, prior=settled.prior)
    sigma = float(np.sqrt(confidence_of(other.equations(), free).covariance[STRETCH, STRETCH].item()))
    return other if abs(other.state.stretch) > _STRETCHED * sigma else None


def _merit(settled: Settled) -> float:
    """Median length of a residual: also comparable between fits that left out different rows."""
    return float(np.median(np.linalg.norm(settled.bundle.residual[:, :2], axis=1)))


def _flex_helps(sightings: BoardSightings, fit: Settled) -> bool:
    """Whether left-out views are predicted better by a bent board."""
    squares = []
    for flex in (False, True):
        state = fit.state if flex else replace(fit.state, flex_m=np.zeros(FLEX))
        free = fit.free.copy()
        free[BEND] = flex
        again = settle(sightings, state, free, prior=fit.prior, least_gain=_FAIR)
        squares.append(left_out_squares(sightings, again, device=0))
    gain = squares[0] - squares[1]
    return bool(np.nanmean(gain) > _SURE * np.nanstd(gain, ddof=1) / np.sqrt(len(gain)))


def _all_views(sightings: BoardSightings, known: IntArray, state: RigState) -> RigState:
    """Return a start for all views from a fit to some."""
    if len(known) == sightings.views:
        return state
    guess = guess_poses(sightings, state.camera).state
    rotations, translations = guess.rotations.copy(), guess.translations_m.copy()
    rotations[known], translations[known] = state.rotations, state.translations_m
    return replace(guess, rotations=rotations, translations_m=translations, flex_m=state.flex_m)


def _projector_too(
    sightings: BoardSightings, state: RigState, request: LensRequest, *, model: str, shape: _BoardShape
) -> tuple[str, RigState, tuple[ModelScore, ...]]:
    def attempt(terms: str, seen: BoardSightings, start: RigState | None) -> Settled:
        first = with_projector(seen, state.of_views(np.arange(seen.views))) if start is None else start
        return settle(seen, first, shape.free(model, terms), prior=_prior(sightings), least_gain=_FAIR)

    models = request.models_of(request.projector_model, sightings.views)
    chosen, fit, scores = choose_model(sightings, attempt, models, device=1)
    return chosen, fit.state, scores


def _from_all_starts(settled: Settled, request: LensRequest) -> tuple[Settled, float, int, int]:
    """The best of the fits from all starts; how far those of equal cost differ, and how many ended higher."""
    fits = [settled.bundle]
    for start in _other_starts(settled, request):
        fits.append(adjust_bundle(settled.sightings, start, settled.free, prior=settled.prior, steps=200))
    best = min(fits, key=lambda fit: fit.cost)
    same = [fit.state for fit in fits if fit.cost <= best.cost * (1 + 1e-6)]
    apart = max(_apart_px(best.state, state, request) for state in same)
    return replace(settled, bundle=best), apart, len(fits), len(fits) - len(same)


def _other_starts(settled: Settled, request: LensRequest) -> list[RigState]:
    """Starts away from the solution: other focal lengths, no distortion, other principal points of the projector."""
    starts = []
    for factor in _FACTORS[1:]:
        lens = settled.state.camera.copy()
        lens[:2] *= factor
        lens[2:4] = (np.array(request.camera_size_px) - 1) / 2
        if "rational" not in _model_of(settled.free):
            lens[4:] = 0
        guess = guess_poses(settled.sightings, lens).state
        if request.projector_size_px is not None and settled.sightings.has_projector:
            guess = with_projector(settled.sightings, guess)
        starts.append(guess)
    if request.projector_size_px is None or not settled.sightings.has_projector:
        return starts
    size = np.array(request.projector_size_px, dtype=np.float64)
    for factor in _FACTORS:
        for shift in _SHIFTS:
            x_px, y_px = (size * shift).tolist()
            starts.append(moved_projector(settled.state, (x_px, y_px), factor))
    return starts


def _model_of(free: BoolArray) -> str:
    return "rational" if free[9] else "polynomial"


def _apart_px(first: RigState, second: RigState, request: LensRequest) -> float:
    """Largest distance of the pixels that two states' lenses give to one ideal point, over the pictures."""
    worst = 0.0
    for size, a, b in (
        (request.camera_size_px, first.camera, second.camera),
        (request.projector_size_px, first.projector, second.projector),
    ):
        if size is not None:
            plane, there = ideal_coordinates(a, pixel_grid(*size, columns=12)[0])
            points = np.column_stack([plane[there], np.ones(int(there.sum()))])
            worst = max(worst, float(np.abs(project_points(a, points) - project_points(b, points)).max(initial=0)))
    return worst


def _finished(
    sightings: BoardSightings,
    settled: Settled,
    confidence: Confidence,
    *,
    request: LensRequest,
    models: tuple[str, str | None],
) -> LensCalibration:
    state = settled.state
    noise = settled.noise_px
    return LensCalibration(
        camera=_lens(state.camera, request.camera_size_px, models[0]),
        projector=None if models[1] is None else _lens(state.projector, request.projector_size_px, models[1]),
        state=state,
        covariance=confidence.covariance,
        free=settled.free,
        information=confidence.information,
        sightings=sightings,
        used=settled.used,
        residual_px=_all_residuals(sightings, state),
        noise_px=(float(noise[0]), float(noise[-1])),
        excess=confidence.excess,
    )


def _lens(vector: FloatArray, size_px: tuple[int, int] | None, model: str) -> FittedLens:
    width_px, height_px = size_px or (0, 0)
    return FittedLens(width_px=width_px, height_px=height_px, vector=vector, model=model)


def _all_residuals(sightings: BoardSightings, state: RigState) -> FloatArray:
    """(N, 4) seen minus modelled, 0 where there is nothing."""
    found = -by_device(residuals(sightings, state)) * (weights_of(sightings) > 0)[..., None]
    whole = np.zeros((len(found), 2, 2))
    whole[:, : found.shape[1]] = found
    return whole.reshape(-1, 4)
