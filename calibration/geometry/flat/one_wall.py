"""Pose of camera and projector before one flat wall, with lenses that rest on their data sheets.

One plane gives eight numbers, its homography, for both lenses, the relative pose and the plane: with lenses that are
known the homography falls into pose and plane (O. Faugeras and F. Lustman, Motion and structure from motion in a
piecewise planar environment, 1988), in at most two ways that put all points in front of both devices. The
plane-constrained bundle then takes both with the priors of the data sheets, so that what these leave open is in the
covariance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from calibration.arrays import FloatArray
from calibration.errors import CalibrationError
from calibration.geometry.bundle_residual import rays_of
from calibration.geometry.bundle_unknowns import (
    CAMERA,
    FOCAL_SIGMA,
    PROJECTOR,
    TRANSLATION,
    PlanarScene,
    planes_of,
    scene_of,
)
from calibration.geometry.contradictions import check_flat, is_flat
from calibration.geometry.epipolar import models_of, nominal_unknowns
from calibration.geometry.flat.bows import BowOfOne, bow_of_one_wall
from calibration.geometry.flat.parallax import FLAT_SHARE, flat_share
from calibration.geometry.known.data_sheets import check_data_sheets
from calibration.geometry.known.nominal import NominalIntrinsics
from calibration.geometry.noise import SIGMAS, covariance, observation_variance, plus_minus, standard_deviations
from calibration.geometry.pinhole import PinholeModel
from calibration.geometry.plane_bundle import BundleSolution, Rounds, adjust
from calibration.geometry.planes import Axes
from calibration.geometry.robust_fit import Priors, robust_fit

_FEW, _SOME = 4000, 3000
"""Points that tell a flat scene, and that candidates are fitted to."""
_NEARLY_FLAT = 0.8
"""Lenses far off their data sheets leave up to a tenth of a flat wall's points over a homography with distortion."""
_ITERATIONS = 200
"""Of the last fit: along a valley that only data sheets close, steps are short."""
_HELD, _HELD_ITERATIONS = 100.0, 60
"""By how much less points count while data sheets hold the lenses. The valley has several hollows: of a wall 3.0
baselines away, as deep by a thousandth, one was at 2.8 and one, with lenses far off their data sheets, at 9.7."""
_MOST_DISTANCE_SIGMA = 0.6
"""Of its logarithm. Simulated walls with a baseline of a quarter of their distance had 0.1 to 0.5, pure rotations that
lenses far off their data sheets hid had 0.8 and 1.2."""
_RANSAC_PX = 20.0
"""Before the lenses are known, distortion moves points at a wall's rim by so much."""
_IN_FRONT = 0.98
"""Share of the points: a decomposition with fewer in front of both devices is none of this scene."""
_SAME_TURN, _SAME_VALLEY = 1e-3, 1e-2
"""Of a rotation's entries: two decompositions nearer than that are one; two fits, too: in a valley steps are short."""

_HEAVY_TAILS = 2.0
"""Times what the drawn lenses show: some of them lie ten times as far off as most, and forty are few to meet these."""
_LENSES, _LENS_POINTS, _LENS_ITERATIONS = 40, 300, 60
"""Pairs of lenses that are drawn from the data sheets' spread, and what each is fitted to."""


@dataclass(frozen=True, eq=False)
class OneWall:
    """A fit to one wall, and what it rests on."""

    solution: BundleSolution
    notes: str


def fit_where_flat(
    x1: FloatArray, x2: FloatArray, nominal: NominalIntrinsics, *, weight: FloatArray, one_wall: bool
) -> OneWall | None:
    """Fit one wall if all that is seen is one, and if that may be.

    Parameters
    ----------
    x1, x2 : (N, 2)
        Corresponding pixels of camera and projector, in an order drawn by chance. [px]
    nominal : NominalIntrinsics
        Of both lenses.
    weight : (N, 2)
        By which each coordinate of the projector counts.
    one_wall : bool
        Whether one wall may be all that there is.

    Returns
    -------
    OneWall or None
        None where one plane leaves points over.

    Raises
    ------
    CalibrationError
        Without parallax; before one wall where it may not be all; where no pose explains it; where it is curved; where
        the data sheets leave its distance open.
    """
    share = flat_share(*nominal.idealised(x1[:_FEW], x2[:_FEW]), nominal)
    if share <= (_NEARLY_FLAT if one_wall else FLAT_SHARE):
        return None
    if not one_wall:
        raise CalibrationError(
            f"one plane explains {100 * share:.1f} % of the correspondences: a flat scene does not determine the "
            "lenses, nor where the other walls of a closed room stand; aim at a corner, so that at least two walls are "
            "lit and seen; or, if this wall is all that there is to light, set closed = false in [surface]"
        )
    rough = _candidates(x1[:_SOME], x2[:_SOME], nominal, weight[:_SOME])
    if share <= FLAT_SHARE and not (rough and is_flat(rough[0], x1[:_SOME])):
        return None
    if not rough:
        raise CalibrationError(
            "one plane explains the correspondences, but no pose of camera and projector puts its points in front of "
            "both with lenses as hfov_deg says; check hfov_deg, and whether a picture is mirrored"
        )
    return _fit(x1, x2, rough, weight)


