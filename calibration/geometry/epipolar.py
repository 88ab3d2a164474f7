"""Relative pose of a camera and a projector, and their lenses as far as two views tell; no scene model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial

import cv2
import numpy as np

from calibration.arrays import FloatArray
from calibration.geometry.known.nominal import NominalIntrinsics
from calibration.geometry.pinhole import (
    PinholeModel,
    bearings,
    direction_slopes,
    lens_slope_units,
    lens_slopes,
    rotation_of,
    rotation_slopes,
    vector_of,
    world_rays,
)
from calibration.geometry.robust_fit import Fit, Priors, robust_fit
from calibration.geometry.triangulation import triangulate

UNDISTORTIONS = 8
"""Of a triangulation while a fit goes on: what is left is far below its residual."""
COLUMN_SHARES = (0.5, 0.6, 0.4)
"""Where the projector's principal point may be, as shares of the width: rarely off the middle."""
_ROW_SHARES = (0.5, 0.75, 1.0, 0.25)
"""Where the projector's principal point may be, as shares of width and height: lens shift is mostly vertical."""
FIT_POINTS = 1000
"""Of a start: its fit takes a second, and more points move it by less than the next stage does."""
_RANSAC_PX = 5
"""Inlier limit before the lenses are known: distortion moves points by some pixels."""
_IN_FRONT = 0.98
"""Share of the points: a start with fewer in front of both devices is a mirrored one."""
_SAME_POSE = 0.01
"""Of a rotation's entries and of the baseline: starts nearer to each other end in one fit."""


# Unknowns: camera f / nominal, k1, k2; projector f / nominal, k1, k2, centre as shares of width and height;
# rotation, translation.
EXPECTED = np.array([1, 0, 0, 1, 0, 0, 0.5, 0.5, 0, 0, 0, 0, 0, 0.0])
SIGMA = np.array([0.05, 0.05, 0.02, 0.05, 0.05, 0.02, 0.06, 0.3, *[np.inf] * 6])
_START_SIGMA = (0.03, 0.12)
_KNOWN_SHARE = 0.02
"""Of a data sheet's spread: what is left of it when boards have measured a lens, a per mille of its focal length."""
POSE = 8
_CAMERA, _PROJECTOR = [0, 3, 4], [0, 3, 4, 1, 2]
"""Of all terms of a lens those that are unknown here, in this order."""
_Start = Callable[[FloatArray, FloatArray, NominalIntrinsics, tuple[float, float]], FloatArray | None]


def models_of(q: FloatArray, nominal: NominalIntrinsics) -> tuple[PinholeModel, PinholeModel]:
    """Camera and projector of a vector of unknowns; baseline 1."""
    (h1, w1), (h2, w2) = nominal.camera_shape, nominal.projector_shape
    f1, f2 = float(q[0] * nominal.camera_focal_px), float(q[3] * nominal.projector_focal_px)
    k_camera, k_projector = ((float(a), float(b), 0.0, 0.0, 0.0) for a, b in (q[1:3], q[4:6]))
    centre, shifted = ((w1 - 1) / 2, (h1 - 1) / 2), (float(q[6] * w2), float(q[7] * h2))
    camera = PinholeModel(
        width_px=w1,
        height_px=h1,
        focal_px=(f1, f1),
        principal_point_px=centre,
        distortion=k_camera,
        rotation=np.eye(3),
        translation_m=np.zeros(3),
    )
    projector = PinholeModel(
        width_px=w2,
        height_px=h2,
        focal_px=(f2, f2),
        principal_point_px=shifted,
        distortion=k_projector,
        rotation=rotation_of(q[8:11]),
        translation_m=np.asarray(q[11:14] / np.linalg.norm(q[11:14])),
    )
    return camera, projector


