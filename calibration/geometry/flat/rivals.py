"""What is tried when the most promising fit is contradicted: fewer planes, other starts, a plane that stands askew."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import replace

import numpy as np

from calibration.arrays import FloatArray
from calibration.errors import CalibrationError
from calibration.geometry.contradictions import NotFlat, hold_against_all
from calibration.geometry.flat.depth_reversal import unheld_reversal
from calibration.geometry.flat.third_wall import WeighedPoints
from calibration.geometry.known.nominal import NominalIntrinsics
from calibration.geometry.plane_bundle import BundleSolution, fitted_to_some
from calibration.geometry.plane_search import (
    explains_a_room,
    found_anew,
    let_askew,
    planes_before_others,
    small_planes,
    without_tangents,
)
from calibration.geometry.planes import nearest_axes

_BETTER = 0.9
"""Of what the first fit left over, what one that was made of it may leave. One from another start has only to leave
less: small rig 9648's true room left 0.92 of what a wrong one did, which was called curved."""
_GROWN = 2
"""Times that planes are found anew: the second time with lenses that a wall more has fixed."""
_FIRST_TO_GO = 2
"""Planes let go alone whose fits are gone on from with a second one: those that leave least over."""
_MOST_NOT_FLAT = 0.2
"""Of the points, on a plane that is none but the fronts of two things: each may have a tenth."""
_NEARLY_SQUARE_DEG = 2.0
"""A plane that was left free and comes out so near to one of the room's directions may be a wall after all."""


def uncontradicted_rival(
    x1: FloatArray,
    x2: FloatArray,
    first: BundleSolution,
    others: Iterable[BundleSolution],
    *,
    why: CalibrationError | None = None,
    nominal: NominalIntrinsics,
    weight: FloatArray,
) -> BundleSolution | None:
    """Find a fit that nothing contradicts, after the first one was contradicted.

    In this order: the first without its tangents of curved surfaces; that with the walls that its lenses show; the
    first without a small plane that is why it was contradicted; the first with near and far exchanged; the first with a
    plane askew that stands before others; the others, where they leave less over; these without their tangents; the
    first with a small plane askew; the first with two planes askew, the first of them one that alone left least over.

    Parameters
    ----------
    x1, x2 : (N, 2)
        Corresponding pixels. [px]
    first : BundleSolution
        The contradicted fit.
    others : iterable of BundleSolution
        From other starts.
    why : CalibrationError, optional
        What contradicts it.
    nominal : NominalIntrinsics
        Of both lenses.
    weight : (N,)
        Of each point.

    Returns
    -------
    BundleSolution or None
        None if something contradicts all of them.
    """
    rivals = _Rivals(x1, x2, nominal, weight)
    flat = rivals.without_tangents(first)
    left = _unexplained(flat or first)
    most_left = _BETTER * left
    tried: list[BundleSolution] = []
    askew: list[BundleSolution] = []
    return (
        rivals.held([flat] if flat is not None else [])
        or rivals.held(rivals.grown(flat), most_left)
        or rivals.held(rivals.without_a_small(first, why))
        or rivals.held(rivals.with_near_and_far_exchanged(first), left)
        # One that stands before others is furniture, however large.
        or rivals.held(_kept(rivals.askew(first, before=True), askew), most_left)
        or rivals.held(_kept(others, tried), left)
        # A screen's tangent may have spoiled the first fit's lenses, and with them the choice of what is a tangent.
        or rivals.held((fewer for one in tried if (fewer := rivals.without_tangents(one)) is not None), most_left)
        or rivals.held(_kept(rivals.askew(first, before=False), askew))
        # Two things at once bend the lenses together: neither alone is all that was held wrongly.
        or rivals.held(rivals.two_askew(askew), most_left)
    )


