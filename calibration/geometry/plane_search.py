"""The search for the planes and lenses that a fit begins with: several starts, axes and segmentations, the best one."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain

import numpy as np

from calibration.arrays import FloatArray, IntArray
from calibration.errors import CalibrationError
from calibration.geometry.bundle_unknowns import PlanarScene
from calibration.geometry.flat.endless import MOST_REACH, reach
from calibration.geometry.flat.plane_starts import LEAST_LIMIT_PX, planes_of, starts_by_lines
from calibration.geometry.known.nominal import NominalIntrinsics
from calibration.geometry.plane_bundle import BundleSolution, Rounds, adjust, fitted_to_some
from calibration.geometry.planes import (
    INLIER_PX,
    Axes,
    askew_hypotheses,
    axis_hypotheses,
    corner_axes,
    orthogonal_axes,
)
from calibration.geometry.support import LEAST_BEHIND, bending_planes, shares_behind_planes, standing_planes

_SOME = 3000
"""Points that candidates are fitted to."""
LEAST_INLIER_SHARE = 0.5
"""Of the points on walls: below, most of what was seen is furniture, or the fit is wrong."""
_GOOD_SHARE = 0.9
"""A candidate that explains so much needs no rival."""
_NEARLY_ALL = 0.97
"""What begins with bent long lenses must explain so much: where it explained 0.86 and 0.93, the pose was off by 3
degrees, and the camera's focal length by up to 10 %."""
_BETTER = 0.98
"""Planes found anew may lose so little and still be taken: they were found with better lenses."""
_MUCH_LESS = 1 / 3
"""Of what the squarest fit leaves over, what one with fewer walls square must leave at most to be its rival. A screen
askew that was taken for a wall left 5.8 times as much as left askew (random world 114)."""
_MEDIANS = 5.0
"""Of a fit's errors: within so many a plane found anew explains its points."""
_ONE_AXIS = 0.5
"""What a candidate counts that has walls along one direction only: none at right angles."""
_FEWER_PLANES = (3, 2)
_HELD_PX2 = 2.0
"""Variance by which points count while free planes are looked for: a hundred times the usual, so that data sheets hold
the lenses ten times as tightly. With lenses as free as at the end, a square corner that is seen well settled at 151
degrees in one of twenty small rigs, and no right angle was found in it any more; from 0.2 to 20, two of three starts
came within 10."""
MOST_SLANTED = 0.1
"""Share of the points on a plane that is none of a box's: less is furniture, which the model leaves out, as is any
plane behind which others are seen."""
_GUESSED_LIMIT_DEG, _FITTED_LIMIT_DEG = 25.0, 3.0
"""How far a plane may stand from its axis, before and after the lenses are known."""


def candidates(
    x1: FloatArray, x2: FloatArray, nominal: NominalIntrinsics, *, right_angles: bool
) -> Iterator[BundleSolution]:
    """Yield fits to go on from, the most promising first; the later ones are made only when they are asked for.

    First comes the first fit whose planes explain nearly all points, or the one that explains most. A fit may explain
    all points and be wrong, and what holds it against the data sheets finds out: so the others follow, with those from
    the same starts that take fewer planes for walls and leave less over, and then those that begin with one device
    before the other, which come first where no other start explains half of the points, and they nearly all. Where all
    walls that were found lie along one direction, or none were, long lenses as bent as wide ones are tried.

    Parameters
    ----------
    x1, x2 : (N, 2)
        Corresponding pixels in an order drawn by chance. [px]
    nominal : NominalIntrinsics
        Of both lenses.
    right_angles : bool
        Planes that are nearly perpendicular are exactly so.

    Yields
    ------
    BundleSolution
        Of some of the points.

    Raises
    ------
    CalibrationError
        If flat walls explain less than half of the points in all of them.
    """
    begin = partial(_fits, x1[:_SOME], x2[:_SOME], nominal, right_angles=right_angles)
    starts = partial(starts_by_lines, x1, x2, nominal)
    fits, ahead = (begin(starts(ahead=before)) for before in (False, True))
    tried = _tried(fits, right_angles)
    if not tried or tried[0].squarest.share < LEAST_INLIER_SHARE:
        tried = _nearly_all(ahead, right_angles, _GOOD_SHARE) or tried
    if not tried or not explains_a_room(tried[0].squarest):
        bent = chain(starts(ahead=False, bent=True), starts(ahead=True, bent=True))
        tried = _nearly_all(begin(bent), right_angles, _NEARLY_ALL) or tried
    best = tried[0].squarest if tried else None
    if best is None or best.share < LEAST_INLIER_SHARE:
        raise CalibrationError(
            f"flat walls explain only {100 * (best.share if best else 0):.0f} % of the correspondences, the limit is "
            f"{100 * LEAST_INLIER_SHARE:.0f} %: most of what is seen is curved or furniture, or the fields of view "
            "in the profile are wrong, or one device stands nearly in line behind the other; aim at bare, flat walls, "
            "with the camera aside from the projector"
        )
    yield from (ends.squarest for ends in tried)
    yield from (ends.finer for ends in tried if ends.finer is not None)
    yield from chain.from_iterable(ends.askew for ends in tried)
    others = chain.from_iterable((ends.squarest, ends.finer) for ends in chain(fits, ahead))
    yield from (fit for fit in others if fit is not None and _merit(fit, right_angles) > LEAST_INLIER_SHARE)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Ends:
    """What one start of the devices has led to."""

    squarest: BundleSolution
    """Of fits that explain nearly as many points on walls at right angles as any, the one with least left over."""
    finer: BundleSolution | None
    """One that takes fewer planes for walls, and leaves much less over; None where there is none."""
    askew: Iterator[BundleSolution]
    """Others that leave less over than the squarest, the least first; made when they are asked for."""


