"""Plane-constrained bundle adjustment: both lenses, relative pose and walls from points on the walls.

A camera pixel's ray meets its plane, the point is projected into the projector and compared: two equations a
correspondence and no unknown of its own. Walls at right angles fix the focal lengths.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.geometry.epipolar import NominalIntrinsics
from calibration.geometry.pinhole import bearings, project, rotation_of, vector_of
from calibration.geometry.planes import Axes, IntArray, Transfer, assign_planes
from calibration.geometry.robust_fit import Fit, Priors, Residual, covariance, robust_fit
from calibration.records import FloatArray, PinholeModel

LENS_TERMS = ("f", "cx", "cy", "k1", "k2", "p1", "p2")
"""Focal length and principal point as shares of nominal, width and height; distortion."""
_CAMERA_SIGMA = (0.05, 0.03, 0.03, 0.1, 0.05, 0.005, 0.005)
_PROJECTOR_SIGMA = (0.05, 0.10, 0.40, 0.1, 0.05, 0.005, 0.005)
_EXPECTED = (1.0, 0.5, 0.5, 0.0, 0.0, 0.0, 0.0)
_TIE_WEIGHT = 0.02
"""Variance of an independent observation: noise of 0.1 px, some neighbours with one error. [px²]"""
_POSE, _TURN, _PLANES = 14, 20, 23
_MARGIN_SHARE = 0.008
"""Points that two planes predict within this share of the projector's width lie near an edge: not used."""
_LEAST_POINTS = 200
_NOWHERE_PX = -1e6
_CLUSTER_PX = 32


@dataclass(frozen=True, eq=False)
class BundleSolution:
    """A solution: both devices, the walls, and which points were used."""

    camera: PinholeModel
    projector: PinholeModel
    planes: FloatArray
    axes: Axes
    label: IntArray
    """(N,) plane of each point, -1 where none predicts it to within the last limit."""
    sigmas: dict[str, float]
    """Standard deviations of the lens terms. [px or 1]"""

    @property
    def devices(self) -> tuple[PinholeModel, PinholeModel]:
        """Camera and projector."""
        return self.camera, self.projector

    @property
    def share(self) -> float:
        """Share of the points that the planes explain."""
        return float((self.label >= 0).mean())

    @property
    def share_on_axes(self) -> float:
        """Share of the points on planes perpendicular to an axis of the room."""
        on_axis = np.append(self.axes.of_plane >= 0, False)
        return float(on_axis[self.label].mean())


def transfer_of(camera: PinholeModel, projector: PinholeModel) -> Transfer:
    """Where the camera's rays land in the projector if their points lie on a plane, normal / offset (3,)."""

    def transfer(rays: FloatArray, plane: FloatArray) -> FloatArray:
        along = rays @ plane
        landed = _landed(projector, rays, along)
        # The same plane mirrored behind the devices would land on the same pixels.
        depth = (rays @ projector.rotation[2]) + projector.translation_m[2] * along
        return np.where(((along > 0) & (depth > 0))[:, None], landed, _NOWHERE_PX)

    return transfer


def rays_of(camera: PinholeModel, x1: FloatArray) -> FloatArray:
    """(N, 3) directions of camera pixels."""
    return bearings(x1, camera.focal_px[0], camera.principal_point_px, camera.distortion)


def _landed(projector: PinholeModel, rays: FloatArray, along: FloatArray) -> FloatArray:
    return project(projector, rays / np.where(np.abs(along) > 1e-9, along, 1e-9)[:, None])


def adjust(
    x1: FloatArray,
    x2: FloatArray,
    start: tuple[PinholeModel, PinholeModel],
    planes: FloatArray,
    axes: Axes,
    sheets: NominalIntrinsics,
    limits_px: tuple[float, ...],
    iterations: int,
) -> BundleSolution | None:
    """Fit, with points assigned to planes anew, within a smaller limit, before each round.

    None where fewer than 200 points are left: the start was wrong.
    """
    camera, projector = start
    z = _start(camera, projector, planes, axes, sheets)
    margin_px = _MARGIN_SHARE * sheets.projector_shape[1]
    for limit_px in limits_px:
        label = assign_planes(transfer_of(camera, projector), rays_of(camera, x1), x2, planes, limit_px, margin_px)
        used = label >= 0
        if used.sum() < _LEAST_POINTS:
            return None
        residual = _residual(x1[used], x2[used], label[used], axes, sheets)
        fit = robust_fit(residual, z, _ties(len(z)), iterations=iterations, least_scale_px=0.3)
        z = fit.z
        camera, projector = _models(z, sheets)
        planes = _planes(z, axes)
    turned = Axes(_directions(z, axes), axes.of_plane)
    label = assign_planes(transfer_of(camera, projector), rays_of(camera, x1), x2, planes, limits_px[-1])
    return BundleSolution(camera, projector, planes, turned, label, _sigmas(fit, x1[used], sheets))


