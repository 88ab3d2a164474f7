"""Self-calibration of a camera and a projector from dense correspondences in a room with flat walls.

Three stages. (1) Epipolar: relative pose from the essential matrix, refined over both focal lengths, k1 and the
projector's lens shift, tied to the data sheets: with optical axes that nearly meet, two views alone do not determine
the focal lengths. (2) The triangulated points are split into planes. (3) Plane-constrained bundle adjustment: every
point lies on its plane, so a correspondence gives two equations and no unknown; walls at right angles fix the focal
lengths, and all terms of both lenses become determined.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import OptimizeResult, least_squares

from calibration.pinhole import bearings, image_of, project, rotation_of, vector_of, world_rays
from calibration.planes import Axes, assign_planes, orthogonal_axes, segment_planes
from calibration.records import BoolArray, CalibrationError, FloatArray, PinholeModel

MIN_POINTS = 500
MIN_PARALLAX_PX = 2.0
_EPIPOLAR_POINTS = 4000
_PLANE_POINTS = 10000
_LENS = ("f", "cx", "cy", "k1", "k2", "p1", "p2")
_FOCAL_PRIOR = 0.05
"""Standard deviation of a data sheet's focal length, as a share."""


@dataclass(frozen=True, eq=False)
class PairCalibration:
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
        """Distance of the two centres of projection; 1 until scaled. [m]"""
        return float(np.linalg.norm(self.projector.position_m - self.camera.position_m))


@dataclass(frozen=True, eq=False)
class _Nominal:
    """Data sheets."""

    camera_focal_px: float
    projector_focal_px: float
    camera_shape: tuple[int, int]
    projector_shape: tuple[int, int]


