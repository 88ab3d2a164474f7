"""The other room that walls allow: near and far exchanged, with camera and projector on exchanged sides.

What a small baseline t moves in the projector's picture is t (n · x), with 1 / depth = n · x. The baseline -t before
planes c m - n moves the same but for c t (m · x), which a turn of the projector and a little focal length undo; two
walls at right angles are so again if c = (n_a + n_b) · m. A third wall is so only for about the same c of all pairs, or
for lenses that are far from their data sheets: seen from nearly one place, by a narrow lens. What is left to tell the
two rooms apart is what the data sheets say of the lenses, the pictures' perspective, and any strip of floor or ceiling:
a search that began near the wrong one ends in it. (Seen from far away, by parallel rays, every scene has such a
reflection: S. Ullman, The Interpretation of Visual Motion, MIT Press 1979.)
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from calibration.arrays import FloatArray
from calibration.errors import CalibrationError
from calibration.geometry.bundle_residual import rays_of
from calibration.geometry.bundle_unknowns import PlanarScene
from calibration.geometry.contradictions import hold_against_all
from calibration.geometry.flat.third_wall import RestingOn, WeighedPoints, with_third_wall
from calibration.geometry.known.nominal import NominalIntrinsics
from calibration.geometry.noise import SIGMAS
from calibration.geometry.pinhole import PinholeModel, world_rays
from calibration.geometry.plane_bundle import BundleSolution, Rounds, adjust
from calibration.geometry.support import explained_within_px, plane_errors_px

_SOME = 3000
"""Points that the other room is looked for with."""
_FOCAL_FACTORS = np.exp(np.linspace(-0.3, 0.3, 13))
"""Of the projector's focal length, which are tried: c t along the axis is up to 0.2 in random rigs."""
_HELD = Rounds(limits_px=(40.0, 15.0, 4.0), iterations=8, variance_px2=2.0)
"""The start is off by 2 to 6 px at the median and by 60 px at a rim; lenses that are free at once run away from it."""
_LET_GO = Rounds(limits_px=(4.0, 1.5, 1.0), iterations=12)
_AXES = 3


def likelier_depths(
    fit: BundleSolution, found: RestingOn, points: WeighedPoints, nominal: NominalIntrinsics, *, n_fitted: int
) -> RestingOn:
    """Hold a room against the one with near and far exchanged, and return the likelier.

    Parameters
    ----------
    fit : BundleSolution
        To the first `n_fitted` points.
    found : RestingOn
        The same with the strip of a third wall, where there is one.
    points : WeighedPoints
        All that there are.
    nominal : NominalIntrinsics
        Of both lenses.
    n_fitted : int
        Points that a fit rests on.

    Returns
    -------
    RestingOn
        What was given, where all walls are along one axis, or the other room contradicts something.

    Raises
    ------
    CalibrationError
        If the points and the data sheets tell the two rooms apart by less than four sigma.
    """
    some = points.chosen(slice(0, n_fitted))
    exchanged = reversed_fit(fit, some, nominal)
    if exchanged is None:
        return found
    beside = with_third_wall(exchanged, points, nominal, n_fitted=n_fitted)
    one, other = (_as_flat(each.solution, some, nominal) for each in (found, beside))
    gain = _gain(one, other, some)
    if abs(gain) < SIGMAS**2:
        sigmas = float(np.sqrt(abs(gain)))
        raise CalibrationError(
            f"two rooms explain the points equally well, to {sigmas:.1f} sigma, the limit is {SIGMAS:g}: {_told(one)}, "
            f"or {_told(other)}. Walls seen from nearly one place do not tell near from far: show a strip of floor or "
            "ceiling, move the camera further from the projector, or give both devices a lens file (rig lenses)"
        )
    return beside if gain > 0 else found


def reversed_fit(fit: BundleSolution, points: WeighedPoints, nominal: NominalIntrinsics) -> BundleSolution | None:
    """Fit the room with near and far exchanged.

    Parameters
    ----------
    fit : BundleSolution
        To the first of the points.
    points : WeighedPoints
        Those that the other fit is of.
    nominal : NominalIntrinsics
        Of both lenses.

    Returns
    -------
    BundleSolution or None
        None where all walls are along one axis, or where something contradicts it.
    """
    free = unheld_reversal(fit, points, nominal)
    if free is None:
        return None
    try:
        return hold_against_all(points.camera_xy_px, points.projector_xy_px, free, nominal, weight=points.weight)
    except CalibrationError:
        return None


def unheld_reversal(fit: BundleSolution, points: WeighedPoints, nominal: NominalIntrinsics) -> BundleSolution | None:
    """Fit the room with near and far exchanged to some of the points, whatever contradicts it; None where none is."""
    start = reversed_scene(fit, points.camera_xy_px, points.projector_xy_px)
    some = points.chosen(slice(0, _SOME))
    how = partial(adjust, some.camera_xy_px, some.projector_xy_px, nominal=nominal, weight=some.weight)
    held = None if start is None else how(start, rounds=_HELD)
    return None if held is None else how(held, rounds=_LET_GO)