def _fit(x1: FloatArray, x2: FloatArray, rough: list[BundleSolution], weight: FloatArray) -> OneWall:
    a, b = x1[:_SOME], x2[:_SOME]
    variance = min(observation_variance(fit.fit, a[fit.used], fit.fit_label, b[fit.used]) for fit in rough)
    held = Rounds(limits_px=(1.0,), iterations=_HELD_ITERATIONS, variance_px2=_HELD * variance)
    rounds = Rounds(limits_px=(1.0,), iterations=_ITERATIONS, variance_px2=variance)

    def adjusted(fit: BundleSolution, how: Rounds) -> BundleSolution:
        return adjust(x1, x2, fit, fit.error.nominal, rounds=how, weight=weight) or fit

    finished = [adjusted(start, rounds) for fit in rough for start in (fit, adjusted(fit, held))]
    # What tells two poses apart may be a bow: each is judged beside one.
    bows = {id(fit): bow_of_one_wall(fit, fit.fit, fit.error) for fit in finished}
    cost = [fit.fit.cost if (bow := bows[id(fit)]) is None else bow.cost for fit in finished]
    able = _apart(_squarest(finished, cost, variance))
    check_flat(able[0], x1)
    check_data_sheets(able[0], np.sqrt(np.diag(able[0].covariance)))
    bow = bows[id(able[0])]
    best = replace(able[0], bend=_bend(able[0]) + (0.0 if bow is None else bow.moved))
    _check_distance(best)
    return OneWall(best, _notes([best, *able[1:]], bow))


def _apart(fits: list[BundleSolution]) -> list[BundleSolution]:
    """Without those that are one of the others, as two ways into one valley end."""
    found: list[BundleSolution] = []
    for fit in fits:
        if all(_turn(fit, other) > _SAME_VALLEY for other in found):
            found.append(fit)
    return found


def _turn(one: PlanarScene, other: PlanarScene) -> float:
    return float(np.abs(one.projector.rotation - other.projector.rotation).max())


def _candidates(x1: FloatArray, x2: FloatArray, nominal: NominalIntrinsics, weight: FloatArray) -> list[BundleSolution]:
    """Fits from each pose and plane that the homography falls into, as far as they explain the points."""
    rounds = Rounds(limits_px=(_RANSAC_PX, 3.0, 1.0), iterations=20)
    fits = [adjust(x1, x2, start, nominal, rounds=rounds, weight=weight) for start in _starts(x1, x2, nominal)]
    return [fit for fit in fits if fit is not None and fit.share > FLAT_SHARE]


def _starts(x1: FloatArray, x2: FloatArray, nominal: NominalIntrinsics) -> list[PlanarScene]:
    camera, projector = models_of(nominal_unknowns(), nominal)
    ideal_1, ideal_2 = nominal.idealised(x1, x2)
    a, b = rays_of(camera, ideal_1), rays_of(projector, ideal_2)
    cv2.setRNGSeed(0)
    limit = _RANSAC_PX / projector.focal_px[0]
    homography, _ = cv2.findHomography(a[:, :2] / a[:, 2:], b[:, :2] / b[:, 2:], cv2.RANSAC, limit)
    if np.size(homography) != 9:
        return []
    _, rotations, translations, normals = cv2.decomposeHomographyMat(np.asarray(homography), np.eye(3))
    starts: list[PlanarScene] = []
    for rotation, translation, normal in zip(rotations, translations, normals, strict=True):
        t, n = np.ravel(translation).astype(np.float64), np.ravel(normal).astype(np.float64)
        length = float(np.linalg.norm(t))
        if length == 0 or not _all_in_front(a, np.asarray(rotation, dtype=np.float64), t, n):
            continue
        pose = replace(projector, rotation=np.asarray(rotation), translation_m=t / length)
        # The homography's unit of length is the plane's distance, the bundle's is the baseline.
        scene = _scene(*nominal.real((camera, pose)), length * n)
        if all(_turn(scene, other) > _SAME_TURN for other in starts):
            starts.append(scene)
    return starts


def _scene(camera: PinholeModel, projector: PinholeModel, plane: FloatArray) -> PlanarScene:
    return PlanarScene(camera=camera, projector=projector, planes=plane[None], axes=Axes(np.eye(3), np.array([-1])))


def _all_in_front(rays: FloatArray, rotation: FloatArray, t: FloatArray, normal: FloatArray) -> bool:
    along = rays @ normal
    depth = rays @ rotation[2] + t[2] * along
    return bool(((along > 0) & (depth > 0)).mean() > _IN_FRONT)


def _squarest(fits: list[BundleSolution], cost: list[float], variance_px2: float) -> list[BundleSolution]:
    """Those that the points and data sheets allow, the wall that both devices look at most squarely first."""
    able = [fit for fit, own in zip(fits, cost, strict=True) if own - min(cost) <= SIGMAS**2 * variance_px2]
    return sorted(able, key=lambda fit: sum(_tilts_deg(fit)))