def calibrate_pair(
    camera_xy_px: FloatArray,
    projector_xy_px: FloatArray,
    camera_shape: tuple[int, int],
    projector_shape: tuple[int, int],
    camera_hfov_deg: float,
    projector_hfov_deg: float,
    *,
    right_angles: bool = True,
    on_step: Callable[[int, int], None] = lambda done, total: None,
) -> PairCalibration:
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
        Too few points, too little parallax, or one plane only.
    """
    _check_count(len(camera_xy_px))
    nominal = _Nominal(
        _focal(camera_shape[1], camera_hfov_deg),
        _focal(projector_shape[1], projector_hfov_deg),
        camera_shape,
        projector_shape,
    )
    order = np.random.default_rng(0).permutation(len(camera_xy_px))
    few, many = order[:_EPIPOLAR_POINTS], order[:_PLANE_POINTS]
    _check_parallax(camera_xy_px[few], projector_xy_px[few], nominal)
    epipolar = _fit_epipolar(camera_xy_px[few], projector_xy_px[few], nominal)
    on_step(1, 3)
    camera, projector = _epipolar_models(epipolar, nominal)
    points, seen = _triangulated(camera, projector, camera_xy_px[few], projector_xy_px[few])
    planes = segment_planes(points, _transfer(camera, projector), projector_xy_px[few], camera_xy_px[few], seen)
    if len(planes) < 2:
        raise CalibrationError(
            f"all {len(camera_xy_px)} correspondences lie on {len(planes)} plane: a flat scene does not determine the "
            "lenses; aim at a corner, so that at least two walls are lit and seen"
        )
    on_step(2, 3)
    axes = orthogonal_axes(planes) if right_angles else Axes(np.eye(3), np.full(len(planes), -1))
    result = _fit_planes(camera_xy_px[many], projector_xy_px[many], camera, projector, planes, axes, nominal)
    on_step(3, 3)
    return result


def scale_pair(pair: PairCalibration, factor: float) -> PairCalibration:
    """Multiply every length by a factor."""
    projector = replace(pair.projector, translation_m=pair.projector.translation_m * factor)
    camera = replace(pair.camera, translation_m=pair.camera.translation_m * factor)
    return replace(pair, camera=camera, projector=projector, planes=pair.planes / factor)


def scale_from_baseline(pair: PairCalibration, baseline_m: float) -> PairCalibration:
    """Metres from the distance of the two lenses."""
    return scale_pair(pair, baseline_m / pair.baseline)


def scale_from_spots(pair: PairCalibration, spots_px: ArrayLike, distance_m: float) -> PairCalibration:
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


def points_of_projector_pixels(pair: PairCalibration, xy_px: FloatArray) -> FloatArray:
    """(N, 3) surface points that projector pixels light: the first plane in front. NaN where there is none."""
    origin, rays = pair.projector.position_m, world_rays(pair.projector, xy_px)
    with np.errstate(divide="ignore"):
        along = (1 - pair.planes @ origin)[None, :] / (rays @ pair.planes.T)
    along = np.where(along > 1e-9, along, np.inf).min(axis=1)
    return np.asarray(np.where(np.isfinite(along)[:, None], origin + np.minimum(along, 1e9)[:, None] * rays, np.nan))


def _focal(width_px: int, hfov_deg: float) -> float:
    return float(width_px / 2 / np.tan(np.radians(hfov_deg) / 2))


def _check_count(n: int) -> None:
    if n < MIN_POINTS:
        raise CalibrationError(
            f"{n} correspondences, at least {MIN_POINTS} are needed: look at exposure, focus and how much of the "
            "projector's picture the camera sees"
        )


# --- stage 1 -------------------------------------------------------------------------------------------------------


def _fit_epipolar(x1: FloatArray, x2: FloatArray, nominal: _Nominal) -> FloatArray:
    """Unknowns: camera focal ratio, k1; projector focal ratio, k1, principal row / height; rotation; translation."""
    best: OptimizeResult | None = None
    for row_share in (0.5, 0.75, 1.0, 0.25):
        start = _essential_start(x1, x2, nominal, row_share)
        if start is None:
            continue
        result = least_squares(
            _sampson, start, args=(x1, x2, nominal), loss="soft_l1", f_scale=0.5, max_nfev=60, x_scale=_EPIPOLAR_SCALE
        )
        if best is None or result.cost < best.cost:
            best = result
        if np.median(np.abs(_sampson(best.x, x1, x2, nominal)[: len(x1)])) < 0.5:
            break
    if best is None:
        raise CalibrationError(
            "no relative pose fits the correspondences: baseline zero, or the map is wrong; move the camera aside, and "
            "look at the correspondence map"
        )
    return np.asarray(best.x)


_EPIPOLAR_SCALE = np.array([0.05, 0.02, 0.05, 0.02, 0.05, 0.02, 0.02, 0.02, 0.05, 0.05, 0.05])


def _essential_start(x1: FloatArray, x2: FloatArray, nominal: _Nominal, row_share: float) -> FloatArray | None:
    centre = ((nominal.camera_shape[1] - 1) / 2, (nominal.camera_shape[0] - 1) / 2)
    shifted = ((nominal.projector_shape[1] - 1) / 2, nominal.projector_shape[0] * row_share)
    a = (x1 - centre) / nominal.camera_focal_px
    b = (x2 - shifted) / nominal.projector_focal_px
    cv2.setRNGSeed(0)
    essential, _ = cv2.findEssentialMat(
        a, b, np.eye(3), method=cv2.RANSAC, prob=0.999, threshold=3 / nominal.camera_focal_px
    )
    if essential is None or essential.shape[0] < 3:
        return None
    _, rotation, translation, _ = cv2.recoverPose(essential[:3], a, b, np.eye(3))
    return np.concatenate([[1, 0, 1, 0, row_share], vector_of(rotation), translation.ravel()])


def _epipolar_models(q: FloatArray, nominal: _Nominal) -> tuple[PinholeModel, PinholeModel]:
    translation = q[8:11] / np.linalg.norm(q[8:11])
    (h1, w1), (h2, w2) = nominal.camera_shape, nominal.projector_shape
    f1, f2 = float(q[0] * nominal.camera_focal_px), float(q[2] * nominal.projector_focal_px)
    camera = PinholeModel(
        w1, h1, (f1, f1), ((w1 - 1) / 2, (h1 - 1) / 2), (float(q[1]), 0, 0, 0, 0), np.eye(3), np.zeros(3)
    )
    projector = PinholeModel(
        w2,
        h2,
        (f2, f2),
        ((w2 - 1) / 2, float(q[4] * h2)),
        (float(q[3]), 0, 0, 0, 0),
        rotation_of(q[5:8]),
        np.asarray(translation),
    )
    return camera, projector


def _sampson(q: FloatArray, x1: FloatArray, x2: FloatArray, nominal: _Nominal) -> FloatArray:
    """(N + 5,) Sampson distances [px], then the ties to the data sheets."""
    camera, projector = _epipolar_models(q, nominal)
    a = bearings(x1, camera.focal_px[0], camera.principal_point_px, camera.distortion)
    b = bearings(x2, projector.focal_px[0], projector.principal_point_px, projector.distortion)
    t = projector.translation_m
    essential = np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]]) @ projector.rotation
    l2, l1 = a @ essential.T, b @ essential
    slope = (l2[:, :2] ** 2).sum(1) / projector.focal_px[0] ** 2 + (l1[:, :2] ** 2).sum(1) / camera.focal_px[0] ** 2
    distance = (b * l2).sum(1) / np.sqrt(np.maximum(slope, 1e-18))
    weight = np.sqrt(len(x1)) / 3
    ties = [(q[0] - 1) / _FOCAL_PRIOR, (q[2] - 1) / _FOCAL_PRIOR, q[1] / 0.05, q[3] / 0.05, (q[4] - 0.5) / 0.3]
    return np.concatenate([distance, weight * np.array(ties)])


def _triangulated(
    camera: PinholeModel, projector: PinholeModel, x1: FloatArray, x2: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """(N, 3) points on the camera's rays nearest to the projector's, and whether they lie in front."""
    a, b = world_rays(camera, x1), world_rays(projector, x2)
    offset = projector.position_m - camera.position_m
    cosine = (a * b).sum(1)
    sine2 = np.maximum(1 - cosine**2, 1e-12)
    along = (a @ offset - cosine * (b @ offset)) / sine2
    return camera.position_m + along[:, None] * a, np.asarray(along > 0)


def _check_parallax(x1: FloatArray, x2: FloatArray, nominal: _Nominal) -> None:
    """Fit a pure rotation between the devices: what is left over is parallax."""

    def residual(q: FloatArray) -> FloatArray:
        camera, projector = _epipolar_models(np.concatenate([q, [0, 0, 1]]), nominal)
        rays = bearings(x1, camera.focal_px[0], camera.principal_point_px, camera.distortion)
        turned = rays @ projector.rotation.T
        error = image_of(turned, projector.focal_px[0], projector.principal_point_px, projector.distortion) - x2
        return np.asarray(np.clip(error, -1e4, 1e4).ravel())

    camera, projector = _epipolar_models(np.array([1, 0, 1, 0, 0.5, 0, 0, 0, 0, 0, 1.0]), nominal)
    u, _, vt = np.linalg.svd(world_rays(projector, x2).T @ world_rays(camera, x1))
    start = np.concatenate([[1, 0, 1, 0, 0.5], vector_of(u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt)])
    result = least_squares(residual, start, loss="soft_l1", f_scale=1.0, max_nfev=30, x_scale=_EPIPOLAR_SCALE[:8])
    parallax_px = float(np.median(np.linalg.norm(residual(result.x).reshape(-1, 2), axis=1)))
    if parallax_px < MIN_PARALLAX_PX:
        raise CalibrationError(
            f"the parallax between camera and projector is {parallax_px:.2f} px, the limit is {MIN_PARALLAX_PX:g} px: "
            "the baseline is (nearly) zero and depth cannot be triangulated. Move the camera aside by 0.3 m or more"
        )


# --- stage 3 -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _PlaneProblem:
    """Unknowns z: 7 lens terms of each device (f and centre as shares), rotation, translation (its length is 1),
    a turn of the room's axes, and one offset for each plane on an axis or three numbers for each other plane.
    """

    x1: FloatArray
    x2: FloatArray
    plane: np.ndarray
    axes: Axes
    nominal: _Nominal

    def split(self, z: FloatArray) -> tuple[PinholeModel, PinholeModel, FloatArray]:
        (h1, w1), (h2, w2) = self.nominal.camera_shape, self.nominal.projector_shape
        camera = _lens_model(z[:7], self.nominal.camera_focal_px, w1, h1, np.eye(3), np.zeros(3))
        translation = z[17:20] / np.linalg.norm(z[17:20])
        projector = _lens_model(
            z[7:14], self.nominal.projector_focal_px, w2, h2, rotation_of(z[14:17]), np.asarray(translation)
        )
        return camera, projector, self.planes(z)

    def room_axes(self, z: FloatArray) -> FloatArray:
        return np.asarray(self.axes.directions @ rotation_of(z[20:23]).T)

    def planes(self, z: FloatArray) -> FloatArray:
        directions = self.room_axes(z)
        planes = np.empty((len(self.axes.of_plane), 3))
        at = 23
        for k, axis in enumerate(self.axes.of_plane):
            length = 1 if axis >= 0 else 3
            planes[k] = z[at] * directions[axis] if axis >= 0 else z[at : at + 3]
            at += length
        return planes

    def residual(self, z: FloatArray) -> FloatArray:
        camera, projector, planes = self.split(z)
        a = bearings(self.x1, camera.focal_px[0], camera.principal_point_px, camera.distortion)
        along = (a * planes[self.plane]).sum(1, keepdims=True)
        points = a / np.where(np.abs(along) > 1e-9, along, 1e-9)
        error = project(projector, points) - self.x2
        ties = [(z[0] - 1) / _FOCAL_PRIOR, (z[7] - 1) / _FOCAL_PRIOR]
        return np.concatenate([np.clip(error, -1e4, 1e4).ravel(), ties])


def _lens_model(
    z: FloatArray, focal_px: float, width_px: int, height_px: int, rotation: FloatArray, translation: FloatArray
) -> PinholeModel:
    f = float(z[0] * focal_px)
    centre = (float(z[1] * width_px), float(z[2] * height_px))
    k1, k2, p1, p2 = (float(v) for v in z[3:7])
    return PinholeModel(width_px, height_px, (f, f), centre, (k1, k2, p1, p2, 0.0), rotation, translation)


def _transfer(camera: PinholeModel, projector: PinholeModel) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """Where camera pixels land in the projector if their points lie on a plane (3,)."""

    def transfer(x1: FloatArray, plane: FloatArray) -> FloatArray:
        a = bearings(x1, camera.focal_px[0], camera.principal_point_px, camera.distortion)
        along = a @ plane
        return project(projector, a / np.where(np.abs(along) > 1e-9, along, 1e-9)[:, None])

    return transfer


def _fit_planes(
    x1: FloatArray,
    x2: FloatArray,
    camera: PinholeModel,
    projector: PinholeModel,
    planes: FloatArray,
    axes: Axes,
    nominal: _Nominal,
) -> PairCalibration:
    """Bundle adjustment with every point on its plane; points are assigned anew once the lenses are known."""
    label, _ = assign_planes(_transfer(camera, projector), x1, x2, planes, limit_px=4.0)
    z = _plane_start(camera, projector, planes, axes, nominal)
    for limit_px, evaluations in ((2.0, 12), (1.0, 40)):
        used = label >= 0
        problem = _PlaneProblem(x1[used], x2[used], label[used], axes, nominal)
        result = least_squares(
            problem.residual, z, loss="soft_l1", f_scale=0.3, x_scale="jac", max_nfev=evaluations, ftol=1e-7
        )
        z = result.x
        camera, projector, planes = problem.split(z)
        label, _ = assign_planes(_transfer(camera, projector), x1, x2, planes, limit_px)
    return _finished(problem, result, x1, x2, label)


def _plane_start(
    camera: PinholeModel, projector: PinholeModel, planes: FloatArray, axes: Axes, nominal: _Nominal
) -> FloatArray:
    def lens(model: PinholeModel, focal_px: float) -> list[float]:
        x, y = model.principal_point_px
        return [model.focal_px[0] / focal_px, x / model.width_px, y / model.height_px, *model.distortion[:4]]

    offsets = [
        [float(plane @ axes.directions[axis])] if axis >= 0 else plane.tolist()
        for plane, axis in zip(planes, axes.of_plane, strict=True)
    ]
    return np.concatenate(
        [
            lens(camera, nominal.camera_focal_px),
            lens(projector, nominal.projector_focal_px),
            vector_of(projector.rotation),
            projector.translation_m,
            np.zeros(3),
            *offsets,
        ]
    )


def _finished(
    problem: _PlaneProblem, result: OptimizeResult, x1: FloatArray, x2: FloatArray, label: np.ndarray
) -> PairCalibration:
    camera, projector, planes = problem.split(result.x)
    used = label >= 0
    points = _points_on_planes(camera, x1[used], planes[label[used]])
    projector_error = project(projector, points) - x2[used]
    back = _points_on_planes(projector, x2[used], planes[label[used]])
    camera_error = project(camera, back) - x1[used]
    camera_rms, projector_rms = (_rms(e) for e in (camera_error, projector_error))
    sigma = projector_rms / np.sqrt(2)
    return PairCalibration(
        camera,
        projector,
        planes,
        tuple(int(a) for a in problem.axes.of_plane),
        problem.room_axes(result.x),
        float(np.sqrt((camera_rms**2 + projector_rms**2) / 2)),
        camera_rms,
        projector_rms,
        _sigmas(result, sigma, problem.nominal),
        float(used.mean()),
    )


def _points_on_planes(device: PinholeModel, xy_px: FloatArray, planes: FloatArray) -> FloatArray:
    origin, rays = device.position_m, world_rays(device, xy_px)
    along = (1 - planes @ origin) / np.maximum((rays * planes).sum(1), 1e-12)
    return np.asarray(origin + along[:, None] * rays)


def _rms(error: FloatArray) -> float:
    return float(np.sqrt((error**2).sum(axis=1).mean()))


def _sigmas(result: OptimizeResult, sigma_px: float, nominal: _Nominal) -> dict[str, float]:
    """Standard deviations of the 14 lens terms; the scale of the translation is a free gauge, hence the pseudo-inverse."""
    covariance = np.linalg.pinv(result.jac.T @ result.jac, rcond=1e-13, hermitian=True) * sigma_px**2
    deviation = np.sqrt(np.maximum(np.diag(covariance)[:14], 0))
    (h1, w1), (h2, w2) = nominal.camera_shape, nominal.projector_shape
    units = [nominal.camera_focal_px, w1, h1, 1, 1, 1, 1, nominal.projector_focal_px, w2, h2, 1, 1, 1, 1]
    names = [f"{device}_{term}" for device in ("camera", "projector") for term in _LENS]
    return {name: float(d * u) for name, d, u in zip(names, deviation, units, strict=True)}
