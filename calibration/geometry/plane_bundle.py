"""Plane-constrained bundle adjustment: both lenses, relative pose and walls from points on the walls.

A camera pixel's ray meets its plane, the point is projected into the projector and compared: two equations a
correspondence and no unknown of its own. Walls at right angles fix the focal lengths.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.arrays import FloatArray, IntArray
from calibration.geometry.epipolar import NominalIntrinsics
from calibration.geometry.pinhole import PinholeModel, bearings, project, rotation_of, vector_of
from calibration.geometry.planes import Axes, Transfer, assign_planes
from calibration.geometry.robust_fit import Fit, Priors, Residual, covariance, robust_fit

LENS_TERMS = ("f", "cx", "cy", "k1", "k2", "p1", "p2")
"""Focal length and principal point as shares of nominal, width and height; distortion."""
# Standard deviations of what data sheets and mounting leave open; the projector's lens may be shifted upwards.
_CAMERA_SIGMA = (0.05, 0.03, 0.03, 0.1, 0.05, 0.005, 0.005)
_PROJECTOR_SIGMA = (0.05, 0.10, 0.40, 0.1, 0.05, 0.005, 0.005)
_EXPECTED = (1.0, 0.5, 0.5, 0.0, 0.0, 0.0, 0.0)
_PRIOR_WEIGHT = 0.02
"""Variance of an independent observation: noise of 0.1 px, some neighbours with one error. [px²]"""
_POSE, _TURN, _PLANES = 14, 20, 23
_MARGIN_SHARE = 0.008
"""Points that two planes predict within this share of the projector's width lie near an edge: not used."""
_LEAST_POINTS = 200
"""Correspondences for some thirty unknowns."""
_LEAST_SCALE_PX = 0.3
"""Of the robust fit: twice the noise of a sub-pixel correspondence."""
_NOWHERE_PX = -1e6
_CLUSTER_PX = 32
"""Side of the camera's squares within which points share their error: three windows of the sub-pixel refinement."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PlanarScene:
    """Both devices and the walls that they see: where a fit begins."""

    camera: PinholeModel
    projector: PinholeModel
    planes: FloatArray
    """(K, 3) as normal / offset."""
    axes: Axes

    @property
    def devices(self) -> tuple[PinholeModel, PinholeModel]:
        """Camera and projector."""
        return self.camera, self.projector


@dataclass(frozen=True, eq=False, kw_only=True)
class BundleSolution(PlanarScene):
    """Where a fit ends, and which points were used."""

    label: IntArray
    """(N,) plane of each point, -1 where none predicts it to within the last limit."""
    sigmas: dict[str, float]
    """Standard deviations of the lens terms. [px or 1]"""

    @property
    def share(self) -> float:
        """Share of the points that the planes explain."""
        return float((self.label >= 0).mean())

    @property
    def share_on_axes(self) -> float:
        """Share of the points on planes perpendicular to an axis of the room."""
        on_axis = np.append(self.axes.of_plane >= 0, False)
        return float(on_axis[self.label].mean())


def transfer_of(projector: PinholeModel) -> Transfer:
    """Return where the camera's rays land in the projector if their points lie on a plane, normal / offset (3,)."""

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
    start: PlanarScene,
    nominal: NominalIntrinsics,
    *,
    limits_px: tuple[float, ...],
    iterations: int,
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
    limits_px : tuple of float
        One a round: points are assigned to planes anew, within this limit, before each. [px]
    iterations : int
        At most, a round.

    Returns
    -------
    BundleSolution or None
        None where fewer than 200 points are left: the start was wrong.
    """
    (camera, projector), planes, axes = start.devices, start.planes, start.axes
    z = _start(start, nominal)
    margin_px = _MARGIN_SHARE * nominal.projector_shape[1]
    for limit_px in limits_px:
        rays = rays_of(camera, x1)
        label = assign_planes(transfer_of(projector), rays, x2, planes, limit_px=limit_px, margin_px=margin_px)
        used = label >= 0
        if used.sum() < _LEAST_POINTS:
            return None
        residual = _residual(x1[used], x2[used], label[used], axes=axes, nominal=nominal)
        fit = robust_fit(residual, z, _priors(len(z)), iterations=iterations, least_scale_px=_LEAST_SCALE_PX)
        z = fit.z
        camera, projector = _models(z, nominal)
        planes = _planes(z, axes)
    turned = Axes(_directions(z, axes), axes.of_plane)
    label = assign_planes(transfer_of(projector), rays_of(camera, x1), x2, planes, limit_px=limits_px[-1])
    return BundleSolution(
        camera=camera,
        projector=projector,
        planes=planes,
        axes=turned,
        label=label,
        sigmas=_sigmas(fit, x1[used], nominal),
    )


def _start(scene: PlanarScene, nominal: NominalIntrinsics) -> FloatArray:
    def lens(model: PinholeModel, focal_px: float) -> list[float]:
        x, y = model.principal_point_px
        return [model.focal_px[0] / focal_px, x / model.width_px, y / model.height_px, *model.distortion[:4]]

    offsets = [
        [float(plane @ scene.axes.directions[axis])] if axis >= 0 else plane.tolist()
        for plane, axis in zip(scene.planes, scene.axes.of_plane, strict=True)
    ]
    lenses = [lens(scene.camera, nominal.camera_focal_px), lens(scene.projector, nominal.projector_focal_px)]
    pose = [vector_of(scene.projector.rotation), scene.projector.translation_m]
    return np.concatenate([*lenses, *pose, np.zeros(3), *offsets])


def _priors(n: int) -> Priors:
    expected, sigma = np.zeros(n), np.full(n, np.inf)
    expected[:_POSE] = _EXPECTED * 2
    sigma[:_POSE] = _CAMERA_SIGMA + _PROJECTOR_SIGMA
    return Priors(expected, sigma, _PRIOR_WEIGHT)


def _models(z: FloatArray, nominal: NominalIntrinsics) -> tuple[PinholeModel, PinholeModel]:
    translation = np.asarray(z[17:20] / np.linalg.norm(z[17:20]))
    pose = rotation_of(z[14:17]), translation
    camera = _lens_model(z[:7], nominal.camera_focal_px, nominal.camera_shape, (np.eye(3), np.zeros(3)))
    return camera, _lens_model(z[7:14], nominal.projector_focal_px, nominal.projector_shape, pose)


def _lens_model(
    z: FloatArray, focal_px: float, shape: tuple[int, int], pose: tuple[FloatArray, FloatArray]
) -> PinholeModel:
    height_px, width_px = shape
    f = float(z[0] * focal_px)
    centre = (float(z[1] * width_px), float(z[2] * height_px))
    k1, k2, p1, p2 = (float(v) for v in z[3:7])
    return PinholeModel(
        width_px=width_px,
        height_px=height_px,
        focal_px=(f, f),
        principal_point_px=centre,
        distortion=(k1, k2, p1, p2, 0.0),
        rotation=pose[0],
        translation_m=pose[1],
    )


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


def _residual(x1: FloatArray, x2: FloatArray, label: IntArray, *, axes: Axes, nominal: NominalIntrinsics) -> Residual:
    kept: dict[bytes, FloatArray] = {}  # only seven of some thirty unknowns change the camera's rays

    def residual(z: FloatArray) -> FloatArray:
        camera, projector = _models(z, nominal)
        key = z[:7].tobytes()
        if key not in kept:
            if len(kept) > 1:
                kept.pop(next(iter(kept)))
            kept[key] = rays_of(camera, x1)
        rays = kept[key]
        along = (rays * _planes(z, axes)[label]).sum(1)
        return np.asarray(np.clip(_landed(projector, rays, along) - x2, -1e4, 1e4))

    return residual


def _sigmas(fit: Fit, x1: FloatArray, nominal: NominalIntrinsics) -> dict[str, float]:
    cell = (x1 // _CLUSTER_PX).astype(np.int64)
    deviation = np.sqrt(np.diag(covariance(fit, cell[:, 0] * 100_000 + cell[:, 1]))[:_POSE])
    (h1, w1), (h2, w2) = nominal.camera_shape, nominal.projector_shape
    units = [nominal.camera_focal_px, w1, h1, 1, 1, 1, 1, nominal.projector_focal_px, w2, h2, 1, 1, 1, 1]
    names = [f"{device}_{term}" for device in ("camera", "projector") for term in LENS_TERMS]
    return {name: float(d * u) for name, d, u in zip(names, deviation, units, strict=True)}