def fit_epipolar(
    x1: FloatArray,
    x2: FloatArray,
    nominal: NominalIntrinsics,
    column_share: float,
    *,
    ahead: bool = False,
    bent: bool = False,
) -> list[tuple[PinholeModel, PinholeModel]]:
    """List candidates for both devices, the best first; each from another vertical lens shift to start at.

    They start at the pose of the essential matrix, or with one device `ahead` of the other: then all epipolar lines
    meet inside of the pictures, where distortion bends them, and the linear fit of the matrix ends anywhere.

    The fit is held by the data sheets: with optical axes that nearly meet, two views do not determine the
    focal lengths; the planes of the next stage come out as planes even so. A `bent` long lens may leave them further.

    Empty where no relative pose fits.
    """
    few = slice(0, FIT_POINTS)
    rows = _ROW_SHARES if nominal.known.projector is None else _ROW_SHARES[:1]
    starts = [(column_share, row_share) for row_share in rows]
    begin = _ahead_start if ahead else _essential_start
    near = partial(_fit_near, x1[few], x2[few], nominal, begin=begin, spread=spread_of(nominal, bent=bent))
    fits = [fit for shares in starts if (fit := near(shares)) is not None]
    return _distinct(fits, x1[few], x2[few], nominal) if fits else []


def _fit_near(
    x1: FloatArray,
    x2: FloatArray,
    nominal: NominalIntrinsics,
    shares: tuple[float, float],
    *,
    begin: _Start,
    spread: FloatArray,
) -> Fit | None:
    """Fit with the projector's principal point held near a start.

    The epipolar lines hardly tell it from a rotation, but with a wrong one points come to lie behind the devices.
    """
    start = begin(x1, x2, nominal, shares)
    if start is None:
        return None
    expected, sigma = EXPECTED.copy(), SIGMA.copy()
    expected[6:8], sigma[6:8] = shares, _START_SIGMA
    sigma *= spread
    return robust_fit(
        SampsonError(x1, x2, nominal), start, priors_about(expected, sigma, len(x1)), iterations=20, least_scale_px=0.3
    )


def spread_of(nominal: NominalIntrinsics, *, bent: bool = False) -> FloatArray:
    """(n,) by which the data sheets' standard deviations are multiplied, in idealised pixels.

    Bent: so that a long lens may distort its corners by as large a share of its picture as a wide one.
    """
    share = np.ones(len(EXPECTED))
    for lens, terms in zip(nominal.known.both, (slice(0, 3), slice(3, POSE)), strict=True):
        share[terms] = 1.0 if lens is None else _KNOWN_SHARE
    if bent:
        focal_px = np.array([nominal.camera_focal_px, nominal.projector_focal_px])
        corner = np.hypot(*np.transpose([nominal.camera_shape, nominal.projector_shape])) / 2 / focal_px
        share[[1, 2, 4, 5]] *= np.maximum(1.0, np.stack([corner**-2, corner**-4], axis=-1).ravel())
    return share


def _distinct(
    fits: list[Fit], x1: FloatArray, x2: FloatArray, nominal: NominalIntrinsics
) -> list[tuple[PinholeModel, PinholeModel]]:
    """Solutions that differ, those with nearly all points in front first, then the likeliest."""
    priors = priors_about(EXPECTED, SIGMA * spread_of(nominal), len(x1))
    limit = max(1.0, 2 * min(_median(fit) for fit in fits))
    found: list[tuple[tuple[PinholeModel, PinholeModel], float]] = []
    for fit in sorted(fits, key=lambda fit: _merit(fit, priors)):
        devices, share = _in_front(*models_of(fit.z, nominal), x1, x2)
        if _median(fit) <= limit and not any(_same_pose(devices[1], other[1]) for other, _ in found):
            found.append((devices, share))
    return [devices for devices, _ in sorted(found, key=lambda entry: entry[1] < _IN_FRONT)]


def _median(fit: Fit) -> float:
    return float(np.median(np.abs(fit.residual)))


def _in_front(
    camera: PinholeModel, projector: PinholeModel, x1: FloatArray, x2: FloatArray
) -> tuple[tuple[PinholeModel, PinholeModel], float]:
    """Choose the translation's sign with most points in front (distances do not change); their share."""
    other = replace(projector, translation_m=-projector.translation_m)
    seen = [
        triangulate(x1, x2, camera, p, on_camera_rays=True, undistortions=UNDISTORTIONS) for p in (projector, other)
    ]
    shares = [float(points.in_front.mean()) for points in seen]
    return (camera, projector if shares[0] >= shares[1] else other), max(shares)


