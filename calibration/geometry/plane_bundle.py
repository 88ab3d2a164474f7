"""Plane-constrained bundle adjustment: both lenses, relative pose and walls from points on the walls.

A camera pixel's ray meets its plane, the point is projected into the projector and compared: two equations a
correspondence and no unknown of its own. Walls at right angles fix the focal lengths.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from calibration.arrays import FloatArray, IntArray
from calibration.errors import CalibrationError
from calibration.geometry.bundle_residual import LandingError, landed, rays_of
from calibration.geometry.bundle_unknowns import PlanarScene, priors_of, scene_of, unknowns_of
from calibration.geometry.flat.bows import Bows, bows_of, taken_by_bows
from calibration.geometry.known.nominal import NominalIntrinsics
from calibration.geometry.noise import common_covariance, covariance, shared_error_px
from calibration.geometry.pinhole import PinholeModel
from calibration.geometry.planes import Axes, Transfer, assign_planes
from calibration.geometry.robust_fit import Fit, Priors, robust_fit

USUAL_VARIANCE_PX2 = 0.02
"""Of an independent observation, before it is measured: noise of 0.1 px, some neighbours with one error. [px²]"""
MARGIN_SHARE = 0.008
"""Points that two planes predict within this share of the projector's width lie near an edge: not used."""
_LEAST_POINTS = 200
"""Correspondences for some forty unknowns."""
_LEAST_SCALE_PX = 0.3
"""Of the robust fit: twice the noise of a sub-pixel correspondence."""
_REFIT = 20
"""Iterations of a fit that begins near its end."""
_NOWHERE_PX = -1e6
_LEAST_KEPT, _HALVINGS = 0.1, 4
"""Of a plane's points: where fewer are left away from edges, the margin is halved for it, so often at most. Without a
point, small rig 9724 had a wall that nothing held."""
_PARALLEL = np.cos(np.radians(30))


@dataclass(frozen=True, eq=False, kw_only=True)
class BundleSolution(PlanarScene):
    """Where a fit ends, and which points were used."""

    label: IntArray
    """(N,) plane of each point, -1 where none explains it."""
    fit: Fit
    used: IntArray
    """(M,) rows of the points that the fit rests on; those near an edge are not among them."""
    fit_label: IntArray
    """(M,) their planes."""
    start_axes: Axes
    """Those that the fit's unknowns turn."""
    error: LandingError
    bend: FloatArray | float = 0.0
    """(n, n) mean square by which the unknowns leave their tangent where they are free to move far."""
    right_angle_sigmas: float | None = None
    """By how much a fit without right angles explains the points better; None where there is no such fit."""
    bows: Bows | None = None
    """Of the walls, which were taken out of the points; None where they are flat."""

    @cached_property
    def covariance(self) -> FloatArray:
        """(n, n) of the unknowns: from noise, bows, what all points of a wall are off together, and the bend."""
        taken = 0.0 if self.bows is None else taken_by_bows(self, self.fit, self.error, self.bows.spread)
        noise = covariance(self.fit, self.fit.priors.weight, taken) + self.bend
        shared_px = shared_error_px(self.fit, self.error.x1, self.fit_label)
        return noise + common_covariance(self.fit, self.fit_label, self.error.weight, shared_px)

    def found_bows(self) -> Bows | None:
        """Return how the walls bow in this fit to points as they are; None where they are flat, or no walls at all."""
        return bows_of(self, self.fit, self.error)

    def straightened(self, x1: FloatArray, x2: FloatArray) -> FloatArray:
        """Return projector pixels (N, 2) as flat walls would have them."""
        return x2 if self.bows is None else self.bows.straightened(x1, x2)

    @property
    def share(self) -> float:
        """Share of the points that the planes explain."""
        return float((self.label >= 0).mean())

    @property
    def left_over(self) -> float:
        """Squares left over a point that was used, priors included."""
        return float(self.fit.cost) / len(self.used)

    @property
    def share_on_axes(self) -> float:
        """Share of the points on planes perpendicular to an axis of the room."""
        on_axis = np.append(self.axes.of_plane >= 0, False)
        return float(on_axis[self.label].mean())