def _bend(solution: BundleSolution) -> FloatArray:
    """(n, n) mean square of what the unknowns move by beyond their tangent, over lenses that the data sheets allow.

    The projector's lens shift moves pose and plane far along a bent valley, whose tangent tells too little: for each
    pair of lenses that is drawn, the fit is made again with these expected, and held against the tangent's word.
    """
    priors, error = solution.fit.priors, solution.error
    thinned = error.of_points(slice(0, _LENS_POINTS))
    known = replace(priors, weight=priors.weight * len(thinned.x1) / len(error.x1))

    def fitted(start: FloatArray, about: Priors) -> FloatArray:
        fit = robust_fit(thinned, start, about, iterations=_LENS_ITERATIONS, least_scale_px=solution.fit.least_scale_px)
        return _unit_baseline(fit.z)

    middle = fitted(solution.fit.z, known)
    there = replace(solution.fit, z=middle, function=thinned, residual=thinned(middle), priors=known)
    follows = known.weight * covariance(there, 1.0) @ known.precision
    random = np.random.default_rng(2)
    bends = []
    for _ in range(_LENSES):
        drawn = known.spread @ random.normal(size=len(middle))
        tangent = middle + follows @ drawn
        beyond = fitted(tangent, replace(known, expected=known.expected + drawn)) - tangent
        # Lens terms are held by their data sheets: no bend makes them less certain than these.
        beyond[: PROJECTOR.stop] = 0.0
        bends.append(beyond)
    return np.asarray(_HEAVY_TAILS**2 / _LENSES * np.array(bends).T @ np.array(bends))


def _unit_baseline(z: FloatArray) -> FloatArray:
    """The same unknowns, of a translation of length 1: its length changes nothing."""
    z = z.copy()
    z[TRANSLATION] /= np.linalg.norm(z[TRANSLATION])
    return z


def _tilts_deg(scene: PlanarScene) -> tuple[float, float]:
    """Angles between the wall's normal and the axes of camera and projector."""
    normal = scene.planes[0] / np.linalg.norm(scene.planes[0])
    cosines = [float(normal @ device.rotation[2]) for device in scene.devices]
    first, second = (float(np.degrees(np.arccos(np.clip(c, -1, 1)))) for c in cosines)
    return first, second


def _figures(fit: BundleSolution) -> tuple[FloatArray, FloatArray]:
    """Logarithm of the wall's distance in baselines, its tilts to both devices in degrees; and their sigmas."""

    def figures(z: FloatArray) -> FloatArray:
        distance = -np.log(np.linalg.norm(planes_of(z, fit.start_axes)[0]))
        return np.array([distance, *_tilts_deg(scene_of(z, fit.start_axes, fit.error.nominal))])

    return figures(fit.fit.z), standard_deviations(figures, fit.fit.z, fit.covariance)


def _check_distance(fit: BundleSolution) -> None:
    values, sigma = _figures(fit)
    if sigma[0] > _MOST_DISTANCE_SIGMA:
        raise CalibrationError(
            f"the wall is {np.exp(values[0]):.1f} baselines away "
            f"{plus_minus(100 * sigma[0], '%', most=100, decimals=0)}, the limit is "
            f"{100 * _MOST_DISTANCE_SIGMA:.0f} %: what the lenses may be off their data sheets explains the parallax, "
            "and the baseline may be zero. Move the camera aside by 0.3 m or more, or aim at a corner"
        )


def _notes(fits: list[BundleSolution], bow: BowOfOne | None) -> str:
    fit = fits[0]
    values, sigma = _figures(fit)
    focal = 100 * np.sqrt(np.diag(fit.covariance))[[CAMERA.start, PROJECTOR.start]]
    said = (
        f"One flat wall: the lenses rest on hfov_deg, taken to be true to {100 * FOCAL_SIGMA:g} % (focal lengths +- "
        f"{focal[0]:.1f} and {focal[1]:.1f} %), and the pose on them: the wall is {np.exp(values[0]):.2f} baselines "
        f"away +- {100 * sigma[0]:.0f} %, and turned from the camera's axis by {values[1]:.1f} +- {sigma[1]:.1f} "
        "degrees."
    )
    if len(fits) > 1:
        other = _tilts_deg(fits[1])
        said += (
            f" The same points allow a wall turned by {other[0]:.0f} degrees from the camera's axis and "
            f"{other[1]:.0f} from the projector's; taken is the one that both look at more squarely "
            f"({values[1]:.0f} and {values[2]:.0f})."
        )
    if bow is not None and bow.is_likely:
        said += (
            f" The wall is not quite flat: it bows, by {100 * bow.share:.2f} % of its extent rms or more. Where the "
            "devices stand, and the lenses, may be further off than these sigmas: a bow looks like another pose. Lens "
            "files of both devices (rig lenses) tell them apart."
        )
    return said
