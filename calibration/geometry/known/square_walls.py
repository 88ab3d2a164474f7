"""Walls at right angles, as far as somebody promised them: held against a fit that has them free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from calibration.arrays import FloatArray
from calibration.errors import CalibrationError
from calibration.geometry.bundle_unknowns import CAMERA, FOCAL_SIGMA, PROJECTOR, planes_of
from calibration.geometry.known.data_sheets import check_data_sheets
from calibration.geometry.noise import SIGMAS, covariance, normal_deviate, observation_variance, standard_deviations
from calibration.geometry.plane_bundle import BundleSolution, refit
from calibration.geometry.planes import USUAL_ASKEW_DEG, Axes

_TELLING = 2.0
"""Sigmas from a right angle at which an angle is worth telling."""


def hold_against_free(square: BundleSolution, free: BundleSolution, on_walls_px: float) -> float | None:
    """Hold right angles against a fit that has none, both made again to those points that are surely on walls.

    Parameters
    ----------
    square, free : BundleSolution
        Fits with right angles and without.
    on_walls_px : float
        How far points may be from where the free fit has them. [px]

    Returns
    -------
    float or None
        Standard deviations, as :func:`check_right_angles` gives them; None of a fit without right angles.

    Raises
    ------
    CalibrationError
        If the points contradict right angles.
    """
    if (square.axes.of_plane < 0).all():
        return None
    error = free.error.of_points(np.linalg.norm(free.fit.residual, axis=1) < on_walls_px)
    variance = observation_variance(free.fit, free.error.x1, free.fit_label)
    held = refit(replace(error, axes=square.axes), square, variance)
    return check_right_angles(held, refit(error, held.with_planes(held.planes), variance))


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
