"""Lengths that points and tape both tell: they agree, or both are named."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibration.arrays import FloatArray
from calibration.errors import CalibrationError
from calibration.geometry.noise import SIGMAS
from calibration.geometry.room import FACES, RoomBox

_USUAL_SIDE_M = 4.0
"""Of a room whose size nobody says."""


def tape_sigma_shares(
    share: float, size_m: tuple[float, float, float] | None, lens_height_m: float | None, askew_deg: float
) -> FloatArray:
    """Return how well lengths by tape stand for what is measured of walls: nowhere are askew ones equally far apart.

    Parameters
    ----------
    share : float
        Standard deviation of a length by tape, as a share of it.
    size_m : (x, y, z), optional
        Inner size of the room. [m]
    lens_height_m : float, optional
        Of the projector's lens above the floor. [m]
    askew_deg : float
        Standard deviation of each wall's two tilts. [degrees]

    Returns
    -------
    (5,)
        Of a length that does not end at two walls, of the three sides, of the lens above the floor; as shares of each.

    Notes
    -----
    From the middle of a wall of a x b a place drawn at random is off by (a² + b²) / 12 in the mean square: so far apart
    are where the tape was laid and where points were measured, on each of the walls at its ends.
    """
    sides = np.full(3, _USUAL_SIDE_M) if size_m is None else np.array(size_m)
    aside = np.radians(askew_deg) * np.sqrt(((sides**2).sum() - sides**2) / 12)
    height_m = sides[2] if lens_height_m is None else lens_height_m
    by_walls = [0.0, *(np.sqrt(2) * aside / sides), aside[2] / height_m]
    return np.asarray(np.hypot(share, by_walls))


def check_against_tape(
    box: RoomBox,
    size_m: tuple[float, float, float],
    sigma_m: FloatArray,
    tape_sigma_shares: Sequence[float],
    *,
    right_angles: bool = False,
) -> None:
    """Hold the lengths that were measured against those by tape.

    Parameters
    ----------
    box : RoomBox
        Of which the axes count whose two faces were both seen.
    size_m : (x, y, z)
        By tape measure. [m]
    sigma_m : (3,)
        Standard deviations of the measured size, that of the scale included. [m]
    tape_sigma_shares : sequence of 3
        Standard deviations of the lengths by tape, as shares of them.
    right_angles : bool
        Whether walls were held at right angles: then that may be what is wrong.

    Raises
    ------
    CalibrationError
        With both lengths, if they are more than four of their common standard deviations apart.
    """
    square = ", or walls are not square that are taken for it (askew_deg, right_angles = false)" if right_angles else ""
    for k in box.lengths_measured:
        measured, tape, sigma = box.size_m[k], size_m[k], float(sigma_m[k])
        own = tape_sigma_shares[k] * tape
        apart = _sigmas_apart(measured - tape, sigma, own)
        if apart > SIGMAS:
            raise CalibrationError(
                f"the room measures {measured:.3f} +- {sigma:.3f} m along {'xyz'[k]} "
                f"({FACES[2 * k]} and {FACES[2 * k + 1]} seen), {tape:.3f} +- {own:.3f} m by [surface] size_m: "
                f"{apart:.0f} sigma apart, the limit is {SIGMAS:g}. One of the "
                "tape's lengths is wrong ([[scale]] or size_m; x ends at the wall on the right), or hfov_deg is"
                f"{square}{_or_a_corner(box, k) if right_angles else ''}"
            )


def check_lens_height(measured_m: float, tape_m: float, sigma_m: float, tape_sigma_share: float) -> None:
    """Hold the height of the projector's lens above a floor that was measured against that by tape.

    Parameters
    ----------
    measured_m, tape_m : float
        Of the lens above the floor. [m]
    sigma_m : float
        Standard deviation of the measured height, that of the scale included. [m]
    tape_sigma_share : float
        Standard deviation of a length by tape, as a share of it.

    Raises
    ------
    CalibrationError
        With both heights, if they are more than four of their common standard deviations apart.
    """
    own = tape_sigma_share * tape_m
    apart = _sigmas_apart(measured_m - tape_m, sigma_m, own)
    if apart > SIGMAS:
        raise CalibrationError(
            f"the projector's lens is {measured_m:.3f} +- {sigma_m:.3f} m above the floor that is seen, {tape_m:.3f} "
            f"+- {own:.3f} m by surface.lens_height_m: {apart:.0f} sigma apart, the limit is {SIGMAS:g}. One of the "
            "tape's lengths is wrong ([[scale]] or lens_height_m), or hfov_deg is; correct what is"
        )


def _sigmas_apart(difference_m: float, sigma_m: float, tape_sigma_m: float) -> float:
    """A difference of two lengths, by how much both may be off."""
    return float(abs(difference_m) / np.hypot(sigma_m, tape_sigma_m))


def _or_a_corner(box: RoomBox, axis: int) -> str:
    """What else may be wrong where two walls face each other and no third was seen: with a floor, a corner's may."""
    across = FACES[2 * (1 - axis) : 2 * (1 - axis) + 2] if axis < 2 else box.seen
    if set(across) & set(box.seen):
        return ""
    return (
        ", or these two walls do not face each other but meet at a corner, which the points leave open: show more of "
        "floor or ceiling, or set the camera further aside"
    )
