"""Which side of a facet is lit: neighbours made to agree, and sheets turned that look into nothing.

A facet is lit on one side, the one from which its corners go round counter-clockwise. Tools export rooms with either
side. Where two facets alone share an edge they must agree; what hangs together so is a sheet. Rays from both sides of
each sheet tell where it looks: a sheet whose lit side sees nothing while its other side does is turned, and so is a
closed body within a room that is lit on its inside only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sim.arrays import BoolArray, FloatArray, IntArray
from sim.geometry.mending.remarks import Facets, Remark, counted, named
from sim.geometry.mending.tracing import Tracing
from sim.geometry.rays import low_discrepancy
from sim.geometry.topology import Topology

RAYS = 1 << 17
"""Of each side of the whole mesh."""
FEWEST_RAYS, MOST_RAYS = 8, 4096
"""Of each side of a sheet."""
NOTHING, SOMETHING = 0.02, 0.1
"""Shares of rays below which a side sees nothing, and from which it sees something."""
SURROUNDED = 0.9
"""Share of the rays from a body's outside that meet the lit sides of others, from which it stands in their room."""


@dataclass(frozen=True, eq=False)
class _Sheets:
    """Facets that hang together by edges of two."""

    label: IntArray
    """(T,) sheet of each facet."""
    flip: BoolArray
    """(T,) facets to turn so that each sheet agrees with most of its area."""
    one_sided: BoolArray
    """(T,) facets of sheets that cannot agree, as a Möbius strip cannot."""


def oriented(facets: Facets) -> tuple[Facets, list[Remark]]:
    """Return facets that agree with their neighbours and look at something, and what was turned.

    Parameters
    ----------
    facets : Facets
        Cleaned ones.

    Returns
    -------
    Facets, list of Remark
        A remark that is ``refused`` where neighbours cannot agree.
    """
    if not facets.n_facets:
        return facets, []
    topology = Topology.of(facets.patches)
    sheets = _sheets(topology, facets.areas)
    remarks = []
    if sheets.one_sided.any():
        which = np.flatnonzero(sheets.one_sided)
        message = f"{counted(len(which))} of a sheet that has one side only: {named(facets, which)}; cut it open"
        remarks.append(Remark(kind="one-sided", outcome="refused", message=message, facets=facets.source[which]))
    flip = np.flatnonzero(sheets.flip)
    if len(flip):
        message = f"{counted(len(flip))} looked the other way than their neighbours, turned: {named(facets, flip)}"
        remarks.append(Remark(kind="inverted", outcome="mended", message=message, facets=facets.source[flip]))
        facets = facets.turned(flip)
    outwards, inside_out = _to_turn(facets, sheets.label)
    for which, words in (
        (outwards, "looked into nothing while the other side sees the scene, turned"),
        (inside_out, "of closed bodies that were lit on the inside only, turned"),
    ):
        if len(which):
            message = f"{counted(len(which))} {words}: {named(facets, which)}; to keep the file's sides: --sides file"
            remarks.append(Remark(kind="inside out", outcome="mended", message=message, facets=facets.source[which]))
    return facets.turned(np.concatenate([outwards, inside_out])), remarks


def sheets_of(facets: Facets) -> IntArray:
    """Return (T,) the sheet of each facet: those that alone share an edge are in one."""
    first, second, _ = _pairs(Topology.of(facets.patches))
    return _connected(facets.n_facets, first, second)


def _sheets(topology: Topology, areas: FloatArray) -> _Sheets:
    """Sheets and who must turn: each facet twice, as it is and turned, joined where two sides of an edge agree."""
    n = topology.n_patches
    first, second, against = _pairs(topology)
    label = _connected(n, first, second)
    other = np.where(against, 0, n)
    twice = _connected(2 * n, np.concatenate([first, first + n]), np.concatenate([second + other, second + n - other]))
    one_sided = twice[:n] == twice[n:]
    one_sided = np.isin(label, label[one_sided])
    # Of the two ways to agree, the one that most of the sheet's area has already.
    _, way = np.unique(twice, return_inverse=True)
    weight = np.bincount(way[:n], areas, minlength=int(way.max()) + 1)
    flip = ~one_sided & (
        (weight[way[:n]] < weight[way[n:]]) | ((weight[way[:n]] == weight[way[n:]]) & (way[:n] > way[n:]))
    )
    return _Sheets(label, flip, one_sided)


def _pairs(topology: Topology) -> tuple[IntArray, IntArray, BoolArray]:
    """Facets that alone share an edge, and whether it runs against itself there, as it should."""
    low, high = np.minimum(topology.start, topology.end), np.maximum(topology.start, topology.end)
    _, edge = np.unique(low * (high.max(initial=0) + 1) + high, return_inverse=True)
    edge = edge.reshape(-1)
    order = np.argsort(edge, kind="stable")
    count = np.bincount(edge)
    at = (np.cumsum(count) - count)[count == 2]
    one, other = order[at], order[at + 1]
    different = topology.patch[one] != topology.patch[other]
    one, other = one[different], other[different]
    return topology.patch[one], topology.patch[other], topology.start[one] != topology.start[other]


