"""How much of a scene one plane explains, and whether there is any parallax: before the lenses are known."""

from __future__ import annotations

import cv2
import numpy as np

from calibration.arrays import FloatArray
from calibration.errors import CalibrationError
from calibration.geometry.epipolar import (
    EXPECTED,
    FIT_POINTS,
    POSE,
    SIGMA,
    models_of,
    nominal_unknowns,
    priors_about,
    spread_of,
    turn_between,
)
from calibration.geometry.known.nominal import NominalIntrinsics
from calibration.geometry.pinhole import bearings, image_of
from calibration.geometry.robust_fit import robust_fit

FLAT_SHARE, _FLAT_PX = 0.97, 1.0
"""So many so near to one plane's homography leave nothing that would tell the lenses; whole codes are so near."""
MIN_PARALLAX_PX = 2.0
"""Median; below, a tenth of a pixel of noise is a twentieth of the depth."""
_HOMOGRAPHY_PX = 20
"""Inlier limit before the lenses are known: distortion moves points by so much at a flat scene's rim."""
_MOST_PULL = 16.0
"""Chi-squared of the lenses' eight terms, which one pair of lenses in twenty-four exceeds: beyond, a pure rotation
needs other lenses. Of 14 simulated rotations 12 had less; what is left of the distance refuses the other two."""


def flat_share(x1: FloatArray, x2: FloatArray, nominal: NominalIntrinsics) -> float:
    """Return the share of the points that one plane's homography between both pictures, with distortion, explains.

    Above 97 % the scene is flat: nothing is left that would tell the lenses.

    Raises
    ------
    CalibrationError
        If it is flat because there is no baseline: a pure rotation leaves too little parallax over, with lenses that
        the data sheets allow. With others a baseline along a wall looks like a lens shift.
    """
    camera, projector = models_of(nominal_unknowns(), nominal)
    x1, x2 = x1[:FIT_POINTS], x2[:FIT_POINTS]
    a = bearings(x1, camera.focal_px[0], camera.principal_point_px, camera.distortion)
    b = bearings(x2, projector.focal_px[0], projector.principal_point_px, projector.distortion)
    cv2.setRNGSeed(0)
    homography, _ = cv2.findHomography(a[:, :2], b[:, :2], cv2.RANSAC, _HOMOGRAPHY_PX / projector.focal_px[0])
    if np.size(homography) != 9:
        return 0.0

    def residual(z: FloatArray) -> FloatArray:
        rays = bearings(x1, camera.focal_px[0], camera.principal_point_px, [z[8], z[9], 0, 0, 0])
        moved = rays @ np.append(z[:8], 1.0).reshape(3, 3).T
        image = image_of(moved, projector.focal_px[0], projector.principal_point_px, [z[10], z[11], 0, 0, 0])
        return np.asarray(np.clip(image - x2, -1e4, 1e4))

    start = np.append(np.asarray(homography, dtype=np.float64).ravel()[:8], np.zeros(4))
    priors = priors_about(start, np.array([np.inf] * 8 + [0.05, 0.02] * 2), len(x1))
    fit = robust_fit(residual, start, priors, iterations=15, least_scale_px=1.0)
    explained = float((np.linalg.norm(fit.residual, axis=1) < _FLAT_PX).mean())
    if explained > FLAT_SHARE:
        parallax_px, pull = _parallax_px(x1, x2, nominal)
        if parallax_px < MIN_PARALLAX_PX and pull < _MOST_PULL:
            raise CalibrationError(_no_parallax(parallax_px))
    return explained


def _parallax_px(x1: FloatArray, x2: FloatArray, nominal: NominalIntrinsics) -> tuple[float, float]:
    """Median of what a pure rotation between the devices leaves over, and chi-squared of its lenses."""
    free = np.r_[0:POSE, POSE : POSE + 3]
    x1, x2 = x1[:FIT_POINTS], x2[:FIT_POINTS]

    def residual(q: FloatArray) -> FloatArray:
        camera, projector = models_of(np.concatenate([q, [0, 0, 1]]), nominal)
        rays = bearings(x1, camera.focal_px[0], camera.principal_point_px, camera.distortion)
        turned = rays @ projector.rotation.T
        error = image_of(turned, projector.focal_px[0], projector.principal_point_px, projector.distortion) - x2
        return np.asarray(np.clip(error, -1e4, 1e4))

    camera, projector = models_of(nominal_unknowns(), nominal)
    start = np.concatenate([EXPECTED[:POSE], turn_between(x1, x2, camera, projector)])
    priors = priors_about(EXPECTED[free], (SIGMA * spread_of(nominal))[free], len(x1))
    fit = robust_fit(residual, start, priors, iterations=15, least_scale_px=1.0)
    return float(np.median(np.linalg.norm(fit.residual, axis=1))), priors.cost(fit.z) / priors.weight


def _no_parallax(parallax_px: float) -> str:
    return (
        f"the median parallax between camera and projector is {parallax_px:.2f} px, below the limit of "
        f"{MIN_PARALLAX_PX:g} px: the baseline is (nearly) zero, or one device stands behind the other, or all that is "
        "seen is one flat wall far away; depth cannot be triangulated. Move the camera aside by 0.3 m or more, and aim "
        "at a corner"
    )
