"""A camera and a projector that boards measured together, held against the correspondences of a scan.

All that the boards left open may still move: the correspondences pull lenses and pose along the boards' covariance, by
their distances from the epipolar lines, and what is open after that is the uncertainty of the points.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calibration.arrays import FloatArray
from calibration.geometry.noise import covariance, normal_deviate, observation_variance
from calibration.geometry.pinhole import PinholeModel, rotation_of
from calibration.geometry.robust_fit import Priors, robust_fit
from calibration.geometry.triangulation import triangulate
from calibration.lenses.lens import N, ideal_coordinates

_POINTS, _SIGMA_POINTS = 1500, 400
"""Correspondences that pull, and points whose sigma is computed."""
_ITERATIONS = 12
_LEAST_SCALE_PX, _VARIANCE_PX2 = 0.3, 0.02
"""Of the robust fit, and of an independent observation before it is measured, as in the bundle on walls."""
_TOLD = 0.05
"""Of the prior's variance that the points have to take away before they can contradict a direction."""
_STEP = 1e-3
"""Of a standard deviation, over which derivatives are taken."""


@dataclass(frozen=True, eq=False, kw_only=True)
class KnownPair:
    """Lenses and relative pose with all of their covariance."""

    shapes: tuple[tuple[int, int], tuple[int, int]]
    """(height, width) of camera and projector. [px]"""
    lenses: tuple[FloatArray, FloatArray]
    """(12,) each, in the order of :data:`calibration.lenses.lens.PARAMETERS`."""
    rotation: FloatArray
    """(3, 3) projector_from_camera."""
    translation_m: FloatArray
    """(3,)"""
    covariance: FloatArray
    """(30, 30) of both lenses' parameters, of a turn of the projector [rad], of the translation [m]."""

    @cached_property
    def spread(self) -> FloatArray:
        """(30, n) how the parameters follow n independent standard normal unknowns."""
        scale = np.sqrt(np.diag(self.covariance))
        free = np.flatnonzero(scale > 0)
        correlation = self.covariance[np.ix_(free, free)] / np.outer(scale[free], scale[free])
        values, vectors = np.linalg.eigh(correlation)
        result = np.zeros((len(scale), len(free)))
        result[free] = scale[free][:, None] * vectors * np.sqrt(np.maximum(values, 0))
        return result

    def devices(self, unknowns: FloatArray) -> tuple[PinholeModel, PinholeModel]:
        """Camera, in whose frame the world is, and projector, so many standard deviations off."""
        change = self.spread @ unknowns
        rotation = rotation_of(change[2 * N : 2 * N + 3]) @ self.rotation
        camera = _model(self.lenses[0] + change[:N], self.shapes[0], np.eye(3), np.zeros(3))
        shift = self.translation_m + change[2 * N + 3 :]
        return camera, _model(self.lenses[1] + change[N : 2 * N], self.shapes[1], rotation, shift)


@dataclass(frozen=True, eq=False, kw_only=True)
class HeldPair:
    """A pair after the correspondences of a scan."""

    devices: tuple[PinholeModel, PinholeModel]
    contradiction_sigmas: float
    """By how much the correspondences contradict the boards, as a standard normal deviate."""
    epipolar_before_px: float
    """Median distance from the epipolar lines with the boards' values. [px]"""
    sigma_share: float
    """Median standard deviation of a point's distance from the camera, as a share of it, that lenses and pose leave."""


def hold_pair(known: KnownPair, x1: FloatArray, x2: FloatArray) -> HeldPair:
    """Fit lenses and pose to correspondences, with what boards said as the prior.

    Parameters
    ----------
    known : KnownPair
    x1, x2 : (N, 2)
        Corresponding pixels of camera and projector. [px]

    Returns
    -------
    HeldPair
    """
    few = np.random.default_rng(0).permutation(len(x1))[:_POINTS]
    a, b = x1[few], x2[few]

    def residual(z: FloatArray) -> FloatArray:
        return epipolar_errors_px(known.devices(z), a, b)[:, None]

    n = known.spread.shape[1]
    variance = _VARIANCE_PX2
    for _ in range(2):
        priors = Priors.independent(np.zeros(n), np.ones(n), variance)
        fit = robust_fit(residual, np.zeros(n), priors, iterations=_ITERATIONS, least_scale_px=_LEAST_SCALE_PX)
        variance = observation_variance(fit, a, np.zeros(len(a), dtype=np.int64), b)
    left = covariance(fit, fit.priors.weight)
    return HeldPair(
        devices=known.devices(fit.z),
        contradiction_sigmas=_contradiction(fit.z, left),
        epipolar_before_px=float(np.median(np.abs(residual(np.zeros(n))))),
        sigma_share=_sigma_share(known, fit.z, left, (a[:_SIGMA_POINTS], b[:_SIGMA_POINTS])),
    )


def epipolar_errors_px(devices: tuple[PinholeModel, PinholeModel], x1: FloatArray, x2: FloatArray) -> FloatArray:
    """(N,) signed Sampson distances of correspondences from their epipolar lines. [px].

    R. Hartley and A. Zisserman, Multiple View Geometry, 2nd edition, Cambridge 2004, equation 11.9.
    """
    camera, projector = devices
    a, b = (_bearings(device, x) for device, x in ((camera, x1), (projector, x2)))
    x, y, z = projector.translation_m
    essential = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ projector.rotation
    l2, l1 = a @ essential.T, b @ essential
    slope = ((l2[:, :2] / projector.focal_px) ** 2).sum(1) + ((l1[:, :2] / camera.focal_px) ** 2).sum(1)
    return np.asarray((b * l2).sum(1) / np.sqrt(np.maximum(slope, 1e-18)))


def _bearings(device: PinholeModel, xy_px: FloatArray) -> FloatArray:
    terms = np.zeros(N - 4)
    terms[: len(device.distortion)] = device.distortion
    plane, _ = ideal_coordinates(np.concatenate([device.focal_px, device.principal_point_px, terms]), xy_px)
    return np.column_stack([plane, np.ones(len(plane))])


def _model(vector: FloatArray, shape: tuple[int, int], rotation: FloatArray, translation_m: FloatArray) -> PinholeModel:
    fx, fy, cx, cy, *terms = vector.tolist()
    return PinholeModel(
        width_px=shape[1],
        height_px=shape[0],
        focal_px=(fx, fy),
        principal_point_px=(cx, cy),
        distortion=tuple(terms if any(terms[5:]) else terms[:5]),  # or eight
        rotation=rotation,
        translation_m=translation_m,
    )


def _contradiction(z: FloatArray, left: FloatArray) -> float:
    """How unlikely the unknowns' way from the boards' values is, in the directions that the points tell."""
    values, vectors = np.linalg.eigh(np.eye(len(z)) - left)
    told = values > _TOLD
    moved = (vectors.T @ z)[told] ** 2 / values[told]
    return normal_deviate(float(moved.sum()), int(told.sum()))


def _sigma_share(known: KnownPair, z: FloatArray, left: FloatArray, pixels: tuple[FloatArray, FloatArray]) -> float:
    """Median over points of the standard deviation of the logarithm of their distance."""

    def logarithm(unknowns: FloatArray) -> FloatArray:
        return np.asarray(np.log(np.linalg.norm(triangulate(*pixels, *known.devices(unknowns)).points_m, axis=1)))

    middle = logarithm(z)
    slope = np.array([(logarithm(z + _STEP * one) - middle) / _STEP for one in np.eye(len(z))])
    return float(np.nanmedian(np.sqrt(np.einsum("in,ij,jn->n", slope, left, slope))))