def _same_pose(a: PinholeModel, b: PinholeModel) -> bool:
    turn = np.abs(a.rotation - b.rotation).max()
    return bool(turn < _SAME_POSE and np.abs(a.position_m - b.position_m).max() < _SAME_POSE)


def priors_about(expected: FloatArray, sigma: FloatArray, n: int) -> Priors:
    """Return what is expected of unknowns, weighed against `n` points."""
    # One standard deviation off the data sheet must be worth 0.1 px over all points.
    return Priors.independent(expected, sigma, n * 0.1**2)


def _merit(fit: Fit, priors: Priors) -> float:
    squares = np.minimum((fit.residual**2).sum(axis=1), 4.0)
    return float(squares.sum() + priors.cost(fit.z))


def _essential_start(
    x1: FloatArray, x2: FloatArray, nominal: NominalIntrinsics, shares: tuple[float, float]
) -> FloatArray | None:
    q = EXPECTED.copy()
    q[6:8], q[11] = shares, 1
    camera, projector = models_of(q, nominal)
    a, b = ((x - m.principal_point_px) / m.focal_px[0] for x, m in ((x1, camera), (x2, projector)))
    cv2.setRNGSeed(0)
    limit = _RANSAC_PX / nominal.camera_focal_px
    essential, _ = cv2.findEssentialMat(a, b, np.eye(3), method=cv2.RANSAC, prob=0.99, threshold=limit, maxIters=200)
    if essential is None or essential.shape[0] < 3:
        return None
    _, rotation, translation, _ = cv2.recoverPose(essential[:3], a, b, np.eye(3))
    return np.concatenate([q[:POSE], vector_of(np.asarray(rotation, dtype=np.float64)), np.ravel(translation)])


def _ahead_start(x1: FloatArray, x2: FloatArray, nominal: NominalIntrinsics, shares: tuple[float, float]) -> FloatArray:
    """One device before the other, turned as the rays say that hardly change."""
    q = EXPECTED.copy()
    q[6:8], q[-1] = shares, 1
    q[POSE : POSE + 3] = turn_between(x1, x2, *models_of(q, nominal))
    return q


def turn_between(x1: FloatArray, x2: FloatArray, camera: PinholeModel, projector: PinholeModel) -> FloatArray:
    """(3,) Rodrigues vector that turns the camera's rays nearest to those of a projector that is not turned yet."""
    u, _, vt = np.linalg.svd(world_rays(projector, x2).T @ world_rays(camera, x1))
    return vector_of(u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt)


@dataclass(frozen=True, eq=False)
class SampsonError:
    """Sampson distances (N, 1) in px, a function of the unknowns, with its derivative."""

    x1: FloatArray
    x2: FloatArray
    nominal: NominalIntrinsics

    def __call__(self, q: FloatArray) -> FloatArray:
        """(N, 1) distances. [px]."""
        return self._lines(q).distances[:, None]

    def jacobian(self, q: FloatArray) -> FloatArray:
        """(n, N, 1) derivative of the distances by each unknown."""
        lines = self._lines(q)
        result = np.empty((len(q), len(self.x1)))
        for side, x, rows, at in ((lines.of_camera, self.x1, _CAMERA, 0), (lines.of_projector, self.x2, _PROJECTOR, 3)):
            slopes = lens_slopes(side.device, x, side.rays, lens_slope_units(side.device, q[at]))[rows]
            result[at : at + len(rows)] = (slopes * lines.by_ray(side)).sum(-1)
            result[at] += lines.by_focal(side) / q[at]
        by_pose = _essential_slopes(q, lines.of_projector.device)
        result[POSE:] = by_pose.reshape(len(by_pose), -1) @ lines.by_essential().reshape(len(self.x1), -1).T
        return result[:, :, None]

    def _lines(self, q: FloatArray) -> _EpipolarLines:
        camera, projector = models_of(q, self.nominal)
        a, b = (
            bearings(x, one.focal_px[0], one.principal_point_px, one.distortion)
            for x, one in ((self.x1, camera), (self.x2, projector))
        )
        essential = _crossed(projector.translation_m) @ projector.rotation
        return _EpipolarLines(
            _Side(camera, a, b @ essential, essential.T), _Side(projector, b, a @ essential.T, essential)
        )


