"""The unknowns of the plane-constrained bundle adjustment: both lenses, the relative pose and the walls, as one vector.

Lens terms are shares of what the data sheet says, so all unknowns are of order 1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from calibration.arrays import BoolArray, FloatArray
from calibration.geometry.known.nominal import NominalIntrinsics
from calibration.geometry.pinhole import PinholeModel, rotation_of, rotation_slopes, vector_of
from calibration.geometry.planes import Axes
from calibration.geometry.robust_fit import Priors

LENS_TERMS = ("f", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
"""Focal length and principal point as shares of nominal, width and height; distortion in OpenCV's order."""
FOCAL_SIGMA = 0.05
"""Standard deviation of a focal length that follows from a data sheet's field of view, as a share of it."""
_N = len(LENS_TERMS)
CAMERA, PROJECTOR = slice(0, _N), slice(_N, 2 * _N)
ROTATION, TRANSLATION = slice(2 * _N, 2 * _N + 3), slice(2 * _N + 3, 2 * _N + 6)
TURN = slice(2 * _N + 6, 2 * _N + 9)
PLANES = 2 * _N + 9
"""Where the planes begin: one unknown of a plane that is exactly across an axis, three of any other."""
_EXPECTED = (1.0, 0.5, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0)
_CAMERA_CENTRE, _PROJECTOR_CENTRE = (0.03, 0.03), (0.10, 0.40)
"""What mounting leaves open; the projector's lens may be shifted upwards."""
_CORNER_SHIFTS = (0.08, 0.05, 0.005, 0.005, 0.03)
"""By which share of their distance from the middle each term moves the picture's corners, one standard deviation."""


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

    def with_planes(self, planes: FloatArray, axes: Axes | None = None) -> PlanarScene:
        """Return the same devices before other planes, which are free unless axes are given."""
        free = Axes(np.eye(3), np.full(len(planes), -1)) if axes is None else axes
        return PlanarScene(camera=self.camera, projector=self.projector, planes=planes, axes=free)

    def with_some_planes(self, stays: BoolArray) -> PlanarScene:
        """Return the same devices before some of the planes, (K,), which are held as they were."""
        return self.with_planes(self.planes[stays], replace(self.axes, of_plane=self.axes.of_plane[stays]))


def unknowns_of(scene: PlanarScene, nominal: NominalIntrinsics) -> FloatArray:
    """(n,) unknowns of a scene."""

    def lens(model: PinholeModel, focal_px: float) -> list[float]:
        x, y = model.principal_point_px
        return [model.focal_px[0] / focal_px, x / model.width_px, y / model.height_px, *model.distortion]

    offsets = [
        plane.tolist() if free else [float(plane @ scene.axes.directions[axis])]
        for plane, axis, free in zip(scene.planes, scene.axes.of_plane, scene.axes.turns_freely, strict=True)
    ]
    lenses = [lens(scene.camera, nominal.camera_focal_px), lens(scene.projector, nominal.projector_focal_px)]
    pose = [vector_of(scene.projector.rotation), scene.projector.translation_m]
    return np.concatenate([*lenses, *pose, np.zeros(3), *offsets])


def scene_of(z: FloatArray, axes: Axes, nominal: NominalIntrinsics) -> PlanarScene:
    """Scene of a vector of unknowns, which turns the axes that are given."""
    camera, projector = devices_of(z, nominal)
    turned = replace(axes, directions=_directions(z, axes))
    return PlanarScene(camera=camera, projector=projector, planes=planes_of(z, axes), axes=turned)


def devices_of(z: FloatArray, nominal: NominalIntrinsics) -> tuple[PinholeModel, PinholeModel]:
    """Camera and projector of a vector of unknowns; the baseline is 1."""
    translation = np.asarray(z[TRANSLATION] / np.linalg.norm(z[TRANSLATION]))
    first, second = aspects_of(nominal)
    focal_px = nominal.camera_focal_px, first * nominal.camera_focal_px
    camera = _lens_model(z[CAMERA], focal_px, nominal.camera_shape, (np.eye(3), np.zeros(3)))
    focal_px = nominal.projector_focal_px, second * nominal.projector_focal_px
    pose = rotation_of(z[ROTATION]), translation
    return camera, _lens_model(z[PROJECTOR], focal_px, nominal.projector_shape, pose)