def transfer_of(projector: PinholeModel) -> Transfer:
    """Return where the camera's rays land in the projector if their points lie on planes, normal / offset."""

    def transfer(rays: FloatArray, plane: FloatArray) -> FloatArray:
        along = rays @ plane if plane.ndim == 1 else (rays * plane).sum(axis=1)
        there = landed(projector, rays, along)
        # The same plane mirrored behind the devices would land on the same pixels.
        depth = (rays @ projector.rotation[2]) + projector.translation_m[2] * along
        return np.where(((along > 0) & (depth > 0))[:, None], there, _NOWHERE_PX)

    return transfer


@dataclass(frozen=True, kw_only=True)
class Rounds:
    """How a fit goes on: points are assigned to planes anew, within a limit, before each round."""

    limits_px: tuple[float, ...]
    """One a round."""
    iterations: int
    """At most, a round."""
    variance_px2: float = USUAL_VARIANCE_PX2
    """Of an independent observation: what the points weigh against the priors. [px²]"""
    margin_share: float = MARGIN_SHARE
    """Of the projector's width: points that a second plane predicts within it are not used."""
    explained_px: float = 0.0
    """A plane explains a point nearer than the last limit or, if that is more, nearer than this. [px]"""


def adjust(
    x1: FloatArray,
    x2: FloatArray,
    start: PlanarScene,
    nominal: NominalIntrinsics,
    *,
    rounds: Rounds,
    weight: FloatArray | None = None,
) -> BundleSolution | None:
    """Adjust both lenses, the relative pose and the walls to correspondences on the walls.

    Parameters
    ----------
    x1, x2 : (N, 2)
        Corresponding pixels of camera and projector. [px]
    start : PlanarScene
        Which plane is perpendicular to which axis stays as it is here.
    nominal : NominalIntrinsics
        Of both lenses.
    rounds : Rounds
        Limits and iterations.
    weight : (N, 2), optional
        By which each coordinate of the projector counts, at most 1.

    Returns
    -------
    BundleSolution or None
        None where fewer than 200 points are left: the start was wrong.
    """
    scene, axes = start, start.axes
    z = unknowns_of(start, nominal)
    priors = priors_of(start, nominal, rounds.variance_px2)
    margin_px = rounds.margin_share * nominal.projector_shape[1]
    weight = np.ones_like(x2) if weight is None else weight
    for limit_px in rounds.limits_px:
        label = _label(scene, x1, x2, limit_px=limit_px, margin_px=margin_px)
        used = np.flatnonzero(label >= 0)
        if len(used) < _LEAST_POINTS:
            return None
        error = LandingError(
            x1=x1[used], x2=x2[used], label=label[used], axes=axes, nominal=nominal, weight=weight[used]
        )
        fit = robust_fit(error, z, priors, iterations=rounds.iterations, least_scale_px=_LEAST_SCALE_PX)
        z = fit.z
        scene = scene_of(z, axes, nominal)
    return BundleSolution(
        camera=scene.camera,
        projector=scene.projector,
        planes=scene.planes,
        axes=scene.axes,
        label=_label(scene, x1, x2, limit_px=max(rounds.limits_px[-1], rounds.explained_px), margin_px=0.0),
        fit=fit,
        used=used,
        fit_label=label[used],
        start_axes=axes,
        error=error,
    )


def fitted_to_some(
    x1: FloatArray, x2: FloatArray, fewer: PlanarScene, nominal: NominalIntrinsics, *, weight: FloatArray
) -> BundleSolution | None:
    """Adjust again with fewer planes; None where these are less than two, or too few points are left."""
    rounds = Rounds(limits_px=(1.5, 1.0), iterations=12)
    return None if len(fewer.planes) < 2 else adjust(x1, x2, fewer, nominal, rounds=rounds, weight=weight)


