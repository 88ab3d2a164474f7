"""What every mesh is freed of before anything else: near-miss corners, facets without area, copies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from sim.arrays import BoolArray, FloatArray, IntArray
from sim.geometry.checks import SMALLEST_SHARE, THINNEST
from sim.geometry.mending.remarks import Facets, Outcome, Remark, counted, named
from sim.geometry.topology import WELD, extent, weld

MERGED = 1e-5
"""Of the scene's size: borders nearer than this are one; 0.05 mm in a room of 5 m, less than any tool's snapping."""
WIDEST = 3.0
"""A cluster of border corners wider than this many tolerances is left as it is: it is detail, not rounding."""
MOST_NEIGHBOURS = 64
"""Corners within the tolerance of another, on average, from which they are detail, too."""


def cleaned(facets: Facets, merge_m: float | None = None) -> tuple[Facets, list[Remark]]:
    """Return a mesh's facets with one corner in one place, without facets that have no area, and without copies.

    Parameters
    ----------
    facets : Facets
        Of any triangles.
    merge_m : float, optional
        Corners of open borders that are nearer than this become one [m]; default: 1e-5 of the scene's size.

    Returns
    -------
    Facets, list of Remark
        What is left, and what was done; a remark that is ``refused`` where a corner is not finite.
    """
    finite = facets.finite
    words = "{facets} with a corner that is NaN or infinite: {names}; correct it"
    remarks = _remarks("not finite", facets, ~finite, words, outcome="refused")
    facets = facets.chosen(np.flatnonzero(finite))
    if not facets.n_facets:
        return facets, remarks
    used, corners = np.unique(facets.triangles, return_inverse=True)
    points, number = weld(facets.points[used], WELD * extent(facets.points[used]))
    facets = replace(facets, points=points, triangles=number[corners.reshape(-1, 3)])
    facets, flat = _without_area(facets)
    tolerance_m = MERGED * extent(facets.points) if merge_m is None else merge_m
    facets, merged = _borders_merged(facets, tolerance_m)
    facets, closed = _without_area(facets)
    facets, copies = _without_copies(facets)
    return facets, [*remarks, *flat, *merged, *closed, *copies]


def _remarks(kind: str, facets: Facets, which: BoolArray, message: str, *, outcome: Outcome = "mended") -> list[Remark]:
    """A remark about some facets, their number and names put into its words; nothing for no facets."""
    found = np.flatnonzero(which)
    if not len(found):
        return []
    words = message.format(facets=counted(len(found)), names=named(facets, found))
    return [Remark(kind=kind, outcome=outcome, message=words, facets=facets.source[found])]


def _without_area(facets: Facets) -> tuple[Facets, list[Remark]]:
    """Facets on a line or a point removed: they have no light of their own, and neighbours meet without them."""
    if not facets.n_facets:
        return facets, []
    corners = facets.corners
    longest = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1)
    thin = facets.areas <= THINNEST * longest**2
    small = ~thin & (longest < SMALLEST_SHARE * extent(facets.points))
    share = facets.areas[small].sum() / max(facets.areas.sum(), np.finfo(float).tiny)
    remarks = _remarks("degenerate", facets, thin, "{facets} without area removed: {names}")
    remarks += _remarks(
        "tiny",
        facets,
        small,
        f"{{facets}} smaller than {SMALLEST_SHARE:g} of the scene removed, {share:.1g} of its area: {{names}}",
    )
    return facets.chosen(np.flatnonzero(~thin & ~small)), remarks


def border_edges(triangles: IntArray) -> tuple[IntArray, IntArray]:
    """Return (E, 2) edges that only one facet has, as they run there, and (E,) its number."""
    start, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    low, high = np.minimum(start, end).astype(np.int64), np.maximum(start, end).astype(np.int64)
    _, number, count = np.unique(low * (high.max(initial=0) + 1) + high, return_inverse=True, return_counts=True)
    alone = np.flatnonzero(count[number.reshape(-1)] == 1)
    return np.stack([start[alone], end[alone]], axis=1), alone // 3


def _borders_merged(facets: Facets, tolerance_m: float) -> tuple[Facets, list[Remark]]:
    """Corners of open borders that nearly meet made one, each cluster at its first corner."""
    edges, _ = border_edges(facets.triangles)
    border = np.unique(edges)
    if not len(border) or tolerance_m <= 0:
        return facets, []
    tree = KDTree(facets.points[border])
    if tree.count_neighbors(tree, tolerance_m) > MOST_NEIGHBOURS * len(border):
        message = (
            f"borders have more than {MOST_NEIGHBOURS} corners within {1e3 * tolerance_m:.3g} mm of each other: none "
            "merged; give a smaller distance to merge within"
        )
        return facets, [Remark(kind="near miss", outcome="note", message=message, facets=np.zeros(0, dtype=np.intp))]
    pairs = tree.query_pairs(tolerance_m, output_type="ndarray")
    label = _connected(len(border), pairs)
    wide = _widths(facets.points[border], label) > WIDEST * tolerance_m
    first = np.unique(label, return_index=True)[1]
    target = np.where(wide[label], np.arange(len(border)), first[label])
    moved = np.flatnonzero(target != np.arange(len(border)))
    if not len(moved):
        return facets, []
    number = np.arange(len(facets.points))
    number[border] = border[target]
    distance_mm = 1e3 * float(
        np.linalg.norm(facets.points[border[moved]] - facets.points[border[target[moved]]], axis=1).max()
    )
    touched = np.asarray(np.isin(facets.triangles, border[moved]).any(axis=1))
    message = (
        f"{counted(len(moved), 'corner')} of open borders merged with others up to {distance_mm:.3g} mm away "
        f"(limit {1e3 * tolerance_m:.3g} mm): {{facets}}, {{names}}"
    )
    remarks = _remarks("near miss", facets, touched, message)
    return replace(facets, triangles=number[facets.triangles]), remarks


def _connected(n: int, pairs: IntArray) -> IntArray:
    graph = coo_array((np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.intp)


def _widths(points: FloatArray, label: IntArray) -> FloatArray:
    """(clusters,) largest extent along an axis."""
    n = int(label.max(initial=-1)) + 1
    low, high = np.full((n, 3), np.inf), np.full((n, 3), -np.inf)
    np.minimum.at(low, label, points)
    np.maximum.at(high, label, points)
    return np.asarray((high - low).max(axis=1, initial=0))


def _without_copies(facets: Facets) -> tuple[Facets, list[Remark]]:
    """Facets with the same corners that look the same way left once; the other way is a sheet's second side."""
    lowest = facets.triangles.argmin(axis=1)
    rolled = np.take_along_axis(facets.triangles, (lowest[:, None] + np.arange(3)) % 3, axis=1)
    first = np.unique(rolled, axis=0, return_index=True)[1]
    copy = np.ones(facets.n_facets, dtype=bool)
    copy[first] = False
    remarks = _remarks("duplicate", facets, copy, "{facets} a second time in one place removed: {names}")
    return facets.chosen(np.flatnonzero(~copy)), remarks
