"""What a fit is held against: flat surfaces, right angles, data sheets. A contradiction is refused, and named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.arrays import FloatArray
from calibration.errors import CalibrationError
from calibration.geometry.bundle_unknowns import PlanarScene, planes_of
from calibration.geometry.flat.endless import check_walls_end
from calibration.geometry.flat.left_out import MOST_LEFT_OUT, check_none_left_out
from calibration.geometry.known.data_sheets import check_data_sheets
from calibration.geometry.known.nominal import NominalIntrinsics
from calibration.geometry.known.square_walls import hold_against_free
from calibration.geometry.noise import observation_variance, plus_minus, standard_deviations
from calibration.geometry.plane_bundle import MARGIN_SHARE, BundleSolution, Rounds, adjust, adjust_to_held_planes
from calibration.geometry.support import (
    bends_of,
    bows_to_the_edges_px,
    exclusive_points,
    mixed_share,
    plane_errors_px,
)

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
_EXPLAINED_PX = 1.0
"""A plane explains points nearer than this."""
_MOST_ON_WALLS, _BEYOND_MOST, _LEAST_ON_WALLS_PX = 0.9, 2.2, 0.3
"""Nine of ten points that planes explain lie on walls. With one noise one in 60,000 is more than 2.2 times further off
than these; where a part of the points is worse than the others, that part has to stay."""
_SOME = 3000
"""Points that the fit without right angles is of."""
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
    rounds = Rounds(limits_px=(_EXPLAINED_PX,), iterations=8, margin_share=margin_share, explained_px=_EXPLAINED_PX)
    wide = adjust_to_held_planes(x1, x2, bundle, nominal, rounds=rounds, weight=weight)
    check_one_surface(wide, x1, x2)
    check_walls_end(wide, x1)
    rounds = replace(rounds, limits_px=(_on_walls_px(wide, x1, x2),))
    rough = adjust_to_held_planes(x1, x2, wide, nominal, rounds=rounds, weight=weight)
    bows = rough.found_bows()
    x2 = x2 if bows is None else bows.straightened(x1, x2)
    a, b = x1[:_SOME], x2[:_SOME]
    free_rounds = Rounds(limits_px=(2.0, _EXPLAINED_PX), iterations=10, margin_share=margin_share)
    free = adjust(a, b, rough.with_planes(rough.planes), nominal, rounds=free_rounds, weight=weight[:_SOME])
    check_flat(free or rough, a if free else x1)
    check_no_facets(free or rough, *((a, b) if free else (x1, x2)))
    on_walls_px = _on_walls_px(rough, x1, x2)
    angle_sigmas = None if free is None else hold_against_free(rough, free, on_walls_px)
    if bows is None:
        variance = observation_variance(rough.fit, rough.error.x1, rough.fit_label, rough.error.x2)
    else:
        variance = bows.variance_px2
    rounds = replace(rounds, limits_px=(on_walls_px,), iterations=10, variance_px2=variance)
    fit = adjust_to_held_planes(x1, x2, rough, nominal, rounds=rounds, weight=weight)
    final = replace(fit, right_angle_sigmas=angle_sigmas, bows=bows)
    check_data_sheets(final, np.sqrt(np.diag(final.covariance)))
    check_determined(final, final.covariance)
    check_none_left_out(final, x1, x2)
    return final


def _on_walls_px(scene: PlanarScene, x1: FloatArray, x2: FloatArray) -> float:
    """How far off points on walls may be, by their own scatter: what stands just before a wall, it explains less well.

    Such points turn a wall: of odd rooms 604 and 900 they spoke against right angles by 3.2 and 3.4 sigma.
    """
    best_px = plane_errors_px(scene, x1, x2).min(axis=0)
    most_px = float(np.quantile(best_px[best_px < _EXPLAINED_PX], _MOST_ON_WALLS))
    return float(np.clip(_BEYOND_MOST * most_px, _LEAST_ON_WALLS_PX, _EXPLAINED_PX))


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
