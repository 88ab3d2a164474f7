"""What a fit is held against: flat surfaces, right angles, data sheets. A contradiction is refused, and named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from calibration.arrays import FloatArray
from calibration.errors import CalibrationError
from calibration.geometry.bundle_unknowns import CAMERA, FOCAL_SIGMA, PROJECTOR, PlanarScene, planes_of
from calibration.geometry.flat.endless import check_walls_end
from calibration.geometry.flat.left_out import MOST_LEFT_OUT, check_none_left_out
from calibration.geometry.known.nominal import NominalIntrinsics
from calibration.geometry.noise import covariance, observation_variance, plus_minus, standard_deviations
from calibration.geometry.plane_bundle import MARGIN_SHARE, BundleSolution, Rounds, adjust, adjust_to_held_planes, refit
from calibration.geometry.planes import USUAL_ASKEW_DEG, Axes
from calibration.geometry.support import (
    bends_of,
    bows_to_the_edges_px,
    exclusive_points,
    mixed_share,
    plane_errors_px,
)

SIGMAS = 4.0
"""A contradiction: by chance one in 16,000."""
MOST_MIXED = 0.15
"""Of the points: along the edges of a room 1 to 3 % have neighbours on another wall."""
MOST_BEND_PX, MOST_BEND_NOISES = 0.04, 0.95
"""Flat walls of ninety simulated rooms bend by up to 0.84 of their noise, cylinders and domes by 1.1 to 1.9 of it."""
MOST_BOW_PX, MOST_BOW_NOISES = 0.05, 0.6
"""Flat walls of eighteen simulated sessions bow by up to 0.033 px, the facets that stand for a cylinder by 0.06 to 0.12
px and 0.7 to 0.9 of their noise. With an 8-bit camera's noise a bend alone tells them by nothing."""
MOST_BOW_TO_EDGES_PX, MOST_BOW_TO_EDGES_NOISES = 0.15, 2.0
"""With the points near edges, where blur mixes walls, 70 planes of 21 sessions of small random rigs bow by up to 0.07
px, two of a first fit in one of them by 0.12 and 0.13 px (1.8 noises); facets for two cylinders of 5 and 6 m by 0.21 px
(3 to 5 noises)."""
_SOME = 3000
"""Points that the fit without right angles is of."""
_TELLING = 2.0
"""Sigmas from a right angle at which an angle is worth telling."""
MOST_DISTANCE_SIGMA = 0.1
"""Of the walls' distance, in baselines: a room of which a tenth is not known is none."""


class NotFlat(CalibrationError):
    """The points of a plane leave it together."""

    def __init__(self, message: str, plane: int) -> None:
        super().__init__(message)
        self.plane = plane
        """Its number in the fit."""


def hold_against_all(
    x1: FloatArray,
    x2: FloatArray,
    bundle: PlanarScene,
    nominal: NominalIntrinsics,
    *,
    weight: FloatArray,
    margin_share: float = MARGIN_SHARE,
) -> BundleSolution:
    """Fit to all points, and refuse what contradicts itself, a fit without right angles, or the data sheets.

    Parameters
    ----------
    x1, x2 : (N, 2)
        Corresponding pixels in an order drawn by chance. [px]
    bundle : PlanarScene
        Where the fit begins.
    nominal : NominalIntrinsics
        Of both lenses.
    weight : (N, 2)
        By which each coordinate of the projector counts.
    margin_share : float
        Of the projector's width: points that a second plane predicts within it are not used.

    Returns
    -------
    BundleSolution

    Raises
    ------
    CalibrationError
        With the contradiction, its numbers and what to try.
    """
    rounds = Rounds(limits_px=(1.0,), iterations=8, margin_share=margin_share)
    rough = adjust_to_held_planes(x1, x2, bundle, nominal, rounds=rounds, weight=weight)
    check_one_surface(rough, x1, x2)
    check_walls_end(rough, x1)
    bows = rough.found_bows()
    x2 = x2 if bows is None else bows.straightened(x1, x2)
    a, b = x1[:_SOME], x2[:_SOME]
    rounds = Rounds(limits_px=(2.0, 1.0), iterations=10, margin_share=margin_share)
    free = adjust(a, b, rough.with_planes(rough.planes), nominal, rounds=rounds, weight=weight[:_SOME])
    check_flat(free or rough, a if free else x1)
    check_no_facets(free or rough, *((a, b) if free else (x1, x2)))
    angle_sigmas = None if free is None else _check_angles(rough, free)
    if bows is None:
        variance = observation_variance(rough.fit, rough.error.x1, rough.fit_label, rough.error.x2)
    else:
        variance = bows.variance_px2
    rounds = Rounds(limits_px=(1.0,), iterations=10, variance_px2=variance, margin_share=margin_share)
    fit = adjust_to_held_planes(x1, x2, rough, nominal, rounds=rounds, weight=weight)
    final = replace(fit, right_angle_sigmas=angle_sigmas, bows=bows)
    check_data_sheets(final, np.sqrt(np.diag(final.covariance)))
    check_determined(final, final.covariance)
    check_none_left_out(final, x1, x2)
    return final