def aspects_of(nominal: NominalIntrinsics) -> tuple[float, float]:
    """Focal length in y over that in x, of camera and projector: 1 where no boards have measured it."""
    first, second = (1.0 if lens is None else lens.aspect for lens in nominal.known.both)
    return first, second


def _lens_model(
    z: FloatArray, focal_px: tuple[float, float], shape: tuple[int, int], pose: tuple[FloatArray, FloatArray]
) -> PinholeModel:
    height_px, width_px = shape
    fx, fy = (float(z[0] * one) for one in focal_px)
    k1, k2, p1, p2, k3 = (float(v) for v in z[3:])
    return PinholeModel(
        width_px=width_px,
        height_px=height_px,
        focal_px=(fx, fy),
        principal_point_px=(float(z[1] * width_px), float(z[2] * height_px)),
        distortion=(k1, k2, p1, p2, k3),
        rotation=pose[0],
        translation_m=pose[1],
    )


def _directions(z: FloatArray, axes: Axes) -> FloatArray:
    return np.asarray(axes.directions @ rotation_of(z[TURN]).T)


def planes_of(z: FloatArray, axes: Axes) -> FloatArray:
    """(K, 3) planes of a vector of unknowns, as normal / offset."""
    directions = _directions(z, axes)
    planes = np.empty((len(axes.of_plane), 3))
    for k, (at, free) in enumerate(zip(_places(axes), axes.turns_freely, strict=True)):
        planes[k] = z[at] if free else z[at] * directions[axes.of_plane[k]]
    return planes


def turn_slopes_of(z: FloatArray, axes: Axes) -> FloatArray:
    """(3, K, 3) derivative of the planes by the turn of their axes; that of planes which turn freely is 0."""
    turned = axes.directions @ rotation_slopes(z[TURN]).transpose(0, 2, 1)
    slopes = np.zeros((3, len(axes.of_plane), 3))
    for k, (at, free) in enumerate(zip(_places(axes), axes.turns_freely, strict=True)):
        if not free:
            slopes[:, k] = z[at] * turned[:, axes.of_plane[k]]
    return slopes


def own_slopes_of(z: FloatArray, axes: Axes) -> list[tuple[slice, FloatArray]]:
    """Of each plane its unknowns among all, and the (m, 3) derivative of the plane by these m."""
    directions = _directions(z, axes)
    own = [np.eye(3) if free else directions[[k]] for k, free in zip(axes.of_plane, axes.turns_freely, strict=True)]
    return list(zip(_places(axes), own, strict=True))


@lru_cache(maxsize=8)
def _places(axes: Axes) -> tuple[slice, ...]:
    """Of each plane's unknowns among all; a fit asks for them of the same axes hundreds of times."""
    ends = PLANES + np.cumsum(np.where(axes.turns_freely, 3, 1))
    return tuple(slice(int(a), int(b)) for a, b in zip((PLANES, *ends), ends, strict=False))


def priors_of(scene: PlanarScene, nominal: NominalIntrinsics, variance_px2: float) -> Priors:
    """What is known of the unknowns near a scene, against points of a variance [px²] that are independent.

    Of lenses that boards measured, all of their covariance; of others what data sheets and mounting say. Of walls how
    far from square they may stand.
    """
    return _priors(scene, *expected_lenses(nominal), variance_px2)


def _priors(scene: PlanarScene, expected: FloatArray, covariance: FloatArray, variance_px2: float) -> Priors:
    """Of lenses what is expected, (16,) with its covariance; of walls how far from square they may stand."""
    precision = _known_of_tilts(scene)
    lenses = slice(CAMERA.start, PROJECTOR.stop)
    precision[lenses, lenses] = np.linalg.inv(covariance)
    return Priors(np.append(expected, np.zeros(len(precision) - lenses.stop)), precision, variance_px2)


