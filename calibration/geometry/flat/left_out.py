"""A wall that a fit leaves out: a fit is no better for not looking at what contradicts it."""

from __future__ import annotations

import cv2
import numpy as np

from calibration.arrays import BoolArray, FloatArray
from calibration.errors import CalibrationError
from calibration.geometry.bundle_residual import rays_of
from calibration.geometry.bundle_unknowns import PlanarScene
from calibration.geometry.epipolar import UNDISTORTIONS
from calibration.geometry.plane_bundle import BundleSolution, transfer_of
from calibration.geometry.planes import INLIER_PX, ViewedPoints, segment_planes
from calibration.geometry.support import (
    bending_planes,
    explained_within_px,
    grows,
    plane_errors_px,
    side_by_side,
)
from calibration.geometry.triangulation import triangulate

MOST_LEFT_OUT = 0.1
"""Share of the points that furniture has at most; a flat piece with more is a wall."""
_ROUNDS, _LEAST_POINTS, _NUMBERS = 4, 30, 9
"""Of a homography's fit: from the second round on without strays; of fewer points nothing is told; what it has."""
_APART = 3.0
"""Times the limit within which a plane explains a point: what is further off lies on none."""


def check_none_left_out(solution: BundleSolution, x1: FloatArray, x2: FloatArray) -> None:
    """Refuse a fit beside whose planes a flat wall stands that it says nothing of.

    Lenses and angles that are wrong may be uncontradicted by what is left of the points.

    Parameters
    ----------
    solution : BundleSolution
        A fit.
    x1, x2 : (N, 2)
        Corresponding pixels of camera and projector. [px]

    Raises
    ------
    CalibrationError
        With the wall's share of the points, and where it is.
    """
    if 1 - solution.share <= MOST_LEFT_OUT:
        return
    errors = plane_errors_px(solution, x1, x2).min(axis=0)
    left = np.flatnonzero(errors > _APART * explained_within_px(errors))
    on_planes = errors <= explained_within_px(errors)
    pieces = _flat_pieces(solution, x1[left], x2[left], (x1[on_planes], x2[on_planes]))
    own = max(pieces, key=lambda piece: side_by_side(x1[left], piece), default=np.zeros(len(left), dtype=bool))
    share = side_by_side(x1[left], own) / len(x1) if own.any() else 0.0
    if share > MOST_LEFT_OUT:
        x, y = np.median(x1[left][own], axis=0)
        raise CalibrationError(
            f"{100 * share:.0f} % of the points, around camera pixel ({x:.0f}, {y:.0f}), lie on a flat wall that does "
            f"not go with the others, the limit is {100 * MOST_LEFT_OUT:.0f} %: it leans or stands askew, or hfov_deg "
            "of a device is wrong. Check hfov_deg; if it is right, say how far from square walls stand (askew_deg), "
            "set right_angles = false, or aim at walls that are square"
        )


def _flat_pieces(
    solution: BundleSolution, x1: FloatArray, x2: FloatArray, explained: tuple[FloatArray, FloatArray]
) -> list[BoolArray]:
    """(N,) points of each flat piece among them; tangents of a surface that bends are none.

    `explained` are the points of the fit's own planes: how near they lie to these says what is noise.
    """
    found = triangulate(x1, x2, *solution.devices, on_camera_rays=True, undistortions=UNDISTORTIONS)
    seen = ViewedPoints(found.points_m, rays_of(solution.camera, x1), x1, x2)
    planes = segment_planes(seen, transfer_of(solution.projector), found.in_front)
    within_px = explained_within_px(plane_errors_px(solution, *explained).min(axis=0))
    pieces = (_points_of(solution.with_planes(plane[None]), x1, x2, within_px) for plane in planes)
    return [own for own in pieces if own is not None]


def _points_of(piece: PlanarScene, x1: FloatArray, x2: FloatArray, within_px: float) -> BoolArray | None:
    """(N,) points on the only plane of a piece; None where it is but the tangent of a surface that bends."""
    error = plane_errors_px(piece, x1, x2)[0]
    near = error < _APART * INLIER_PX
    if bending_planes(piece, x1[near], x2[near])[0]:
        return None
    own = np.asarray(error < explained_within_px(error[near]))
    return None if _leaves_its_homography(piece, x1[own], x2[own], within_px) else own


def _leaves_its_homography(solution: PlanarScene, x1: FloatArray, x2: FloatArray, within_px: float) -> bool:
    """Tell whether points bend away from the homography nearest to them, by what is noise on the fit's own planes.

    A flat wall has one whatever the focal lengths and the pose are, so that a fit that is wrong does not bend it. Where
    planes explain points to within 0.3 px, a column 40 px wide kept within 1.5 px of its tangent's plane and passed
    for a wall (random world 116).
    """
    a, b = (rays_of(device, x) for device, x in zip(solution.devices, (x1, x2), strict=True))
    a, b = a[:, :2] / a[:, 2:], b[:, :2] / b[:, 2:] * solution.projector.focal_px
    on = np.ones(len(a), dtype=bool)
    error_px = np.zeros(len(a))
    for _ in range(_ROUNDS):
        if on.sum() < _LEAST_POINTS:
            return True
        homography, _ = cv2.findHomography(a[on], b[on])
        if np.size(homography) != _NUMBERS:
            return True
        there = np.column_stack([a, np.ones(len(a))]) @ np.asarray(homography).T
        error_px = np.linalg.norm(there[:, :2] / there[:, 2:] - b, axis=1)
        on = error_px < explained_within_px(error_px)
    return bool(grows(error_px[None], within_px)[0])