def _check_angles(rough: BundleSolution, free: BundleSolution) -> float | None:
    """Hold right angles, as far as the fit has any, against a fit of the same points that has none; in sigmas."""
    if (rough.axes.of_plane < 0).all():
        return None
    variance = observation_variance(free.fit, free.error.x1, free.fit_label)
    held = refit(replace(free.error, axes=rough.axes), rough, variance)
    return check_right_angles(held, refit(free.error, held.with_planes(held.planes), variance))


def check_one_surface(solution: BundleSolution, x1: FloatArray, x2: FloatArray) -> None:
    """Refuse points of different planes that lie among each other in the picture.

    Raises
    ------
    CalibrationError
        If more than 15 % of the points lie among those of another plane.
    """
    mixed = mixed_share(x1, exclusive_points(plane_errors_px(solution, x1, x2)))
    if mixed > MOST_MIXED:
        raise CalibrationError(
            f"{100 * mixed:.0f} % of the points lie among points of another plane in the camera's picture, the limit "
            f"is {100 * MOST_MIXED:.0f} %: these correspondences are of several boards, or something moved while they "
            "were photographed; give the correspondences of one scene that stands still"
        )


def check_flat(solution: BundleSolution, x1: FloatArray) -> None:
    """Refuse planes whose points leave them together: curved surfaces.

    Raises
    ------
    NotFlat
        With the plane, its bend, and where it is.
    """
    found, limit = _bends_and_limits_px(solution, x1)
    kind, worst = np.unravel_index(int(np.argmax(found / limit)), found.shape)
    if found[kind, worst] <= limit[kind, worst]:
        return
    place = np.median(x1[solution.used[solution.fit_label == worst]], axis=0)
    raise NotFlat(
        f"the surface around camera pixel ({place[0]:.0f}, {place[1]:.0f}) is not flat: its points leave the plane "
        f"through them together, by {found[kind, worst]:.3f} px rms, the limit is {limit[kind, worst]:.3f} px "
        f"({100 * (1 - solution.share):.0f} % of all points lie on no plane). Curved surfaces are not modelled: aim at "
        "flat walls",
        int(worst),
    )


def check_no_facets(solution: BundleSolution, x1: FloatArray, x2: FloatArray) -> None:
    """Refuse planes that are flat but for what is near their edges: facets that stand for a curved surface.

    Raises
    ------
    CalibrationError
        With the plane, its bow, and where it is.
    """
    bow = bows_to_the_edges_px(solution, x1, x2)
    limit = np.maximum(MOST_BOW_TO_EDGES_PX, MOST_BOW_TO_EDGES_NOISES * bends_of(solution, x1).noise_px)
    worst = int(np.argmax(bow / limit))
    if bow[worst] <= limit[worst]:
        return
    place = np.median(x1[solution.label == worst], axis=0)
    raise CalibrationError(
        f"the surface around camera pixel ({place[0]:.0f}, {place[1]:.0f}) is not flat: towards its edges its points "
        f"leave the plane through them together, by {bow[worst]:.3f} px rms, the limit is {limit[worst]:.3f} px, as "
        "those of a curved surface do that flat pieces stand for. Curved surfaces are not modelled: aim at flat walls"
    )


def is_flat(solution: BundleSolution, x1: FloatArray) -> bool:
    """Tell whether no plane's points leave it together by more than :func:`check_flat` allows."""
    found, limit = _bends_and_limits_px(solution, x1)
    return bool((found <= limit).all())


