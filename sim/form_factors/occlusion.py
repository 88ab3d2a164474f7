"""The visible share of pairs of patches by exact clipping: what light between them passes the occluders.

Three steps, native (``sim/kernel/form_factors/occlusion.cpp``). The shaft of two patches, the hull of both, is tested
against the occluders; most pairs keep 1 and some are surely 0. For the others Gauss points on the patch that looks
smaller from the occluders see them as disjoint convex cones, nearest first. Each cone covers a convex part of
the other patch, and the exact factor of that part (Lambert) is what it blocks. So

    f = 1 - sum_p w_p blocked_p / sum_p w_p free_p   lies in [0, 1] and is one number for both directions.

A patch on which an occluder stands is cut along the contact first, since its view jumps there. Views with more
than 24 occluders use rays. ``sim.form_factors.visibility`` is the readable reference.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from sim import _kernel
from sim.arrays import BoolArray, FloatArray, IntArray
from sim.errors import SimulationError
from sim.geometry.surface import Surface

Quality = Literal["quick", "fair", "exact"]

POINTS = {"quick": 1, "fair": 2, "exact": 6}
"""Gauss points along each side of the outer patch."""


@dataclass(frozen=True, eq=False)
class VisibleFractions:
    """The pairs that an occluder parts, each once; all others see each other fully."""

    first: IntArray
    """(n,) patch of the lower index, in ascending order."""
    second: IntArray
    fraction: FloatArray
    """(n,) share of the unoccluded exchange area that remains, in [0, 1)."""
    rays: int = 0
    """Segments tested; 0 unless a view was too crowded to clip."""

    def apply(self, exchange: FloatArray) -> None:
        """Multiply symmetric (P, P) exchange areas, in place."""
        exchange[self.first, self.second] *= self.fraction
        exchange[self.second, self.first] *= self.fraction


def visible_fraction(
    surface: Surface, exchange: FloatArray, quality: Quality = "exact", points: int | None = None
) -> VisibleFractions:
    """Return the visible share of all pairs that exchange light.

    Parameters
    ----------
    surface : Surface
    exchange : (P, P) array
        FormFactorOperator areas without occluders; pairs with 0 are left out. Only the upper triangle is read. [m²]
    quality : {"quick", "fair", "exact"}
        1, 2 or 6 Gauss points along each side of the outer patch: the rms of partly hidden pairs of the box
        scene, as a share of theirs, is below 3 %, 1 % and 0.15 %.
    points : int, optional
        Their number, 1 ... 64, instead.

    Returns
    -------
    VisibleFractions

    Raises
    ------
    SimulationError
        For an exchange matrix of another shape, an unknown quality or a number of points out of range.
    """
    if exchange.shape != (surface.n_patches, surface.n_patches):
        raise SimulationError(f"exchange areas of shape {exchange.shape} for {surface.n_patches} patches; one a pair")
    rule, geometry = _rule(quality, points), _geometry(surface)
    if not len(geometry[1]):
        nothing = np.zeros(0, dtype=np.intp)
        return VisibleFractions(nothing, nothing, np.zeros(0))
    given = np.ascontiguousarray(exchange, dtype=np.float64)
    return VisibleFractions(*_kernel.visible_of_matrix(*geometry, given, *rule))


def visible_fraction_of_pairs(
    surface: Surface, first: IntArray, second: IntArray, quality: Quality = "exact", points: int | None = None
) -> FloatArray:
    """Return (n,) the visible share of listed pairs, 1 for those that nothing parts; arguments as above."""
    rule, geometry = _rule(quality, points), _geometry(surface)
    first, second = (np.ascontiguousarray(indices, dtype=np.int64) for indices in (first, second))
    _check_pairs(surface, first, second)
    fraction = np.ones(len(first))
    if len(geometry[1]):
        _kernel.visible_of_pairs(*geometry, first, second, *rule, fraction)
    return fraction


def segments_blocked(surface: Surface, begin: FloatArray, end: FloatArray) -> BoolArray:
    """Return (n,) True where an occluder cuts the segment between two points, each (n, 3) [m].

    An occluder that an end lies on (within 1e-7 of the scene's size) does not count; an edge does.
    """
    begin, end = (np.ascontiguousarray(points, dtype=np.float64) for points in (begin, end))
    if begin.ndim != 2 or begin.shape[1] != 3 or begin.shape != end.shape:
        raise SimulationError(f"segments from {begin.shape} to {end.shape}; give (n, 3) both")
    blocked = np.zeros(len(begin), dtype=bool)
    vertices, occluders = _geometry(surface)
    size = float(np.linalg.norm(np.ptp(vertices.reshape(-1, 3), axis=0)))
    segments = (begin, end)
    _kernel.segments_blocked(occluders, size, *segments, blocked)
    return blocked


def _rule(quality: Quality, points: int | None) -> tuple[FloatArray, FloatArray]:
    """Gauss nodes and weights on [0, 1]."""
    if quality not in POINTS:
        raise SimulationError(f"unknown quality {quality!r}; there are {', '.join(POINTS)}")
    number = POINTS[quality] if points is None else points
    if not 1 <= number <= 64:
        raise SimulationError(f"{number} points along a side; give 1 ... 64")
    nodes, weights = np.polynomial.legendre.leggauss(number)
    return (nodes + 1) / 2, weights / 2


def _geometry(surface: Surface) -> tuple[FloatArray, FloatArray]:
    """Patches' corners, and the occluders': none in a convex scene, whatever lies behind what."""
    occluders = surface.occluders[:0] if surface.convex else surface.occluders
    return np.ascontiguousarray(surface.vertices), np.ascontiguousarray(occluders)


def _check_pairs(surface: Surface, first: IntArray, second: IntArray) -> None:
    if first.ndim != 1 or first.shape != second.shape:
        raise SimulationError(f"pairs of shapes {first.shape} and {second.shape}; give (n,) both")
    if len(first) and not 0 <= min(first.min(), second.min()) <= max(first.max(), second.max()) < surface.n_patches:
        raise SimulationError(f"pairs name patches outside 0 ... {surface.n_patches - 1}; give pairs of this surface")
