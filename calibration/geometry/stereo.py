"""Self-calibration of a camera and a projector from dense correspondences in a room with flat walls.

Three stages. (1) Epipolar: relative pose from the essential matrix, refined over focal lengths, distortion and
lens shift, held by the data sheets: with optical axes that nearly meet, two views do not determine the focal
lengths. (2) The triangulated points are split into planes. (3) Plane-constrained bundle adjustment: every point
lies on its plane, so a correspondence gives two equations and no unknown; walls at right angles fix the focal
lengths, and all terms of both lenses become determined.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from numpy.typing import ArrayLike

from calibration.arrays import FloatArray
from calibration.errors import CalibrationError
from calibration.geometry.epipolar import (
    COLUMN_SHARES,
    UNDISTORTIONS,
    NominalIntrinsics,
    check_not_flat,
    check_parallax,
    fit_epipolar,
)
from calibration.geometry.pinhole import PinholeModel, project, world_rays
from calibration.geometry.plane_bundle import BundleSolution, PlanarScene, adjust, rays_of, transfer_of
from calibration.geometry.planes import Axes, ViewedPoints, axis_hypotheses, orthogonal_axes, segment_planes
from calibration.geometry.triangulation import triangulate

MIN_POINTS = 500
"""Correspondences: below, a wall with 2 % of them has ten."""
LEAST_INLIER_SHARE = 0.5
"""Of the points on walls: below, most of what was seen is furniture, or the fit is wrong."""
_GOOD_SHARE = 0.9
"""A candidate that explains so much needs no rival."""
_BETTER = 0.98
"""Planes found anew may lose so little and still be taken: they were found with better lenses."""
_FEW, _SOME, _MANY = 4000, 3000, 10000
"""Points that planes are looked for in, that candidates are fitted to, and that the result rests on."""
_GUESSED_LIMIT_DEG, _FITTED_LIMIT_DEG = 25.0, 3.0
"""How far a plane may stand from its axis, before and after the lenses are known."""


@dataclass(frozen=True, eq=False, kw_only=True)
class StereoCalibration:
    """Both devices in the camera's frame, and the planes that they saw."""

    camera: PinholeModel
    projector: PinholeModel
    planes: FloatArray
    """(K, 3) each plane as normal / offset: points with plane · x = 1; 1/m once scaled."""
    axes: tuple[int, ...]
    """Axis of the room (0, 1, 2) that each plane is perpendicular to; -1 for a plane that fits none."""
    room_axes: FloatArray
    """(3, 3) rows: the room's three directions in the camera's frame."""
    rms_px: float
    camera_rms_px: float
    projector_rms_px: float
    sigmas: dict[str, float]
    """Standard deviations of the free lens terms, from the fit's curvature. [px or 1]"""
    inlier_share: float

    @property
    def baseline(self) -> float:
        """Distance of the two centres of projection in metres; 1 until scaled."""
        return float(np.linalg.norm(self.projector.position_m - self.camera.position_m))


def calibrate_stereo(
    camera_xy_px: FloatArray,
    projector_xy_px: FloatArray,
    nominal: NominalIntrinsics,
    *,
    right_angles: bool = True,
    on_step: Callable[[int, int], None] | None = None,
) -> StereoCalibration:
    """Find lenses, relative pose and planes from correspondences; the unit of length is the baseline.

    Parameters
    ----------
    camera_xy_px, projector_xy_px : (N, 2)
        Corresponding pixels. [px]
    nominal : NominalIntrinsics
        Of both lenses.
    right_angles : bool
        Planes that are nearly perpendicular are exactly so.
    on_step : callable, optional
        Called with the steps done and all steps.

    Returns
    -------
    StereoCalibration
        In the camera's frame, baseline 1.

    Raises
    ------
    CalibrationError
        Too few points, too little parallax, one plane only, or no planes that explain the points.

    References
    ----------
    R. Hartley and A. Zisserman, Multiple View Geometry, 2nd edition, Cambridge 2004, chapters 9 and 11 (epipolar
    geometry); B. Triggs et al., Bundle adjustment - a modern synthesis, 1999.
    """
    report = on_step or _silent
    _check_count(len(camera_xy_px))
    order = np.random.default_rng(0).permutation(len(camera_xy_px))[:_MANY]
    x1, x2 = camera_xy_px[order], projector_xy_px[order]
    check_parallax(x1[:_FEW], x2[:_FEW], nominal)
    check_not_flat(x1[:_FEW], x2[:_FEW], nominal)
    report(1, 3)
    bundle = _best_bundle(x1, x2, nominal, right_angles)
    report(2, 3)
    refined = adjust(x1, x2, bundle, nominal, limits_px=(1.0,), iterations=20)
    report(3, 3)
    return _finished(refined or bundle, x1, x2)