def _tried(fits: Iterator[_Ends], right_angles: bool) -> list[_Ends]:
    """Take fits up to the first whose planes explain nearly all points; the one that explains most comes first."""
    tried: list[_Ends] = []
    for ends in fits:
        tried.append(ends)
        if _merit(ends.squarest, right_angles) > _GOOD_SHARE:
            break
    return sorted(tried, key=lambda ends: -_merit(ends.squarest, right_angles))


def _nearly_all(fits: Iterator[_Ends], right_angles: bool, least: float) -> list[_Ends]:
    """Take fits in the same way; none where the best does not explain more than the least share."""
    tried = _tried(fits, right_angles)
    return tried if tried and _merit(tried[0].squarest, right_angles) > least else []


def _fits(
    x1: FloatArray, x2: FloatArray, nominal: NominalIntrinsics, starts: Iterable[PlanarScene], *, right_angles: bool
) -> Iterator[_Ends]:
    """Fit the walls from one start after the other."""
    for start in starts:
        ends = _adjusted_twice(x1, x2, start, nominal=nominal, right_angles=right_angles)
        if ends is not None:
            yield ends


def without_tangents(
    x1: FloatArray, x2: FloatArray, fit: BundleSolution, nominal: NominalIntrinsics, *, weight: FloatArray
) -> BundleSolution | None:
    """Fit again without the planes that touch a curved surface; None where there is none, or too little is left.

    A cylinder's strips pass for walls one by one, and turn what they are held at right angles with.
    """
    stays = ~bending_planes(fit, x1, x2)
    return None if stays.all() else fitted_to_some(x1, x2, fit.with_some_planes(stays), nominal, weight=weight)


def found_anew(
    x1: FloatArray, x2: FloatArray, fit: BundleSolution, nominal: NominalIntrinsics, *, weight: FloatArray
) -> BundleSolution | None:
    """Find planes again with the lenses of a fit, and fit those at right angles that touch nothing curved.

    Lenses that tangents had spoiled mix a wall with the tangents beside it; without them it comes out by itself.
    """
    planes = planes_of(fit.devices, x1, x2, _limit_after(fit))
    if len(planes) <= len(fit.planes):
        return None
    again = fit.with_planes(planes, orthogonal_axes(planes, _GUESSED_LIMIT_DEG))
    found = _without_phantoms(x1, x2, again, nominal, rounds=Rounds(limits_px=(1.5, 1.0), iterations=8))
    return None if found is None else without_tangents(x1, x2, found, nominal, weight=weight) or found


def let_askew(
    x1: FloatArray,
    x2: FloatArray,
    fit: BundleSolution,
    nominal: NominalIntrinsics,
    *,
    weight: FloatArray,
    may_go: IntArray,
) -> Iterator[BundleSolution]:
    """Yield fits in which one plane more stands as it likes that was held at right angles.

    A chest whose front is some degrees off a wall's passes for one of the room's planes, and so does a panel, with
    lenses that make it square. Only planes that have another one on their axis are let go.

    Parameters
    ----------
    x1, x2 : (N, 2)
        Corresponding pixels of camera and projector. [px]
    fit : BundleSolution
        With all of them at right angles, or some let go before.
    nominal : NominalIntrinsics
        Of both lenses.
    weight : (N, 2)
        By which each coordinate of the projector counts.
    may_go : (m,) int
        Planes that may stand as they like, the likeliest first: :func:`planes_before_others`, :func:`small_planes`.

    Yields
    ------
    BundleSolution
        One a plane; not those of which too few points are left.
    """
    of_plane = fit.axes.of_plane
    for k in may_go:
        if of_plane[k] < 0 or (of_plane == of_plane[k]).sum() < 2:
            continue
        axes = replace(fit.axes, of_plane=np.where(np.arange(len(of_plane)) == k, -1, of_plane))
        rounds = Rounds(limits_px=(1.5, 1.0), iterations=12)
        freed = adjust(x1, x2, fit.with_planes(fit.planes, axes), nominal, rounds=rounds, weight=weight)
        if freed is not None:
            yield freed


