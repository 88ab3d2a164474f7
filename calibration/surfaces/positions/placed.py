"""Where a camera stands that saw the same projector's light: by the points that another position measured."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from calibration.arrays import FloatArray
from calibration.errors import CalibrationError
from calibration.geometry.pinhole import PinholeModel, project, rotation_of, world_rays
from calibration.geometry.robust_fit import Priors, robust_fit
from calibration.structured_light.correspondence import Correspondence
from calibration.surfaces.point_map import PointMap, point_map
from calibration.surfaces.positions.lit_map import read_at

LEAST_COMMON = 1000
"""Camera pixels that see what the other position measured, too: a patch of 30 by 30 and more."""
_FITTED = 2000
"""Of these, for the pose: codes err by lines of the projector, and more points of one line say nothing new."""
_ITERATIONS, _SCALE_PX = 40, 0.2
_LENS_SIGMAS = np.array([0.01, 0.01, 0.01, 0.01, 0.01])
"""Of focal length, of the principal point (of the width) and of k1 and k2, as another session found them: several times
what these state, so that the common points decide where they can."""
_PRIOR_PX = 0.1
"""Residual that weighs as much as one of these sigmas."""
_EDGE_PX = 5
"""Window about a pixel all of which has to be decoded: at edges codes of two surfaces mix."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PlacedCamera:
    """A camera in the world of another position's points."""

    camera: PinholeModel
    common: int
    """Of its pixels, those that see what the other position measured."""
    residual_px: float
    """Median distance of these from where the points are seen."""
    variants: tuple[PinholeModel, ...]
    """The camera a standard deviation further along each direction in which its pose and lens are uncertain."""


def place_camera(
    lit: PointMap, projector: PinholeModel, correspondence: Correspondence, start: PinholeModel
) -> PlacedCamera:
    """Find pose and lens of a camera by the points of a projector's pixels that it sees.

    Parameters
    ----------
    lit : PointMap
        Of the projector's pixels, from another position (:func:`calibration.surfaces.positions.lit_map.lit_map`).
    projector : PinholeModel
        In the world of these points.
    correspondence : Correspondence
        What the camera decoded.
    start : PinholeModel
        Its lens and its pose in that world, about.

    Returns
    -------
    PlacedCamera

    Raises
    ------
    CalibrationError
        It sees too little of what the other position measured; with how much.
    """
    inside = cv2.erode(correspondence.valid.astype(np.uint8), np.ones((_EDGE_PX, _EDGE_PX), np.uint8)) > 0
    rows, columns = np.nonzero(inside)
    code_px = correspondence.projector_xy_px[rows, columns].astype(np.float64)
    length_m = 1 / read_at(1 / lit.distance_m, code_px)
    known = np.flatnonzero(np.isfinite(length_m))
    if len(known) < LEAST_COMMON:
        raise CalibrationError(
            f"{len(known)} camera pixels see what the main position measured, too; at least {LEAST_COMMON} are needed "
            "to place the camera: let both positions see more of the same lit walls and things"
        )
    fitted = known[:: max(1, len(known) // _FITTED)]
    points_m = lit.origin_m + length_m[fitted, None] * world_rays(projector, code_px[fitted])
    seen_px = np.stack([columns, rows], axis=1)[fitted].astype(np.float64)

    def residual(z: FloatArray) -> FloatArray:
        return project(_moved(start, z), points_m) - seen_px

    priors = Priors.independent(np.zeros(11), np.concatenate([np.full(6, np.inf), _LENS_SIGMAS]), _PRIOR_PX**2)
    fit = robust_fit(residual, np.zeros(11), priors, iterations=_ITERATIONS, least_scale_px=_SCALE_PX)
    median_px = float(np.median(np.linalg.norm(fit.residual, axis=1)))
    value, direction = np.linalg.eigh(fit.hessian)
    # Half of the residuals, in two directions, are within 1.18 standard deviations of one.
    steps = (median_px / 1.18) * direction / np.sqrt(np.maximum(value, np.finfo(float).tiny))
    variants = tuple(_moved(start, fit.z + step) for step in steps.T)
    return PlacedCamera(camera=_moved(start, fit.z), common=len(known), residual_px=median_px, variants=variants)


def relative_to(projector: PinholeModel, camera: PinholeModel, own_projector: PinholeModel) -> PinholeModel:
    """Return a camera as it stands to its own world's projector, in the world of another."""
    turn = camera.rotation @ own_projector.rotation.T
    shift_m = camera.translation_m - turn @ own_projector.translation_m
    return replace(camera, rotation=turn @ projector.rotation, translation_m=turn @ projector.translation_m + shift_m)


def placement_sigma_m(
    placed: PlacedCamera, projector: PinholeModel, correspondence: Correspondence, points: PointMap
) -> FloatArray:
    """Return (H, W) standard deviation of distances by what is uncertain of a camera's place and lens. [m].

    Parameters
    ----------
    placed : PlacedCamera
    projector : PinholeModel
    correspondence : Correspondence
        What the camera decoded.
    points : PointMap
        The points of the pixels that are asked for.

    Returns
    -------
    (H, W) array
        NaN where there is no point.
    """
    total = np.zeros(points.distance_m.shape)
    for other in placed.variants:
        moved = point_map(correspondence, other, projector, points.known)
        places, there = (one.origin_m + one.distance_m[..., None] * one.rays for one in (points, moved))
        total += ((there - places) ** 2).sum(axis=-1)
    return np.asarray(np.sqrt(total))


def _moved(model: PinholeModel, z: FloatArray) -> PinholeModel:
    """A camera turned [rad], shifted [m], with another lens: log of its focal length, principal point, k1, k2."""
    turn = rotation_of(z[:3])
    fx, fy = model.focal_px
    cx, cy = model.principal_point_px
    return replace(
        model,
        rotation=turn @ model.rotation,
        translation_m=turn @ model.translation_m + z[3:6],
        focal_px=(fx * float(np.exp(z[6])), fy * float(np.exp(z[6]))),
        principal_point_px=(cx + model.width_px * float(z[7]), cy + model.width_px * float(z[8])),
        distortion=(model.distortion[0] + z[9], model.distortion[1] + z[10], *model.distortion[2:]),
    )