def adjust_to_held_planes(
    x1: FloatArray,
    x2: FloatArray,
    start: PlanarScene,
    nominal: NominalIntrinsics,
    *,
    rounds: Rounds,
    weight: FloatArray,
) -> BundleSolution:
    """Adjust, and again without planes that not one point of the fit holds: these stay where they began, as if known.

    Their points are left over then, and say so.

    Parameters
    ----------
    x1, x2, start, nominal, rounds, weight
        As for :func:`adjust`.

    Returns
    -------
    BundleSolution

    Raises
    ------
    CalibrationError
        If too few points are on the walls.
    """
    fit = adjust(x1, x2, start, nominal, rounds=rounds, weight=weight)
    if fit is None:
        raise CalibrationError(
            f"fewer than {_LEAST_POINTS} of {len(x1)} correspondences lie within {max(rounds.limits_px):g} px of one "
            f"of the {len(start.planes)} walls that were found and of no other: codes are noisier than that, or what "
            "was taken for walls stands nearly in one plane; look at focus and exposure, and aim at a corner of bare "
            "walls"
        )
    stays = np.bincount(fit.fit_label, minlength=len(fit.planes)) > 0
    if stays.all() or stays.sum() < 2:
        return fit
    axes = replace(fit.axes, of_plane=fit.axes.of_plane[stays])
    return adjust(x1, x2, fit.with_planes(fit.planes[stays], axes), nominal, rounds=rounds, weight=weight) or fit


def refit(
    error: LandingError, start: PlanarScene, variance_px2: float, *, priors: Priors | None = None
) -> BundleSolution:
    """Fit once more, to the same points on the same planes, from a start whose axes are those of the error."""
    z = unknowns_of(start, error.nominal)
    priors = priors or priors_of(start, error.nominal, variance_px2)
    fit = robust_fit(error, z, priors, iterations=_REFIT, least_scale_px=_LEAST_SCALE_PX)
    scene = scene_of(fit.z, error.axes, error.nominal)
    return BundleSolution(
        camera=scene.camera,
        projector=scene.projector,
        planes=scene.planes,
        axes=scene.axes,
        label=error.label,
        fit=fit,
        used=np.arange(len(error.x1)),
        fit_label=error.label,
        start_axes=error.axes,
        error=error,
    )


def _label(scene: PlanarScene, x1: FloatArray, x2: FloatArray, *, limit_px: float, margin_px: float) -> IntArray:
    """Assign points to planes; a plane whose points all lie near an edge keeps those that are furthest from it.

    Walls many baselines away differ by a few pixels of parallax: one of them may be near another's all over.
    """
    rays = rays_of(scene.camera, x1)
    assigned = partial(assign_planes, transfer_of(scene.projector), rays, x2=x2, planes=scene.planes, limit_px=limit_px)
    label = assigned(margin_px=margin_px)
    if margin_px <= 0:
        return label
    every = assigned(margin_px=0.0)
    wanted = _LEAST_KEPT * np.bincount(every[every >= 0], minlength=len(scene.planes)) * _stand_apart(scene.planes)
    for _ in range(_HALVINGS):
        few = np.bincount(label[label >= 0], minlength=len(scene.planes)) < wanted
        if not few.any():
            break
        margin_px /= 2
        nearer = assigned(margin_px=margin_px)
        label = np.where((nearer >= 0) & few[nearer], nearer, label)
    return label


def _stand_apart(planes: FloatArray) -> NDArray[np.bool_]:
    """(K,) planes that no other on the same side is nearly parallel to: two that are may be strips of a curved wall.

    Walls that face each other are none. Random rig 13008's floor had no point left, and stood where it had begun, 6.6
    sigma off, because the ceiling is parallel to it.
    """
    normals = planes / np.linalg.norm(planes, axis=1, keepdims=True)
    return np.asarray((normals @ normals.T - np.eye(len(planes))).max(axis=1) < _PARALLEL)