def planes_before_others(fit: BundleSolution, x1: FloatArray, x2: FloatArray) -> IntArray:
    """Return the planes of a fit that others are seen behind, however large, that with most behind it first."""
    behind = shares_behind_planes(fit, x1, x2)
    order = np.argsort(-behind, kind="stable")
    return np.asarray(order[behind[order] >= LEAST_BEHIND])


def small_planes(fit: BundleSolution, most: float = MOST_SLANTED) -> IntArray:
    """Return the planes of a fit that are small enough for furniture, with at most a share, the smallest first."""
    share = np.bincount(fit.fit_label, minlength=len(fit.planes)) / len(fit.fit_label)
    order = np.argsort(share, kind="stable")
    return np.asarray(order[share[order] <= most])


def explains_a_room(fit: BundleSolution) -> bool:
    """Tell whether a fit explains half of the points, with walls along more than one direction, or free ones."""
    return fit.share >= LEAST_INLIER_SHARE and (_axes_count(fit) > 1 or bool((fit.axes.of_plane < 0).all()))


def _adjusted_twice(
    x1: FloatArray, x2: FloatArray, start: PlanarScene, *, nominal: NominalIntrinsics, right_angles: bool
) -> _Ends | None:
    """Fit with lenses held, then let go, at right angles; find the planes again with these lenses, and fit again.

    Walls that may be a corner's or face each other are followed to the end in both ways: only there do they differ.
    """
    held = _first_fit(x1, x2, start, nominal)
    if held is None:
        return None
    guessed = _guesses(x1, x2, held, nominal, right_angles=right_angles)
    corners = corner_axes(held.planes, orthogonal_axes(held.planes, _GUESSED_LIMIT_DEG)) if right_angles else []
    others = _roughly(x1, x2, held, nominal, axes=corners)
    fits = [fit for fit in (_likeliest(guessed, right_angles, x1), *others) if fit is not None]
    ends = [_found_again(x1, x2, fit, nominal, right_angles=right_angles) for fit in fits]
    squarest = _likeliest(ends, right_angles, x1)
    if squarest is None:
        return None
    askew = _askew(x1, x2, held, nominal, guessed=guessed, least=squarest.left_over) if right_angles else iter(())
    return _Ends(squarest=squarest, finer=_finer(guessed, squarest), askew=askew)


def _found_again(
    x1: FloatArray, x2: FloatArray, first: BundleSolution, nominal: NominalIntrinsics, *, right_angles: bool
) -> BundleSolution:
    """Find the planes again with the lenses of a fit, and fit again; the fit itself where that is worse."""
    planes = planes_of(first.devices, x1, x2, _limit_after(first))
    if len(planes) < 2:
        return first
    axes = orthogonal_axes(planes, _FITTED_LIMIT_DEG) if right_angles else None
    again = first.with_planes(planes, axes)
    second = _without_phantoms(x1, x2, again, nominal, rounds=Rounds(limits_px=(1.5, 1.0), iterations=8))
    if second is not None and right_angles and (second.axes.of_plane < 0).any():
        # Phantoms among the planes had turned the axes; without them the walls may be square.
        guessed = _guesses(x1, x2, second, nominal, right_angles=True)
        second = max(second, _likeliest(guessed, True, x1) or second, key=lambda fit: _merit(fit, True))
    if second is None or _merit(second, right_angles) < _BETTER * _merit(first, right_angles):
        return first
    return second


def _guesses(
    x1: FloatArray, x2: FloatArray, start: PlanarScene, nominal: NominalIntrinsics, *, right_angles: bool
) -> list[BundleSolution]:
    """Fit with lenses as free as they are, the planes at right angles in each way that may be meant."""
    square = orthogonal_axes(start.planes, _GUESSED_LIMIT_DEG)
    return _roughly(x1, x2, start, nominal, axes=axis_hypotheses(start.planes, square) if right_angles else [None])


