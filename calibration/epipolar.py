"""Relative pose of a camera and a projector, and their lenses as far as two views tell; no scene model."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from calibration.pinhole import bearings, image_of, rotation_of, vector_of, world_rays
from calibration.records import BoolArray, CalibrationError, FloatArray, PinholeModel
from calibration.robust_fit import Fit, Residual, Ties, robust_fit

MIN_PARALLAX_PX = 2.0
_STARTS = ((0.5, 0.5), (0.5, 0.75), (0.5, 1.0), (0.5, 0.25), (0.5, 0.0), (0.62, 0.5), (0.38, 0.5))
"""Projector's principal point as shares of width and height: lens shift is mostly vertical."""
_FIT_POINTS = 1500


@dataclass(frozen=True, eq=False)
class DataSheets:
    """What is known of both devices beforehand."""

    camera_focal_px: float
    projector_focal_px: float
    camera_shape: tuple[int, int]
    projector_shape: tuple[int, int]

    @classmethod
    def of(
        cls,
        camera_shape: tuple[int, int],
        projector_shape: tuple[int, int],
        camera_hfov_deg: float,
        projector_hfov_deg: float,
    ) -> DataSheets:
        """From shapes (height, width) and horizontal fields of view."""
        focal = [
            float(shape[1] / 2 / np.tan(np.radians(hfov) / 2))
            for shape, hfov in ((camera_shape, camera_hfov_deg), (projector_shape, projector_hfov_deg))
        ]
        return cls(focal[0], focal[1], camera_shape, projector_shape)


# Unknowns: camera f / nominal, k1, k2; projector f / nominal, k1, k2, centre as shares of width and height;
# rotation, translation.
_EXPECTED = np.array([1, 0, 0, 1, 0, 0, 0.5, 0.5, 0, 0, 0, 0, 0, 0.0])
_SIGMA = np.array([0.05, 0.05, 0.02, 0.05, 0.05, 0.02, 0.06, 0.3, *[np.inf] * 6])
_POSE = 8


def models_of(q: FloatArray, sheets: DataSheets) -> tuple[PinholeModel, PinholeModel]:
    """Camera and projector of a vector of unknowns; baseline 1."""
    (h1, w1), (h2, w2) = sheets.camera_shape, sheets.projector_shape
    f1, f2 = float(q[0] * sheets.camera_focal_px), float(q[3] * sheets.projector_focal_px)
    k_camera, k_projector = ((float(a), float(b), 0.0, 0.0, 0.0) for a, b in (q[1:3], q[4:6]))
    centre, shifted = ((w1 - 1) / 2, (h1 - 1) / 2), (float(q[6] * w2), float(q[7] * h2))
    camera = PinholeModel(w1, h1, (f1, f1), centre, k_camera, np.eye(3), np.zeros(3))
    translation = np.asarray(q[11:14] / np.linalg.norm(q[11:14]))
    return camera, PinholeModel(w2, h2, (f2, f2), shifted, k_projector, rotation_of(q[8:11]), translation)


def fit_epipolar(x1: FloatArray, x2: FloatArray, sheets: DataSheets) -> list[tuple[PinholeModel, PinholeModel]]:
    """Candidates for both devices, the best first; each from another lens shift to start at.

    The fit is tied to the data sheets: with optical axes that nearly meet, two views do not determine the
    focal lengths; the planes of the next stage come out as planes even so.

    Raises
    ------
    CalibrationError
        If no relative pose fits.
    """
    few = slice(0, _FIT_POINTS)
    residual, ties = _sampson(x1[few], x2[few], sheets), _ties(min(len(x1), _FIT_POINTS))
    starts = [start for share in _STARTS if (start := _essential_start(x1, x2, sheets, share)) is not None]
    fits = [robust_fit(residual, s, ties, iterations=20, least_scale_px=0.3) for s in starts]
    if not fits:
        raise CalibrationError(
            "no relative pose fits the correspondences: baseline zero, or the map is wrong; move the camera "
            "aside, and look at the correspondence map"
        )
    fits.sort(key=lambda fit: _merit(fit, ties))
    chosen: list[tuple[PinholeModel, PinholeModel]] = []
    behind: list[tuple[PinholeModel, PinholeModel]] = []
    for fit in fits:
        pair, share = _in_front(*models_of(fit.z, sheets), x1[few], x2[few])
        known = any(_same_pose(pair[1], other[1]) for other in chosen + behind)
        if not known and _median(fit) <= max(1.0, 2 * _median(fits[0])):
            (chosen if share > 0.9 else behind).append(pair)
    return chosen + behind


def _median(fit: Fit) -> float:
    return float(np.median(np.abs(fit.residual)))


def _in_front(
    camera: PinholeModel, projector: PinholeModel, x1: FloatArray, x2: FloatArray
) -> tuple[tuple[PinholeModel, PinholeModel], float]:
    """Choose the translation's sign with most points in front (distances do not change); their share."""
    other = replace(projector, translation_m=-projector.translation_m)
    shares = [float(triangulated(camera, p, x1, x2)[1].mean()) for p in (projector, other)]
    return (camera, projector if shares[0] >= shares[1] else other), max(shares)