def with_square_walls(
    x1: FloatArray, x2: FloatArray, fit: BundleSolution, *, nominal: NominalIntrinsics, weight: FloatArray
) -> BundleSolution:
    """Hold planes that come out nearly square as walls, too, where nothing contradicts it.

    A fit to begin with may leave a wall free because lenses that are some degrees off, or a panel that passed for a
    wall, had turned it.

    Parameters
    ----------
    x1, x2 : (N, 2)
        Corresponding pixels. [px]
    fit : BundleSolution
        That nothing contradicts.
    nominal : NominalIntrinsics
        Of both lenses.
    weight : (N, 2)
        By which each coordinate of the projector counts.

    Returns
    -------
    BundleSolution
        The same one where none of its free planes is nearly square, or they are not.
    """
    of_plane = fit.axes.of_plane
    if (of_plane < 0).all():
        return fit
    normals = fit.planes / np.linalg.norm(fit.planes, axis=1, keepdims=True)
    nearest = nearest_axes(normals, fit.axes.directions, _NEARLY_SQUARE_DEG)
    axes = replace(fit.axes, of_plane=np.where(of_plane < 0, nearest, of_plane))
    if (axes.of_plane == of_plane).all():
        return fit
    with suppress(CalibrationError):
        return hold_against_all(x1, x2, fit.with_planes(fit.planes, axes), nominal, weight=weight)
    return fit


class _Rivals:
    """The points, and what fits to them are held against."""

    def __init__(self, x1: FloatArray, x2: FloatArray, nominal: NominalIntrinsics, weight: FloatArray) -> None:
        self._points, self._nominal, self._weight = (x1, x2), nominal, weight

    def without_tangents(self, fit: BundleSolution) -> BundleSolution | None:
        return without_tangents(*self._points, fit, self._nominal, weight=self._weight)

    def without_a_small(self, fit: BundleSolution, why: CalibrationError | None) -> Iterator[BundleSolution]:
        """Yield a fit without a small plane that is not flat, furniture: fronts of two columns nearly in one plane."""
        if isinstance(why, NotFlat) and why.plane in small_planes(fit, _MOST_NOT_FLAT):
            stays = np.arange(len(fit.planes)) != why.plane
            fewer = fitted_to_some(*self._points, fit.with_some_planes(stays), self._nominal, weight=self._weight)
            if fewer is not None:
                yield fewer

    def grown(self, fit: BundleSolution | None) -> Iterator[BundleSolution]:
        """Yield fits with the planes that a fit's own lenses show, and with those that the next ones show."""
        for _ in range(_GROWN):
            fit = None if fit is None else found_anew(*self._points, fit, self._nominal, weight=self._weight)
            if fit is not None:
                yield fit

    def with_near_and_far_exchanged(self, fit: BundleSolution) -> Iterator[BundleSolution]:
        exchanged = unheld_reversal(fit, WeighedPoints(*self._points, self._weight), self._nominal)
        if exchanged is not None:
            yield exchanged

    def askew(self, fit: BundleSolution, *, before: bool) -> Iterator[BundleSolution]:
        may_go = planes_before_others(fit, *self._points) if before else small_planes(fit)
        return let_askew(*self._points, fit, self._nominal, weight=self._weight, may_go=may_go)

    def two_askew(self, alone: list[BundleSolution]) -> Iterator[BundleSolution]:
        """Yield fits with one more plane askew than those that leave least over."""
        for fit in sorted(alone, key=_unexplained)[:_FIRST_TO_GO]:
            yield from self.askew(fit, before=True)
            yield from self.askew(fit, before=False)

    def held(self, some: Iterable[BundleSolution], most_left: float = np.inf) -> BundleSolution | None:
        """Return the first of some fits that nothing contradicts, of those that leave no more than so much over.

        One that explains less than half of the points, or has walls along one direction alone, is none: little is left
        to contradict it.
        """
        for bundle in some:
            if _unexplained(bundle) <= most_left and explains_a_room(bundle):
                with suppress(CalibrationError):
                    return hold_against_all(*self._points, bundle, self._nominal, weight=self._weight)
        return None


def _kept(some: Iterable[BundleSolution], tried: list[BundleSolution]) -> Iterator[BundleSolution]:
    """Yield fits, and keep them for a second look."""
    for bundle in some:
        tried.append(bundle)
        yield bundle


def _unexplained(bundle: BundleSolution) -> float:
    """What a fit leaves over, priors included, of a point; a point that no plane explains counts as one pixel."""
    return bundle.share * bundle.left_over + (1 - bundle.share)