def _connected(n: int, first: IntArray, second: IntArray) -> IntArray:
    graph = coo_array((np.ones(len(first), dtype=np.int8), (first, second)), shape=(n, n))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.intp)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Looks:
    """(S,) shares of the rays from one side of each sheet."""

    anything: FloatArray
    others: FloatArray
    lit_others: FloatArray


def _to_turn(facets: Facets, label: IntArray) -> tuple[IntArray, IntArray]:
    """Facets of sheets that look into nothing, and of bodies that are lit on the inside only."""
    rays = _Rays.of(facets, label)
    lit = np.zeros(int(label.max()) + 1, dtype=bool)
    front, back = rays.looks(1, lit), rays.looks(-1, lit)
    outwards = (front.anything < NOTHING) & (back.anything > SOMETHING)
    # Of a sheet that has a second side already, that one is lit.
    outwards[label[_with_twins(facets)]] = False
    front, back = rays.looks(1, outwards), rays.looks(-1, outwards)
    itself_only = (front.anything > 1 - NOTHING) & (front.others < NOTHING)
    inside_out = ~outwards & itself_only & (back.lit_others > SURROUNDED)
    return np.flatnonzero(outwards[label]), np.flatnonzero(inside_out[label])


def _with_twins(facets: Facets) -> IntArray:
    """Facets in whose place another looks the other way."""
    corners = np.sort(facets.triangles, axis=1)
    _, number, count = np.unique(corners, axis=0, return_inverse=True, return_counts=True)
    return np.flatnonzero(count[number.reshape(-1)] > 1)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Rays:
    """Rays from both sides of all sheets, and what they meet."""

    sheet: IntArray
    """(N,) where each begins."""
    side: IntArray
    """(N,) 1 lit, -1 the other one."""
    met: IntArray
    """(N,) sheet that it meets, -1 none."""
    met_side: IntArray
    """(N,) side that it meets."""

    @classmethod
    def of(cls, facets: Facets, label: IntArray) -> _Rays:
        facet = _spread(label, facets.areas)
        n = len(facet)
        u = low_discrepancy(n)
        tracing = Tracing.of(facets)
        places, normals = tracing.points(facet, u[:, :2])
        up = tracing.directions(facet, u[:, 2:])
        down = up - 2 * (up * normals).sum(axis=1, keepdims=True) * normals
        lift = tracing.lift_m * normals
        met, cosine, _ = tracing.first_met(np.concatenate([places + lift, places - lift]), np.concatenate([up, down]))
        return cls(
            sheet=np.tile(label[facet], 2),
            side=np.repeat([1, -1], n),
            met=np.where(met >= 0, label[met], -1),
            met_side=np.where(cosine > 0, 1, -1),
        )

    def looks(self, side: int, turned: BoolArray) -> _Looks:
        """What a side of each sheet sees once some sheets are turned."""
        from_here = self.side * np.where(turned[self.sheet], -1, 1) == side
        sheet, met = self.sheet[from_here], self.met[from_here]
        lit = self.met_side[from_here] * np.where(turned[met], -1, 1) == 1
        others = (met >= 0) & (met != sheet)
        count = np.maximum(np.bincount(sheet, minlength=len(turned)), 1)

        def share(which: BoolArray) -> FloatArray:
            return np.asarray(np.bincount(sheet[which], minlength=len(turned)) / count)

        return _Looks(anything=share(met >= 0), others=share(others), lit_others=share(others & lit))


def _spread(label: IntArray, areas: FloatArray) -> IntArray:
    """(N,) facets where rays begin: by area within each sheet, some from every sheet."""
    sheets = int(label.max()) + 1
    area = np.bincount(label, areas, minlength=sheets)
    count = np.clip(np.ceil(RAYS * area / area.sum()), FEWEST_RAYS, MOST_RAYS).astype(np.intp)
    order = np.argsort(label, kind="stable")
    end = np.cumsum(areas[order])
    last = np.cumsum(np.bincount(label, minlength=sheets)) - 1
    begin = end[last] - area
    sheet = np.repeat(np.arange(sheets), count)
    step = np.arange(len(sheet)) - np.repeat(np.cumsum(count) - count, count)
    height = begin[sheet] + area[sheet] * (step + 0.5) / count[sheet]
    place = np.clip(np.searchsorted(end, height), (last - np.bincount(label, minlength=sheets) + 1)[sheet], last[sheet])
    return np.asarray(order[place])
