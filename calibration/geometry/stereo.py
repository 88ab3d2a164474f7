"""Self-calibration of a camera and a projector from dense correspondences in a room with flat walls.

Three stages. (1) Epipolar: relative pose from the essential matrix, refined over focal lengths, distortion and
lens shift, tied to the data sheets: with optical axes that nearly meet, two views do not determine the focal
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

from calibration.geometry.epipolar import (
    COLUMN_SHARES,
    NominalIntrinsics,
    check_not_flat,
    check_parallax,
    fit_epipolar,
    triangulated,
)
from calibration.geometry.pinhole import project, world_rays
from calibration.geometry.plane_bundle import BundleSolution, adjust, rays_of, transfer_of
from calibration.geometry.planes import Axes, axis_hypotheses, orthogonal_axes, segment_planes
from calibration.records import CalibrationError, FloatArray, PinholeModel

MIN_POINTS = 500
LEAST_INLIER_SHARE = 0.5
_GOOD_SHARE = 0.9
_FEW, _SOME, _MANY = 4000, 3000, 10000
_GUESSED_LIMIT_DEG, _FITTED_LIMIT_DEG = 25.0, 3.0
"""How far a plane may stand from its axis, before and after the lenses are known."""


@dataclass(frozen=True, eq=False)
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
    camera_shape: tuple[int, int],
    projector_shape: tuple[int, int],
    camera_hfov_deg: float,
    projector_hfov_deg: float,
    *,
    right_angles: bool = True,
    on_step: Callable[[int, int], None] = lambda done, total: None,
) -> StereoCalibration:
    """Lenses, relative pose and planes from correspondences; unit of length is the baseline.

    Parameters
    ----------
    camera_xy_px, projector_xy_px : (N, 2)
        Corresponding pixels. [px]
    camera_shape, projector_shape : (height, width)
    camera_hfov_deg, projector_hfov_deg : float
        Nominal horizontal fields of view.
    right_angles : bool
        Planes that are nearly perpendicular are exactly so.

    Raises
    ------
    CalibrationError
        Too few points, too little parallax, one plane only, or no planes that explain the points.
    """
    _check_count(len(camera_xy_px))
    sheets = NominalIntrinsics.of(camera_shape, projector_shape, camera_hfov_deg, projector_hfov_deg)
    order = np.random.default_rng(0).permutation(len(camera_xy_px))[:_MANY]
    x1, x2 = camera_xy_px[order], projector_xy_px[order]
    check_parallax(x1[:_FEW], x2[:_FEW], sheets)
    check_not_flat(x1[:_FEW], x2[:_FEW], sheets)
    on_step(1, 3)
    bundle = _best_bundle(x1, x2, sheets, right_angles)
    on_step(2, 3)
    refined = adjust(x1, x2, bundle.devices, bundle.planes, bundle.axes, sheets, (1.0,), 20)
    on_step(3, 3)
    return _finished(refined or bundle, x1, x2)


def scale_pair(pair: StereoCalibration, factor: float) -> StereoCalibration:
    """Multiply every length by a factor."""
    projector = replace(pair.projector, translation_m=pair.projector.translation_m * factor)
    camera = replace(pair.camera, translation_m=pair.camera.translation_m * factor)
    return replace(pair, camera=camera, projector=projector, planes=pair.planes / factor)


def scale_from_baseline(pair: StereoCalibration, baseline_m: float) -> StereoCalibration:
    """Metres from the distance of the two lenses."""
    return scale_pair(pair, baseline_m / pair.baseline)


def scale_from_spots(pair: StereoCalibration, spots_px: ArrayLike, distance_m: float) -> StereoCalibration:
    """Metres from the distance between the spots that two projector pixels (2, 2) light on the planes.

    Raises
    ------
    CalibrationError
        If a spot lies on none of the planes, or both are one place.
    """
    spots = points_of_projector_pixels(pair, np.asarray(spots_px, dtype=np.float64))
    if not np.isfinite(spots).all():
        raise CalibrationError("a spot of [scale] spots_px meets no measured wall; choose two lit, seen pixels")
    measured = float(np.linalg.norm(spots[1] - spots[0]))
    if measured < 1e-6:
        raise CalibrationError("the two spots of [scale] spots_px are one place; choose two far apart")
    return scale_pair(pair, distance_m / measured)


def points_of_projector_pixels(pair: StereoCalibration, xy_px: FloatArray) -> FloatArray:
    """(N, 3) surface points that projector pixels light: first plane in front; NaN where there is none."""
    origin, rays = pair.projector.position_m, world_rays(pair.projector, xy_px)
    with np.errstate(divide="ignore"):
        along = (1 - pair.planes @ origin)[None, :] / (rays @ pair.planes.T)
    along = np.where(along > 1e-9, along, np.inf).min(axis=1)
    return np.asarray(np.where(np.isfinite(along)[:, None], origin + np.minimum(along, 1e9)[:, None] * rays, np.nan))


def _check_count(n: int) -> None:
    if n < MIN_POINTS:
        raise CalibrationError(
            f"{n} correspondences, at least {MIN_POINTS} are needed: look at exposure, focus and how much of "
            "the projector's picture the camera sees"
        )


def _best_bundle(x1: FloatArray, x2: FloatArray, sheets: NominalIntrinsics, right_angles: bool) -> BundleSolution:
    """First candidate whose planes explain nearly all points, or the one that explains most."""
    best, best_share = None, 0.0
    for candidate in chain.from_iterable(fit_epipolar(x1[:_FEW], x2[:_FEW], sheets, share) for share in COLUMN_SHARES):
        planes = _planes_of(candidate, x1, x2)
        if len(planes) < 2:
            continue
        bundle = _adjusted_twice(candidate, planes, x1[:_SOME], x2[:_SOME], sheets, right_angles)
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


def _planes_of(pair: tuple[PinholeModel, PinholeModel], x1: FloatArray, x2: FloatArray) -> FloatArray:
    a, b = x1[:_FEW], x2[:_FEW]
    points, usable = triangulated(*pair, a, b)
    return segment_planes(points, transfer_of(*pair), b, a, rays_of(pair[0], a), usable)


def _adjusted_twice(
    pair: tuple[PinholeModel, PinholeModel],
    planes: FloatArray,
    x1: FloatArray,
    x2: FloatArray,
    sheets: NominalIntrinsics,
    right_angles: bool,
) -> BundleSolution | None:
    """Fit with free planes, then at right angles; find the planes again with these lenses, and fit again."""
    first = adjust(x1, x2, pair, planes, _free(planes), sheets, (4.0, 1.5), 6)
    if right_angles and first is not None:
        guesses = axis_hypotheses(first.planes, orthogonal_axes(first.planes, _GUESSED_LIMIT_DEG))
        fits = [adjust(x1, x2, first.devices, first.planes, axes, sheets, (1.5,), 12) for axes in guesses]
        first = max((fit for fit in fits if fit is not None), key=lambda fit: fit.share_on_axes, default=None)
    if first is None:
        return None
    planes = _planes_of(first.devices, x1, x2)
    if len(planes) < 2:
        return first
    axes = orthogonal_axes(planes, _FITTED_LIMIT_DEG) if right_angles else _free(planes)
    second = adjust(x1, x2, first.devices, planes, axes, sheets, (1.5, 1.0), 8)
    return first if second is None or _merit(second, right_angles) < 0.98 * _merit(first, right_angles) else second


def _merit(bundle: BundleSolution, right_angles: bool) -> float:
    """Share of the points that it explains, on walls at right angles where these are promised."""
    return bundle.share_on_axes if right_angles else bundle.share


def _free(planes: FloatArray) -> Axes:
    return Axes(np.eye(3), np.full(len(planes), -1))


def _finished(bundle: BundleSolution, x1: FloatArray, x2: FloatArray) -> StereoCalibration:
    used = bundle.label >= 0
    planes = bundle.planes[bundle.label[used]]
    camera, projector = bundle.camera, bundle.projector
    projector_rms = _rms(project(projector, _points_on_planes(camera, x1[used], planes)) - x2[used])
    camera_rms = _rms(project(camera, _points_on_planes(projector, x2[used], planes)) - x1[used])
    return StereoCalibration(
        camera,
        projector,
        bundle.planes,
        tuple(int(a) for a in bundle.axes.of_plane),
        bundle.axes.directions,
        float(np.sqrt((camera_rms**2 + projector_rms**2) / 2)),
        camera_rms,
        projector_rms,
        bundle.sigmas,
        float(used.mean()),
    )


def _points_on_planes(device: PinholeModel, xy_px: FloatArray, planes: FloatArray) -> FloatArray:
    origin, rays = device.position_m, world_rays(device, xy_px)
    along = (1 - planes @ origin) / np.maximum((rays * planes).sum(1), 1e-12)
    return np.asarray(origin + along[:, None] * rays)


def _rms(error: FloatArray) -> float:
    return float(np.sqrt((error**2).sum(axis=1).mean()))
