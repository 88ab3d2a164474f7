"""Form factors between any flat convex polygons, without occluders.

Three rules, chosen for each pair by an error bound:

- far apart: Gauss points on both patches, A F = 1/pi sum w w' cos cos' / r²;
- nearer: Gauss points on the smaller patch, each with the exact factor to the other (Lambert 1760);
- touching, nearly so, or cut by the plane of one of the two: both are cut by each other's plane, and then by
  Stokes' theorem A F = 1/(2 pi) of the double contour integral of ln r dx . dx' (Sparrow, "A new and simpler
  formulation for radiative angle factors", J. Heat Transfer 85, 1963): exact along one contour, Gauss points along
  the other on panels graded towards the places where the two come close; edges that touch have a closed form.

n x n Gauss points on a patch make a relative error below 2 p_n (1 + s rho / 3) (1 + d rho / 3) rho^-2n, where
rho = g + sqrt(1 + g²) is that of Bernstein's ellipse, g the gap over half the patch's longest edge, s and d how much
its height over the other's plane and its area element vary (0 ... 1), and p_n the error of n points in 1/r⁴ far
away, larger along the line of centres than across it (sim/kernel/form_factors/polygon_pairs.hpp).
tests/sim/form_factors/test_polygon_factors.py holds this bound against exact values.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sim import _kernel
from sim.arrays import FloatArray
from sim.errors import SimulationError
from sim.geometry.surface import Surface

FINEST_TOLERANCE = 1e-12
"""Below it nothing but roundoff is left to gain."""
TOLERANCE_OF_SAMPLES = {4: 2e-3, 9: 2e-4, 16: 1e-5, 25: 1e-6, 36: 1e-7}
"""Relative error of every pair that a number of samples a patch stands for."""
HIGHEST_ORDER = 10
"""Points along each side of a patch up to which Gauss points on both patches are cheaper than the contour."""


def exchange_areas(surface: Surface, samples: int | None = None, tolerance: float = 1e-6) -> FloatArray:
    """Return (P, P) A_i F_ij of every pair of patches, exactly symmetric, in 0 ... min(A_i, A_j) [m²].

    Parameters
    ----------
    surface : Surface
    samples : int, optional
        4, 9, 16, 25 or 36 points a patch, for those who think in samples. Each stands for a tolerance, 2e-4 with 9
        and 1e-6 with 25; most pairs then take so many points or fewer, near ones what the tolerance needs.
    tolerance : float
        Wanted relative error of every pair, without `samples`. Pairs that hardly see each other, A F below 1e-5
        of the smaller area, lose digits to roundoff: about 1e-16 of the larger area remains.

    Raises
    ------
    SimulationError
        For any other number of samples, or a tolerance outside 1e-12 ... 0.1.
    """
    exchange = np.empty((surface.n_patches, surface.n_patches))
    fill_exchange_areas(surface, exchange, samples, tolerance)
    return exchange


def fill_exchange_areas(surface: Surface, exchange: FloatArray, samples: int | None, tolerance: float) -> None:
    """Do what :func:`exchange_areas` does in a (P, P) array that is there."""
    wanted = _checked_tolerance(samples, tolerance)
    _kernel.polygon_exchange_areas(_corners(surface), wanted, HIGHEST_ORDER, exchange)


def exchange_areas_of_pairs(
    surface: Surface, first: ArrayLike, second: ArrayLike, tolerance: float = 1e-6
) -> FloatArray:
    """Return (K,) A F of the pairs (first[k], second[k]): the same bits as in :func:`exchange_areas` [m²].

    Every call prepares all patches of the surface: ask for many pairs at once.

    Raises
    ------
    SimulationError
        For indices of different shapes or outside the surface, or a tolerance outside 1e-12 ... 0.1.
    """
    wanted = _checked_tolerance(None, tolerance)
    one, other = (np.asarray(index, dtype=np.int64) for index in (first, second))
    if one.shape != other.shape or one.ndim != 1:
        raise SimulationError(f"pairs of patches of shapes {one.shape} and {other.shape}; give two lists of one length")
    low, high = np.minimum(one, other), np.maximum(one, other)
    if len(one) and not (low.min() >= 0 and high.max() < surface.n_patches):
        raise SimulationError(
            f"pairs name patches {low.min()} ... {high.max()}; {surface.name} has 0 ... {surface.n_patches - 1}"
        )
    order_of_rows = np.argsort(low, kind="stable")
    exchange = np.empty(len(one))
    _kernel.polygon_exchange_areas_of_pairs(
        _corners(surface),
        first=low[order_of_rows],
        second=high[order_of_rows],
        tolerance=wanted,
        highest_order=HIGHEST_ORDER,
        exchange=exchange,
    )
    answer = np.empty_like(exchange)
    answer[order_of_rows] = exchange
    return np.where(one == other, 0.0, answer)


def _checked_tolerance(samples: int | None, tolerance: float) -> float:
    if samples is not None:
        if samples not in TOLERANCE_OF_SAMPLES:
            raise SimulationError(f"{samples} samples a patch; give one of {', '.join(map(str, TOLERANCE_OF_SAMPLES))}")
        return TOLERANCE_OF_SAMPLES[samples]
    if not FINEST_TOLERANCE <= tolerance <= 0.1:
        raise SimulationError(f"tolerance {tolerance:g} of a form factor; give {FINEST_TOLERANCE:g} ... 0.1")
    return float(tolerance)


def _corners(surface: Surface) -> FloatArray:
    return np.ascontiguousarray(surface.vertices, dtype=np.float64)