def _silent(_done: int, _total: int) -> None:
    """Nobody watches."""


def _scaled(stereo: StereoCalibration, factor: float) -> StereoCalibration:
    """Multiply every length by a factor."""
    projector = replace(stereo.projector, translation_m=stereo.projector.translation_m * factor)
    camera = replace(stereo.camera, translation_m=stereo.camera.translation_m * factor)
    return replace(stereo, camera=camera, projector=projector, planes=stereo.planes / factor)


def scale_from_baseline(stereo: StereoCalibration, baseline_m: float) -> StereoCalibration:
    """Put a calibration into metres by the distance of the two lenses.

    Parameters
    ----------
    stereo : StereoCalibration
        Of any unit of length.
    baseline_m : float
        Distance of the two centres of projection. [m]

    Returns
    -------
    StereoCalibration
        In metres.
    """
    return _scaled(stereo, baseline_m / stereo.baseline)


def scale_from_spots(stereo: StereoCalibration, spots_px: ArrayLike, distance_m: float) -> StereoCalibration:
    """Put a calibration into metres by the distance between the spots that two projector pixels light on the planes.

    Parameters
    ----------
    stereo : StereoCalibration
        Of any unit of length.
    spots_px : (2, 2)
        Projector column and row of the spots. [px]
    distance_m : float
        Between the spots. [m]

    Returns
    -------
    StereoCalibration
        In metres.

    Raises
    ------
    CalibrationError
        If a spot lies on none of the planes, or both are one place.
    """
    spots = points_of_projector_pixels(stereo, np.asarray(spots_px, dtype=np.float64))
    if not np.isfinite(spots).all():
        raise CalibrationError("a spot of [scale] spots_px meets no measured wall; choose two lit, seen pixels")
    measured = float(np.linalg.norm(spots[1] - spots[0]))
    if measured < 1e-6:
        raise CalibrationError("the two spots of [scale] spots_px are one place; choose two far apart")
    return _scaled(stereo, distance_m / measured)


def points_of_projector_pixels(stereo: StereoCalibration, xy_px: FloatArray) -> FloatArray:
    """Find the surface points that projector pixels light: on the first plane in front.

    Parameters
    ----------
    stereo : StereoCalibration
        With planes.
    xy_px : (N, 2)
        Projector pixels. [px]

    Returns
    -------
    (N, 3)
        In the camera's frame; NaN where there is no plane.
    """
    origin, rays = stereo.projector.position_m, world_rays(stereo.projector, xy_px)
    with np.errstate(divide="ignore"):
        along = (1 - stereo.planes @ origin)[None, :] / (rays @ stereo.planes.T)
    along = np.where(along > 1e-9, along, np.inf).min(axis=1)
    return np.asarray(np.where(np.isfinite(along)[:, None], origin + np.minimum(along, 1e9)[:, None] * rays, np.nan))


def _check_count(n: int) -> None:
    if n < MIN_POINTS:
        raise CalibrationError(
            f"{n} correspondences, at least {MIN_POINTS} are needed: look at exposure, focus and how much of "
            "the projector's picture the camera sees"
        )


def _best_bundle(x1: FloatArray, x2: FloatArray, nominal: NominalIntrinsics, right_angles: bool) -> BundleSolution:
    """First candidate whose planes explain nearly all points, or the one that explains most."""
    best, best_share = None, 0.0
    for candidate in chain.from_iterable(fit_epipolar(x1[:_FEW], x2[:_FEW], nominal, share) for share in COLUMN_SHARES):
        planes = _planes_of(candidate, x1, x2)
        if len(planes) < 2:
            continue
        start = _with_free_planes(candidate, planes)
        bundle = _adjusted_twice(x1[:_SOME], x2[:_SOME], start, nominal=nominal, right_angles=right_angles)
        if bundle is None:
            continue
        share = _merit(bundle, right_angles)
        if share > best_share:
            best, best_share = bundle, share
        if best_share > _GOOD_SHARE:
            break
    if best is None or best.share < LEAST_INLIER_SHARE:
        raise CalibrationError(
            f"flat walls explain only {100 * (best.share if best else 0):.0f} % of the correspondences, the limit is "
            f"{100 * LEAST_INLIER_SHARE:.0f} %: check the fields of view in the profile, aim at bare walls"
        )
    return best