@dataclass(frozen=True, eq=False)
class _Side:
    """One device of two."""

    device: PinholeModel
    rays: FloatArray
    """(N, 3) of its pixels, with 1 at the end."""
    lines: FloatArray
    """(N, 3) epipolar lines in its picture, of the other device's rays."""
    essential: FloatArray
    """(3, 3) which makes these of the other's rays."""

    @cached_property
    def slopes(self) -> FloatArray:
        """(N, 3) of its lines in 1 / px², as they count in the squared distance; nothing at the end."""
        return np.asarray(self.lines * np.array([1.0, 1.0, 0.0]) / self.device.focal_px[0] ** 2)

    @cached_property
    def steepness(self) -> FloatArray:
        """(N,) squared slope of the lines. [1 / px²]."""
        return np.asarray((self.slopes * self.lines).sum(1))


@dataclass(frozen=True, eq=False)
class _EpipolarLines:
    """What Sampson distances, b . E a / |slope|, and their derivatives are made of."""

    of_camera: _Side
    of_projector: _Side

    @cached_property
    def _algebraic(self) -> FloatArray:
        return np.asarray((self.of_projector.rays * self.of_projector.lines).sum(1))

    @cached_property
    def _per_slope(self) -> FloatArray:
        return np.asarray(1 / np.sqrt(np.maximum(self.of_camera.steepness + self.of_projector.steepness, 1e-18)))

    @cached_property
    def _by_steepness(self) -> FloatArray:
        """(N,) derivative by half of the squared slope."""
        return np.asarray(-self._algebraic * self._per_slope**3)

    @property
    def distances(self) -> FloatArray:
        """(N,) [px]."""
        return np.asarray(self._algebraic * self._per_slope)

    def by_ray(self, side: _Side) -> FloatArray:
        """(N, 2) derivative of the distances by one side's rays, which move the lines in the other's picture."""
        other = self.of_camera if side is self.of_projector else self.of_projector
        moved = (other.slopes @ other.essential)[:, :2]
        return np.asarray(self._per_slope[:, None] * side.lines[:, :2] + self._by_steepness[:, None] * moved)

    def by_focal(self, side: _Side) -> FloatArray:
        """(N,) derivative by a share of one side's focal length, but for its rays."""
        return np.asarray(-self._by_steepness * side.steepness)

    def by_essential(self) -> FloatArray:
        """(N, 3, 3) derivative by the essential matrix."""
        a, b = self.of_camera, self.of_projector
        by_row = self._per_slope[:, None] * b.rays + self._by_steepness[:, None] * b.slopes
        by_column = self._by_steepness[:, None] * a.slopes
        return np.asarray(by_row[:, :, None] * a.rays[:, None, :] + b.rays[:, :, None] * by_column[:, None, :])


def _essential_slopes(q: FloatArray, projector: PinholeModel) -> FloatArray:
    """(6, 3, 3) derivative of the essential matrix by rotation and translation."""
    by_turn = _crossed(projector.translation_m) @ rotation_slopes(q[POSE : POSE + 3])
    by_shift = [_crossed(one) @ projector.rotation for one in direction_slopes(q[POSE + 3 :])]
    return np.concatenate([by_turn, by_shift])


def _crossed(t: FloatArray) -> FloatArray:
    """(3, 3) that makes the cross product with a vector."""
    return np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]])


def nominal_unknowns() -> FloatArray:
    """Unknowns of lenses as the data sheets say, of a projector one baseline ahead that is not turned."""
    return np.append(EXPECTED[:-1], 1.0)