def reversed_scene(fit: BundleSolution, x1: FloatArray, x2: FloatArray) -> PlanarScene | None:
    """Return about where devices and walls stand in the other room; None where all walls are along one axis.

    Parameters
    ----------
    fit : BundleSolution
        To these points, or the first of them.
    x1, x2 : (N, 2)
        Corresponding pixels of camera and projector. [px]

    Returns
    -------
    PlanarScene or None
    """
    largest = _largest_of_axes(fit)
    if len(largest) < 2:
        return None
    on = np.flatnonzero(fit.label >= 0)
    rays = rays_of(fit.camera, x1[on])
    middle = (rays / np.linalg.norm(rays, axis=1, keepdims=True)).mean(axis=0)
    middle /= np.linalg.norm(middle)
    towards = fit.planes[list(largest.values())] @ middle
    # The mean of (n_a + n_b) . m over all pairs: each plane is in as many of them.
    planes = 2 * towards.mean() * middle - fit.planes
    points = rays / (rays * planes[fit.label[on]]).sum(axis=1, keepdims=True)
    projector = _turned_to(fit.projector, -fit.projector.position_m, points, x2[on])
    axes = replace(fit.axes, directions=_directions(planes, largest))
    return PlanarScene(camera=fit.camera, projector=projector, planes=planes, axes=axes)


def _largest_of_axes(fit: BundleSolution) -> dict[int, int]:
    """The largest plane across each axis that has one."""
    of_plane = fit.axes.of_plane
    order = np.argsort(np.bincount(fit.fit_label, minlength=len(of_plane)), kind="stable")
    return {int(of_plane[k]): int(k) for k in order if of_plane[k] >= 0}


def _directions(planes: FloatArray, largest: dict[int, int]) -> FloatArray:
    directions = np.zeros((_AXES, _AXES))
    for axis, k in largest.items():
        directions[axis] = planes[k] / np.linalg.norm(planes[k])
    for axis in {0, 1, 2} - set(largest):
        directions[axis] = np.cross(directions[(axis + 1) % _AXES], directions[(axis + 2) % _AXES])
    u, _, vt = np.linalg.svd(directions)
    return np.asarray(u @ vt)


def _turned_to(projector: PinholeModel, position: FloatArray, points: FloatArray, x2: FloatArray) -> PinholeModel:
    """The projector at a place, turned so that its pixels (N, 2) light points (N, 3) best, by whatever focal length."""
    towards = points - position
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)

    def turned(factor: float) -> tuple[float, PinholeModel]:
        fx, fy = projector.focal_px
        lens = replace(projector, focal_px=(fx * factor, fy * factor), rotation=np.eye(3), translation_m=np.zeros(3))
        rays = world_rays(lens, x2)
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        u, _, vt = np.linalg.svd(rays.T @ towards)
        rotation = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
        off_px = float(np.median(np.linalg.norm(towards @ rotation.T - rays, axis=1))) * lens.focal_px[0]
        return off_px, replace(lens, rotation=rotation, translation_m=-rotation @ position)

    return min((turned(float(factor)) for factor in _FOCAL_FACTORS), key=lambda pair: pair[0])[1]


def _as_flat(fit: BundleSolution, points: WeighedPoints, nominal: NominalIntrinsics) -> BundleSolution:
    """Fit flat walls where they bow: one room's walls must not bow to what would tell it from the other."""
    if fit.bows is None:
        return fit
    rounds = Rounds(limits_px=(1.0,), iterations=10, variance_px2=fit.bows.variance_as_flat_px2)
    x1, x2 = points.camera_xy_px, points.projector_xy_px
    return adjust(x1, x2, fit, nominal, rounds=rounds, weight=points.weight) or fit


def _gain(one: BundleSolution, other: BundleSolution, points: WeighedPoints) -> float:
    """By how much chi-squared of some points and the data sheets is less in the other fit; strays count alike in both.

    The variance of an independent observation is that which the better fit leaves: what the other one's bends add to
    its own is no noise.
    """
    fits = (one, other)
    errors = [plane_errors_px(fit, points.camera_xy_px, points.projector_xy_px).min(axis=0) for fit in fits]
    limit_px = explained_within_px(np.minimum(*errors))
    weight = points.weight.min(axis=1)
    variance = min(fit.fit.priors.weight for fit in fits)
    first, second = (
        float((np.minimum(error, limit_px) * weight) @ (np.minimum(error, limit_px) * weight)) / variance
        + fit.fit.priors.cost(fit.fit.z) / fit.fit.priors.weight
        for error, fit in zip(errors, fits, strict=True)
    )
    return first - second


def _told(fit: BundleSolution) -> str:
    side = "right" if fit.projector.position_m[0] > 0 else "left"
    near, far = np.sort(1 / np.linalg.norm(fit.planes, axis=1))[[0, -1]]
    return f"walls {near:.1f} to {far:.1f} baselines away and the projector on the camera's {side}"