def _bends_and_limits_px(solution: BundleSolution, x1: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(2, K) bend and bow of each plane, and what they may be."""
    bends = bends_of(solution, x1)
    limits = (
        np.maximum(MOST_BEND_PX, MOST_BEND_NOISES * bends.noise_px),
        np.maximum(MOST_BOW_PX, MOST_BOW_NOISES * bends.noise_px),
    )
    return np.stack([bends.bend_px, bends.bow_px]), np.stack(limits)


@dataclass(frozen=True, eq=False, kw_only=True)
class Angle:
    """Between two planes, by a fit that has them free."""

    planes: tuple[int, int]
    angle_deg: float
    """0 to 180, as seen from inside of the room."""
    sigma_deg: float


def angles_of(free: BundleSolution, pairs: Sequence[tuple[int, int]]) -> list[Angle]:
    """Measure the angles between pairs of planes in a fit that has them free.

    Parameters
    ----------
    free : BundleSolution
        With free planes.
    pairs : sequence of (int, int)
        Of planes.

    Returns
    -------
    list of Angle
        Standard deviations hold what data sheets leave open; infinite of a plane that no point is on.
    """
    variance = observation_variance(free.fit, free.error.x1, free.fit_label, free.error.x2)
    unknown = covariance(free.fit, variance)

    def angles(z: FloatArray) -> FloatArray:
        planes = planes_of(z, free.start_axes)
        normals = planes / np.linalg.norm(planes, axis=1, keepdims=True)
        # Normals point out of the room: seen from inside, walls meet at the supplement.
        return np.array([180 - np.degrees(np.arccos(np.clip(normals[a] @ normals[b], -1, 1))) for a, b in pairs])

    told = np.isin(pairs, free.fit_label).all(axis=1)
    sigma = np.where(told, standard_deviations(angles, free.fit.z, unknown), np.inf)
    values = angles(free.fit.z)
    return [
        Angle(planes=p, angle_deg=float(v), sigma_deg=float(s)) for p, v, s in zip(pairs, values, sigma, strict=True)
    ]


def check_right_angles(held: BundleSolution, free: BundleSolution) -> float:
    """Refuse right angles that the points and the data sheets contradict.

    Both fits are of the same points. What the fit without right angles explains better, in units of an independent
    observation's variance, has the chi-squared distribution of as many unknowns as right angles hold, if they are true.
    That variance is by squares alone: with strips, as sigmas have it, the gain is a third of what true right angles
    bring (decision 104), and a wall may lean further before it is seen.

    Parameters
    ----------
    held, free : BundleSolution
        Fits with right angles and without.

    Returns
    -------
    float
        Standard deviations, at most 4; of thirty random rooms -2 to 1.4.

    Raises
    ------
    CalibrationError
        With the angle that is furthest off, and its sigma.
    """
    variance = observation_variance(free.fit, free.error.x1, free.fit_label)
    gain = (held.fit.cost - free.fit.cost) / variance
    sigmas = normal_deviate(gain, angles_held(held.axes))
    if sigmas <= SIGMAS:
        return sigmas
    if _is_one_data_sheet(held):
        check_data_sheets(held, np.sqrt(np.diag(held.covariance)))
    on_axes = np.flatnonzero(held.axes.of_plane >= 0).tolist()
    within = f" to within {np.degrees(held.axes.askew_rad):g} degrees" if held.axes.askew_rad else ""
    across = [(a, b) for a, b in combinations(on_axes, 2) if held.axes.of_plane[a] != held.axes.of_plane[b]]
    # Walls along one axis alone stand at no right angle to each other: they are not parallel.
    angles = angles_of(refit(free.error, free, variance), across) if across else []
    raise CalibrationError(
        f"the walls are not at right angles{within}: a fit without right angles explains the points and hfov_deg "
        f"better by {sigmas:.0f} sigma, the limit is {SIGMAS:g}; {_worst_of(angles)}. Check hfov_deg of both devices; "
        f"if it is right, what stands askew in the room (a panel, a box) may be taken for a wall: show more of the "
        f"bare walls; or say how far from square the walls stand (askew_deg; {USUAL_ASKEW_DEG:g} in usual houses), or "
        "set right_angles = false"
    )


def angles_held(axes: Axes) -> int:
    """How many angles right angles take from planes: two of each plane, less those by which all of them turn together.

    Parameters
    ----------
    axes : Axes
        Which planes are perpendicular to which axis.
    """
    on_axes = axes.of_plane[axes.of_plane >= 0]
    if not len(on_axes):
        return 0
    # Planes across one axis alone: turned about it they stay as they are.
    return 2 * len(on_axes) - (3 if len(np.unique(on_axes)) > 1 else 2)


def _is_one_data_sheet(held: BundleSolution) -> bool:
    """Tell whether one lens alone contradicts its data sheet: walls that are not square make both too long or short."""
    off = np.abs(held.fit.z[[CAMERA.start, PROJECTOR.start]] - 1) / FOCAL_SIGMA
    return bool(off.max() > SIGMAS and off.min() < _TELLING)


def _worst_of(angles: Sequence[Angle]) -> str:
    """Which angle is furthest from a right one, in its own sigmas."""
    angle = max(angles, key=lambda angle: abs(angle.angle_deg - 90) / angle.sigma_deg, default=None)
    if angle is None or abs(angle.angle_deg - 90) < _TELLING * angle.sigma_deg:
        return "which of the angles it is, the points leave open"
    a, b = angle.planes
    return f"it puts walls {a + 1} and {b + 1} at {angle.angle_deg:.1f} +- {angle.sigma_deg:.1f} degrees"


def normal_deviate(chi_squared: float, freedom: int) -> float:
    """Return a chi-squared variable as one of a standard normal (Wilson and Hilferty, PNAS 17, 1931)."""
    if freedom < 1:
        return 0.0
    spread = 2 / (9 * freedom)
    return float((np.cbrt(chi_squared / freedom) - (1 - spread)) / np.sqrt(spread))


def check_data_sheets(solution: BundleSolution, sigma: FloatArray) -> None:
    """Refuse focal lengths that the fields of view of the data sheets contradict.

    Parameters
    ----------
    solution : BundleSolution
        A fit.
    sigma : (n,)
        Standard deviations of its unknowns.

    Raises
    ------
    CalibrationError
        With the device, both focal lengths, and their sigmas.
    """
    found = solution.fit.z[[CAMERA.start, PROJECTOR.start]]
    own = sigma[[CAMERA.start, PROJECTOR.start]]
    off = (found - 1) / np.hypot(FOCAL_SIGMA, own)
    together = abs(float(found.mean()) - 1) / np.hypot(FOCAL_SIGMA / np.sqrt(2), float(own.mean()))
    if max(*np.abs(off), together) <= SIGMAS:
        return
    worst = int(np.argmax(np.abs(off)))
    name = ("camera", "projector")[worst]
    raise CalibrationError(
        f"the {name}'s focal length comes out {found[worst]:.2f} +- {own[worst]:.2f} times, that of the other device "
        f"{found[1 - worst]:.2f} +- {own[1 - worst]:.2f} times what hfov_deg says, which is taken to be true to "
        f"{100 * FOCAL_SIGMA:g} %: {max(*np.abs(off), together):.0f} sigma, the limit is {SIGMAS:g}. Check hfov_deg "
        "(zoom, crop, horizontal or diagonal); if it is right, the walls are not at right angles (askew_deg says how "
        "far off, right_angles = false by anything)"
    )


def check_determined(solution: BundleSolution, unknown: FloatArray) -> None:
    """Refuse a fit whose distances the points leave open.

    Parameters
    ----------
    solution : BundleSolution
        A fit.
    unknown : (n, n)
        Covariance of its unknowns.

    Raises
    ------
    CalibrationError
        With the standard deviation of the ratio of distance and baseline, and its limit.
    """

    def distances(z: FloatArray) -> FloatArray:
        return np.asarray(-np.log(np.linalg.norm(planes_of(z, solution.start_axes), axis=1)))

    sigma = standard_deviations(distances, solution.fit.z, unknown)
    nearest = int(np.argmin(sigma))
    if sigma[nearest] > MOST_DISTANCE_SIGMA:
        raise CalibrationError(
            f"the walls' distance is {np.exp(distances(solution.fit.z)[nearest]):.1f} baselines "
            f"{plus_minus(100 * sigma[nearest], '%', most=100, decimals=0)}, the limit is "
            f"{100 * MOST_DISTANCE_SIGMA:.0f} %: {_why_open(solution)}"
        )


def _why_open(solution: BundleSolution) -> str:
    """Why distances are open: too little parallax, or most likely points that no plane explains."""
    if 1 - solution.share <= MOST_LEFT_OUT:
        return "too little parallax; move the camera further aside, and see more walls or the floor"
    return (
        f"{100 * (1 - solution.share):.0f} % of all points lie on no plane, as those of curved surfaces and "
        "furniture do; aim at bare, flat walls, or move the camera further aside"
    )
