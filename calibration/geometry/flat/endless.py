"""Walls that would face each other and have no end: the walls of a corner, as lenses that are wrong show them.

Focal lengths and poses that are a few percent off can open a corner until its walls face each other; with a floor the
right angles of a box hold for both. But walls that face each other never meet: where their points border on each other
in the picture, both would have to be lit out to where parallels meet.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from calibration.arrays import FloatArray
from calibration.errors import CalibrationError
from calibration.geometry.bundle_residual import rays_of
from calibration.geometry.plane_bundle import BundleSolution

MOST_REACH, _FAR_SHARE = 10.0, 0.01
"""Of two walls' points, those further away than so many times what is between the walls, and how many may be. Corners
of random rigs that were taken for such walls had a hundredth of them at 32 to 126 times, corridors of 12 to 17 m that
are 2 to 3 m wide at 4 to 5 times (decision 110)."""


def reach(solution: BundleSolution, x1: FloatArray) -> float:
    """Return how far away walls that face each other are lit, in units of what is between them.

    Parameters
    ----------
    solution : BundleSolution
        A fit.
    x1 : (N, 2)
        Camera pixels of the points that it labels. [px]

    Returns
    -------
    float
        The distance from the camera that a hundredth of both walls' points exceed, of the pair where that is most; 0
        where no walls on one axis face each other.
    """
    of_plane, planes = solution.axes.of_plane, solution.planes
    pairs = [
        [i, j]
        for i, j in combinations(range(len(planes)), 2)
        if of_plane[i] == of_plane[j] >= 0 and planes[i] @ planes[j] < 0
    ]
    return max((_reach_between(solution, x1, pair) for pair in pairs), default=0.0)


def _reach_between(solution: BundleSolution, x1: FloatArray, pair: list[int]) -> float:
    on = np.flatnonzero(np.isin(solution.label, pair))
    if not len(on):
        return 0.0
    rays = rays_of(solution.camera, x1[on])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    away = 1 / (rays * solution.planes[solution.label[on]]).sum(axis=1)
    between = float((1 / np.linalg.norm(solution.planes[pair], axis=1)).sum())
    return float(np.quantile(away, 1 - _FAR_SHARE)) / between


def check_walls_end(solution: BundleSolution, x1: FloatArray) -> None:
    """Refuse walls that face each other and are lit further away than any room is long.

    Parameters
    ----------
    solution : BundleSolution
        A fit.
    x1 : (N, 2)
        Camera pixels of the points that it labels. [px]

    Raises
    ------
    CalibrationError
        With how far they are lit, and the limit.
    """
    found = reach(solution, x1)
    if found > MOST_REACH:
        raise CalibrationError(
            f"two walls would face each other and be lit out to {found:.0f} times the distance between them, the limit "
            f"is {MOST_REACH:g}: they meet at a corner, but hfov_deg of a device is wrong, or the points leave open "
            "how the walls stand. Check hfov_deg, show more of floor or ceiling, set the camera further aside, or give "
            "both devices a lens file (rig lenses)"
        )