def _planes_of(devices: tuple[PinholeModel, PinholeModel], x1: FloatArray, x2: FloatArray) -> FloatArray:
    a, b = x1[:_FEW], x2[:_FEW]
    found = triangulate(a, b, *devices, on_camera_rays=True, undistortions=UNDISTORTIONS)
    seen = ViewedPoints(found.points_m, rays_of(devices[0], a), a, b)
    return segment_planes(seen, transfer_of(devices[1]), found.in_front)


def _adjusted_twice(
    x1: FloatArray, x2: FloatArray, start: PlanarScene, *, nominal: NominalIntrinsics, right_angles: bool
) -> BundleSolution | None:
    """Fit with free planes, then at right angles; find the planes again with these lenses, and fit again."""
    first = adjust(x1, x2, start, nominal, limits_px=(4.0, 1.5), iterations=6)
    if right_angles and first is not None:
        guesses = axis_hypotheses(first.planes, orthogonal_axes(first.planes, _GUESSED_LIMIT_DEG))
        starts = [replace(first, axes=axes) for axes in guesses]
        fits = [adjust(x1, x2, guess, nominal, limits_px=(1.5,), iterations=12) for guess in starts]
        first = max((fit for fit in fits if fit is not None), key=lambda fit: fit.share_on_axes, default=None)
    if first is None:
        return None
    planes = _planes_of(first.devices, x1, x2)
    if len(planes) < 2:
        return first
    again = _with_free_planes(first.devices, planes)
    if right_angles:
        again = replace(again, axes=orthogonal_axes(planes, _FITTED_LIMIT_DEG))
    second = adjust(x1, x2, again, nominal, limits_px=(1.5, 1.0), iterations=8)
    if second is None or _merit(second, right_angles) < _BETTER * _merit(first, right_angles):
        return first
    return second


def _merit(bundle: BundleSolution, right_angles: bool) -> float:
    """Share of the points that it explains, on walls at right angles where these are promised."""
    return bundle.share_on_axes if right_angles else bundle.share


def _with_free_planes(devices: tuple[PinholeModel, PinholeModel], planes: FloatArray) -> PlanarScene:
    free = Axes(np.eye(3), np.full(len(planes), -1))
    return PlanarScene(camera=devices[0], projector=devices[1], planes=planes, axes=free)


def _finished(bundle: BundleSolution, x1: FloatArray, x2: FloatArray) -> StereoCalibration:
    used = bundle.label >= 0
    planes = bundle.planes[bundle.label[used]]
    camera, projector = bundle.camera, bundle.projector
    projector_rms = _rms(project(projector, _points_on_planes(camera, x1[used], planes)) - x2[used])
    camera_rms = _rms(project(camera, _points_on_planes(projector, x2[used], planes)) - x1[used])
    return StereoCalibration(
        camera=camera,
        projector=projector,
        planes=bundle.planes,
        axes=tuple(int(a) for a in bundle.axes.of_plane),
        room_axes=bundle.axes.directions,
        rms_px=float(np.sqrt((camera_rms**2 + projector_rms**2) / 2)),
        camera_rms_px=camera_rms,
        projector_rms_px=projector_rms,
        sigmas=bundle.sigmas,
        inlier_share=float(used.mean()),
    )


def _points_on_planes(device: PinholeModel, xy_px: FloatArray, planes: FloatArray) -> FloatArray:
    origin, rays = device.position_m, world_rays(device, xy_px)
    along = (1 - planes @ origin) / np.maximum((rays * planes).sum(1), 1e-12)
    return np.asarray(origin + along[:, None] * rays)


def _rms(error: FloatArray) -> float:
    return float(np.sqrt((error**2).sum(axis=1).mean()))