def _same_pose(a: PinholeModel, b: PinholeModel) -> bool:
    turn = np.abs(a.rotation - b.rotation).max()
    return bool(turn < 0.01 and np.abs(a.position_m - b.position_m).max() < 0.01)


def _ties(n: int) -> Ties:
    # One standard deviation off the data sheet must be worth 0.1 px over all points.
    return Ties(_EXPECTED, _SIGMA, n * 0.1**2)


def _merit(fit: Fit, ties: Ties) -> float:
    squares = np.minimum((fit.residual**2).sum(axis=1), 4.0)
    return float(squares.sum() + ties.cost(fit.z))


def _essential_start(
    x1: FloatArray, x2: FloatArray, sheets: DataSheets, shares: tuple[float, float]
) -> FloatArray | None:
    q = _EXPECTED.copy()
    q[6:8], q[11] = shares, 1
    camera, projector = models_of(q, sheets)
    a, b = ((x - m.principal_point_px) / m.focal_px[0] for x, m in ((x1, camera), (x2, projector)))
    cv2.setRNGSeed(0)
    limit = 5 / sheets.camera_focal_px
    essential, _ = cv2.findEssentialMat(a, b, np.eye(3), method=cv2.RANSAC, prob=0.99, threshold=limit, maxIters=200)
    if essential is None or essential.shape[0] < 3:
        return None
    _, rotation, translation, _ = cv2.recoverPose(essential[:3], a, b, np.eye(3))
    return np.concatenate([q[:_POSE], vector_of(np.asarray(rotation, dtype=np.float64)), np.ravel(translation)])


def _sampson(x1: FloatArray, x2: FloatArray, sheets: DataSheets) -> Residual:
    """Sampson distances (N, 1) in px, as a function of the unknowns."""

    def residual(q: FloatArray) -> FloatArray:
        camera, projector = models_of(q, sheets)
        a, b = (
            bearings(x, m.focal_px[0], m.principal_point_px, m.distortion) for x, m in ((x1, camera), (x2, projector))
        )
        t = projector.translation_m
        essential = np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]]) @ projector.rotation
        l2, l1 = a @ essential.T, b @ essential
        slope = (l2[:, :2] ** 2).sum(1) / projector.focal_px[0] ** 2 + (l1[:, :2] ** 2).sum(1) / camera.focal_px[0] ** 2
        return np.asarray((b * l2).sum(1) / np.sqrt(np.maximum(slope, 1e-18)))[:, None]

    return residual


def triangulated(
    camera: PinholeModel, projector: PinholeModel, x1: FloatArray, x2: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """(N, 3) points on the camera's rays nearest to the projector's; whether they lie in front of both."""
    a, b = world_rays(camera, x1), world_rays(projector, x2)
    offset = projector.position_m - camera.position_m
    cosine = (a * b).sum(1)
    sine2 = np.maximum(1 - cosine**2, 1e-12)
    along = (a @ offset - cosine * (b @ offset)) / sine2
    back = (cosine * (a @ offset) - b @ offset) / sine2
    return camera.position_m + along[:, None] * a, np.asarray((along > 0) & (back > 0))


def check_parallax(x1: FloatArray, x2: FloatArray, sheets: DataSheets) -> None:
    """Fit a pure rotation between the devices: what is left over is parallax.

    Raises
    ------
    CalibrationError
        If its median is under 2 px.
    """
    free = np.r_[0:_POSE, _POSE : _POSE + 3]
    x1, x2 = x1[:_FIT_POINTS], x2[:_FIT_POINTS]

    def residual(q: FloatArray) -> FloatArray:
        camera, projector = models_of(np.concatenate([q, [0, 0, 1]]), sheets)
        rays = bearings(x1, camera.focal_px[0], camera.principal_point_px, camera.distortion)
        turned = rays @ projector.rotation.T
        error = image_of(turned, projector.focal_px[0], projector.principal_point_px, projector.distortion) - x2
        return np.asarray(np.clip(error, -1e4, 1e4))

    camera, projector = models_of(np.append(_EXPECTED[:-1], 1.0), sheets)
    u, _, vt = np.linalg.svd(world_rays(projector, x2).T @ world_rays(camera, x1))
    start = np.concatenate([_EXPECTED[:_POSE], vector_of(u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt)])
    ties = Ties(_EXPECTED[free], _SIGMA[free], len(x1) * 0.1**2)
    fit = robust_fit(residual, start, ties, iterations=15, least_scale_px=1.0)
    parallax_px = float(np.median(np.linalg.norm(fit.residual, axis=1)))
    if parallax_px < MIN_PARALLAX_PX:
        raise CalibrationError(
            f"the median parallax between camera and projector is {parallax_px:.2f} px, below the limit of "
            f"{MIN_PARALLAX_PX:g} px: the baseline is (nearly) zero and depth cannot be triangulated. "
            "Move the camera aside by 0.3 m or more"
        )