def _start(
    camera: PinholeModel, projector: PinholeModel, planes: FloatArray, axes: Axes, sheets: NominalIntrinsics
) -> FloatArray:
    def lens(model: PinholeModel, focal_px: float) -> list[float]:
        x, y = model.principal_point_px
        return [model.focal_px[0] / focal_px, x / model.width_px, y / model.height_px, *model.distortion[:4]]

    offsets = [
        [float(plane @ axes.directions[axis])] if axis >= 0 else plane.tolist()
        for plane, axis in zip(planes, axes.of_plane, strict=True)
    ]
    lenses = [lens(camera, sheets.camera_focal_px), lens(projector, sheets.projector_focal_px)]
    return np.concatenate([*lenses, vector_of(projector.rotation), projector.translation_m, np.zeros(3), *offsets])


def _ties(n: int) -> Priors:
    expected, sigma = np.zeros(n), np.full(n, np.inf)
    expected[:_POSE] = _EXPECTED * 2
    sigma[:_POSE] = _CAMERA_SIGMA + _PROJECTOR_SIGMA
    return Priors(expected, sigma, _TIE_WEIGHT)


def _models(z: FloatArray, sheets: NominalIntrinsics) -> tuple[PinholeModel, PinholeModel]:
    translation = np.asarray(z[17:20] / np.linalg.norm(z[17:20]))
    camera = _lens_model(z[:7], sheets.camera_focal_px, sheets.camera_shape, np.eye(3), np.zeros(3))
    rotation = rotation_of(z[14:17])
    return camera, _lens_model(z[7:14], sheets.projector_focal_px, sheets.projector_shape, rotation, translation)


def _lens_model(
    z: FloatArray, focal_px: float, shape: tuple[int, int], rotation: FloatArray, translation: FloatArray
) -> PinholeModel:
    height_px, width_px = shape
    f = float(z[0] * focal_px)
    centre = (float(z[1] * width_px), float(z[2] * height_px))
    k1, k2, p1, p2 = (float(v) for v in z[3:7])
    return PinholeModel(width_px, height_px, (f, f), centre, (k1, k2, p1, p2, 0.0), rotation, translation)


def _directions(z: FloatArray, axes: Axes) -> FloatArray:
    return np.asarray(axes.directions @ rotation_of(z[_TURN:_PLANES]).T)


def _planes(z: FloatArray, axes: Axes) -> FloatArray:
    directions = _directions(z, axes)
    planes = np.empty((len(axes.of_plane), 3))
    at = _PLANES
    for k, axis in enumerate(axes.of_plane):
        planes[k] = z[at] * directions[axis] if axis >= 0 else z[at : at + 3]
        at += 1 if axis >= 0 else 3
    return planes


def _residual(x1: FloatArray, x2: FloatArray, label: IntArray, axes: Axes, sheets: NominalIntrinsics) -> Residual:
    kept: dict[bytes, FloatArray] = {}  # only seven of some thirty unknowns change the camera's rays

    def residual(z: FloatArray) -> FloatArray:
        camera, projector = _models(z, sheets)
        key = z[:7].tobytes()
        if key not in kept:
            if len(kept) > 1:
                kept.pop(next(iter(kept)))
            kept[key] = rays_of(camera, x1)
        rays = kept[key]
        along = (rays * _planes(z, axes)[label]).sum(1)
        return np.asarray(np.clip(_landed(projector, rays, along) - x2, -1e4, 1e4))

    return residual


def _sigmas(fit: Fit, x1: FloatArray, sheets: NominalIntrinsics) -> dict[str, float]:
    cell = (x1 // _CLUSTER_PX).astype(np.int64)
    deviation = np.sqrt(np.diag(covariance(fit, cell[:, 0] * 100_000 + cell[:, 1]))[:_POSE])
    (h1, w1), (h2, w2) = sheets.camera_shape, sheets.projector_shape
    units = [sheets.camera_focal_px, w1, h1, 1, 1, 1, 1, sheets.projector_focal_px, w2, h2, 1, 1, 1, 1]
    names = [f"{device}_{term}" for device in ("camera", "projector") for term in LENS_TERMS]
    return {name: float(d * u) for name, d, u in zip(names, deviation, units, strict=True)}