def _known_of_tilts(scene: PlanarScene) -> FloatArray:
    """(n, n) precision of the unknowns, that tilts are 0 by a standard deviation; zeros where walls are exactly square.

    The tilt of a plane p against an axis e that it lies along is p . e / |p|. Near the scene it is straight in the
    plane, and in the turn w of the axes, by which e becomes e + w x e.
    """
    axes, places = scene.axes, _places(scene.axes)
    n = places[-1].stop if places else PLANES
    slopes = [np.zeros(n)]
    for plane, axis, at in zip(scene.planes, axes.of_plane, places, strict=True):
        if axis < 0 or axes.askew_rad <= 0:
            continue
        for along in np.delete(axes.directions, axis, axis=0):
            slope = np.zeros(n)
            slope[at] = along / np.linalg.norm(plane)
            slope[TURN] = np.cross(along, plane) / np.linalg.norm(plane)
            slopes.append(slope / axes.askew_rad)
    return np.asarray(np.transpose(slopes) @ slopes)


def expected_lenses(nominal: NominalIntrinsics) -> tuple[FloatArray, FloatArray]:
    """(16,) lens unknowns of both devices as they are expected, and (16, 16) covariance."""
    units, known = lens_units(nominal), nominal.known
    covariance = known.covariance() / np.outer(units, units)
    expected = np.tile(_EXPECTED, 2)
    for lens, terms, sigma in zip(known.both, (CAMERA, PROJECTOR), _sheet_sigmas(nominal), strict=True):
        if lens is None:
            covariance[terms, terms] = np.diag(np.square(sigma))
        else:
            expected[terms] = lens.brown.values / units[terms]
    return expected, covariance


def _sheet_sigmas(nominal: NominalIntrinsics) -> tuple[list[float], list[float]]:
    """Standard deviations of both lenses' terms by data sheets and mounting."""
    return (
        _lens_sigma(nominal.camera_focal_px, nominal.camera_shape, _CAMERA_CENTRE),
        _lens_sigma(nominal.projector_focal_px, nominal.projector_shape, _PROJECTOR_CENTRE),
    )


def wide_priors(scene: PlanarScene, nominal: NominalIntrinsics, variance_px2: float) -> Priors:
    """Priors about the lenses that are expected, which are known no better than by data sheets."""
    sigma = np.concatenate(_sheet_sigmas(nominal))
    return _priors(scene, expected_lenses(nominal)[0], np.diag(sigma**2), variance_px2)


def _lens_sigma(focal_px: float, shape: tuple[int, int], centre: tuple[float, float]) -> list[float]:
    corner = 0.5 * float(np.hypot(*shape)) / focal_px
    """Slope of the ray through a corner: a term's effect there is what lens makers keep small."""
    powers = (2, 4, 1, 1, 6)
    terms = [shift / corner**power for shift, power in zip(_CORNER_SHIFTS, powers, strict=True)]
    return [FOCAL_SIGMA, *centre, *terms]


def lens_units(nominal: NominalIntrinsics) -> FloatArray:
    """(2 * terms,) what one of each lens unknown is, in pixels or 1."""
    (h1, w1), (h2, w2) = nominal.camera_shape, nominal.projector_shape
    ones = [1.0] * (_N - 3)
    return np.array([nominal.camera_focal_px, w1, h1, *ones, nominal.projector_focal_px, w2, h2, *ones])


def lens_sigmas(covariance: FloatArray, nominal: NominalIntrinsics) -> dict[str, float]:
    """Return the standard deviations of both lenses' terms, in pixels or 1, by name, of the unknowns' covariance."""
    names = [f"{device}_{term}" for device in ("camera", "projector") for term in LENS_TERMS]
    deviations = np.sqrt(np.diag(covariance))[: len(names)] * lens_units(nominal)
    return {name: float(deviation) for name, deviation in zip(names, deviations, strict=True)}