def _roughly(
    x1: FloatArray, x2: FloatArray, start: PlanarScene, nominal: NominalIntrinsics, *, axes: Sequence[Axes | None]
) -> list[BundleSolution]:
    """Fit the same planes at right angles in each of several ways, enough to tell which may be meant."""
    rounds = Rounds(limits_px=(1.5,), iterations=12)
    fits = (adjust(x1, x2, start.with_planes(start.planes, one), nominal, rounds=rounds) for one in axes)
    return [fit for fit in fits if fit is not None]


def _askew(
    x1: FloatArray,
    x2: FloatArray,
    held: BundleSolution,
    nominal: NominalIntrinsics,
    *,
    guessed: Sequence[BundleSolution],
    least: float,
) -> Iterator[BundleSolution]:
    """Yield fits that leave less over: of guesses, and of those in which one of two planes on an axis stands askew."""
    axes = askew_hypotheses(held.planes, orthogonal_axes(held.planes, _GUESSED_LIMIT_DEG))
    fits = sorted((*guessed, *_roughly(x1, x2, held, nominal, axes=axes)), key=lambda fit: fit.left_over)
    yield from (fit for fit in fits if fit.left_over < least and explains_a_room(fit))


def _first_fit(x1: FloatArray, x2: FloatArray, start: PlanarScene, nominal: NominalIntrinsics) -> BundleSolution | None:
    """Fit with free planes and held lenses; with fewer where rough lenses make several planes of one wall."""
    rounds = Rounds(limits_px=(4.0, 1.5), iterations=6, variance_px2=_HELD_PX2)
    fit = _without_phantoms(x1, x2, start, nominal, rounds=rounds)
    for count in _FEWER_PLANES:
        if fit is None and len(start.planes) > count:
            fit = _without_phantoms(x1, x2, start.with_planes(_apart(start.planes, count)), nominal, rounds=rounds)
    return fit


def _apart(planes: FloatArray, count: int) -> FloatArray:
    """(count, 3) the first plane, and one after the other that which stands furthest from those chosen."""
    normals = planes / np.linalg.norm(planes, axis=1, keepdims=True)
    chosen = [0]
    while len(chosen) < count:
        chosen.append(int(np.abs(normals @ normals[chosen].T).max(axis=1).argmin()))
    return planes[sorted(chosen)]


def _limit_after(fit: BundleSolution) -> float:
    """Limit at which planes are told apart with the lenses of a fit: some of its median errors."""
    median_px = float(np.median(np.linalg.norm(fit.fit.residual, axis=1)))
    return float(np.clip(_MEDIANS * median_px, LEAST_LIMIT_PX, INLIER_PX))


def _likeliest(fits: Sequence[BundleSolution], right_angles: bool, x1: FloatArray) -> BundleSolution | None:
    """Of fits that explain nearly as many points as the best, the one with least left over, priors included.

    Walls that face each other and have no end are a corner's: where another fit has none, these are left out.
    """
    fits = [fit for fit in fits if reach(fit, x1) <= MOST_REACH] or fits
    most = max((_merit(fit, right_angles) for fit in fits), default=0.0)
    able = [fit for fit in fits if _merit(fit, right_angles) >= _BETTER * most]
    return min(able, key=lambda fit: fit.left_over, default=None)


def _finer(fits: Sequence[BundleSolution], squarest: BundleSolution) -> BundleSolution | None:
    """Of fits that explain as many points as the squarest one, that with least left over, where it is much less."""
    able = [fit for fit in fits if fit.share >= _BETTER * squarest.share and _axes_count(fit) > 1]
    finest = min(able, key=lambda fit: fit.left_over, default=squarest)
    return finest if finest.left_over < _MUCH_LESS * squarest.left_over else None


def _axes_count(fit: BundleSolution) -> int:
    """Directions along which it has walls at right angles."""
    return len(set(fit.axes.of_plane.tolist()) - {-1})


def _without_phantoms(
    x1: FloatArray, x2: FloatArray, start: PlanarScene, nominal: NominalIntrinsics, *, rounds: Rounds
) -> BundleSolution | None:
    """Fit, take the planes away that stand for no points of their own, and fit again as long as there are any."""
    solution = adjust(x1, x2, start, nominal, rounds=rounds)
    while solution is not None:
        stays = standing_planes(solution, x1, x2)
        if stays.all():
            break
        if stays.sum() < 2:
            return None
        solution = adjust(x1, x2, solution.with_some_planes(stays), nominal, rounds=rounds)
    return solution


def _merit(bundle: BundleSolution, right_angles: bool) -> float:
    """Share of the points that it explains, on walls at right angles where these are promised."""
    if not right_angles:
        return bundle.share
    return bundle.share_on_axes if _axes_count(bundle) > 1 else _ONE_AXIS * bundle.share
