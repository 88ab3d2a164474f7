"""What is said of a mesh that was mended: where it is open, what meets backs, what cuts what, which way is up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim import _kernel
from sim.arrays import IntArray
from sim.geometry.intersections import MOST_PAIRS, count_near_pairs, piercing_and_overlapping
from sim.geometry.mending.cleaning import border_edges
from sim.geometry.mending.remarks import Facets, Outcome, Remark, counted, named
from sim.geometry.topology import Topology

SAMPLED, RAYS = 4096, 64
"""Facets that the light is judged from, and rays of each: shares are known to about 0.2 %."""
WORTH_SAYING = 0.002
"""Share of the light from which it is said where it goes."""
MOST_SHARED = 1e-3
"""Share of the area that facets may have twice, in one plane and looking the same way."""
FLATTER = 1.1
"""A room's floor is at least so many times as long and wide as it is high, where another axis is taken for up."""
COVERED = 0.5
"""Share of a box's end that flat facets cover, from which it is a floor or a ceiling."""
UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
"""Metres of each unit."""
USUAL_M = 0.3, 60.0
"""Sizes of rooms that nobody asks about."""
LIKELY_M = 1.5, 30.0
"""Sizes of rooms for which a unit is proposed."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Judgement:
    """What was found of facets that light can be computed in."""

    remarks: tuple[Remark, ...]
    by_rays: bool
    """Whether only form factors by rays are sure not to create light."""


def judged(facets: Facets, lit: Facets, *, up: str, unit: str, unit_given: bool) -> Judgement:
    """Return what is worth knowing of facets before light is computed.

    Parameters
    ----------
    facets : Facets
        Cleaned and oriented.
    lit : Facets
        The same, and second sides where sheets have them.
    up, unit : str
        How the file was read.
    unit_given : bool
        Whether somebody said so: then no other unit is proposed.

    Returns
    -------
    Judgement
    """
    remarks = [*_joints(facets), *_light(lit)]
    crossings, unsure = _crossings(facets)
    remarks += [*crossings, *_upright(facets, up)]
    if not unit_given:
        remarks += _unit(facets, unit)
    non_manifold = any(remark.kind == "non-manifold" for remark in remarks)
    return Judgement(remarks=tuple(remarks), by_rays=unsure or non_manifold)


def _remark(kind: str, outcome: Outcome, message: str, facets: IntArray | None = None) -> Remark:
    return Remark(
        kind=kind, outcome=outcome, message=message, facets=np.zeros(0, np.intp) if facets is None else facets
    )


def _joints(facets: Facets) -> list[Remark]:
    """Open borders by length, and edges of more than two facets."""
    edges, owner = border_edges(facets.triangles)
    found = []
    topology = Topology.of(facets.patches)
    loose = np.unique(topology.patch[topology.open_edges])
    if len(owner) and len(loose):
        length_m = np.linalg.norm(np.diff(facets.points[edges], axis=1), axis=2).sum()
        message = f"{counted(len(loose))} end at {length_m:.3g} m of open border: {named(facets, loose)}"
        found.append(_remark("open", "note", message, facets.source[loose]))
    start, end = topology.start, topology.end
    low, high = np.minimum(start, end), np.maximum(start, end)
    _, edge = np.unique(low * (high.max(initial=0) + 1) + high, return_inverse=True)
    many = np.unique(topology.patch[np.bincount(edge.reshape(-1))[edge.reshape(-1)] > 2])
    if len(many):
        message = f"{counted(len(many))} at edges that more than two share: {named(facets, many)}"
        found.append(_remark("non-manifold", "note", message, facets.source[many]))
    return found


def _light(facets: Facets) -> list[Remark]:
    """Where light goes that leaves lit sides: to others, to backs, or out."""
    areas = facets.areas
    height = (np.arange(SAMPLED) + 0.5) / SAMPLED * areas.sum()
    chosen = np.minimum(np.searchsorted(np.cumsum(areas), height), facets.n_facets - 1)
    rows, weight = np.unique(chosen, return_counts=True)
    met = np.empty((len(rows), RAYS), dtype=np.int32)
    tree = _kernel.RayTree(np.ascontiguousarray(facets.patches))
    tree.sample(np.ascontiguousarray(rows, dtype=np.int64), 0, 0, met)
    shares = [np.asarray((met == code).mean(axis=1)) for code in (-1, -2)]
    lost, behind = (float(weight @ share) / SAMPLED for share in shares)
    found = []
    if not (met >= 0).any():
        message = (
            "no facet's lit side sees another's: there is no light between surfaces. That is right for a flat screen "
            "or the outside of a ball; of a room, it says that walls are missing or look outwards"
        )
        found.append(_remark("no exchange", "note", message))
    if lost > WORTH_SAYING:
        found.append(_remark("leaves", "note", f"{100 * lost:.2g} % of the light from lit sides leaves the scene"))
    if behind > WORTH_SAYING:
        backs = rows[shares[1] > 0.5]
        message = (
            f"{100 * behind:.2g} % of the light from lit sides meets backs and is lost there; --sides both gives open "
            "sheets a second side"
        )
        found.append(_remark("backs", "note", message, facets.source[backs]))
    return found


def _crossings(facets: Facets) -> tuple[list[Remark], bool]:
    """Facets that cut or cover each other, and whether there are some or nobody knows."""
    if count_near_pairs(facets.patches) > MOST_PAIRS:
        message = "too many facets lie near each other to look for those that cut through others; light goes by rays"
        return [_remark("not examined", "note", message)], True
    topology = Topology.of(facets.patches)
    pierce, overlap = piercing_and_overlapping(topology)
    same_side = (topology.normals[overlap[:, 0]] * topology.normals[overlap[:, 1]]).sum(axis=1) > 0
    found = []
    if len(pierce):
        which = np.unique(pierce)
        message = f"{counted(len(which))} cut through each other: {named(facets, which)}; light goes by rays"
        found.append(_remark("intersecting", "note", message, facets.source[which]))
    if same_side.any():
        which = np.unique(overlap[same_side])
        areas, pairs = facets.areas, overlap[same_side]
        smaller = np.unique(np.take_along_axis(pairs, areas[pairs].argmin(axis=1)[:, None], axis=1))
        share = areas[smaller].sum() / areas.sum()
        message = (
            f"{counted(len(which))} share area in one plane, up to {100 * share:.2g} % of the surface counts twice "
            f"(limit {100 * MOST_SHARED:g} %): {named(facets, which)}; remove or cut one of each pair"
        )
        outcome: Outcome = "refused" if share > MOST_SHARED else "note"
        found.append(_remark("overlapping", outcome, message, facets.source[which]))
    return found, bool(len(pierce) or same_side.any())


def _upright(facets: Facets, up: str) -> list[Remark]:
    """Another axis than the one that was taken for up, where it alone has floor and ceiling of a flat room."""
    corners = facets.points[np.unique(facets.triangles)]
    low, high = corners.min(axis=0), corners.max(axis=0)
    size = high - low
    shortest = int(size.argmin())
    others = np.delete(size, shortest)
    flat = others.min() > FLATTER * size[shortest] > 0
    if shortest == 2 or not flat or _covered(facets, shortest) < COVERED:
        return []
    message = (
        f"read with {up} up the scene is {size[2]:.3g} m high and only {size[shortest]:.3g} m deep between two flat "
        "ends, as a room lying on its side is; if so, give another --up"
    )
    return [_remark("up axis", "note", message)]


def _covered(facets: Facets, axis: int) -> float:
    """Share of a box's two ends across an axis that facets cover, the lesser one."""
    corners = facets.corners
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    size = high - low
    end = float(np.delete(size, axis).prod())
    height = corners[:, :, axis]
    on_low = (height - low[axis] < 0.01 * size[axis]).all(axis=1)
    on_high = (high[axis] - height < 0.01 * size[axis]).all(axis=1)
    return min(float(facets.areas[on].sum()) for on in (on_low, on_high)) / max(end, np.finfo(float).tiny)


def _unit(facets: Facets, unit: str) -> list[Remark]:
    corners = facets.points[np.unique(facets.triangles)]
    size_m = float(np.ptp(corners, axis=0).max())
    if USUAL_M[0] <= size_m <= USUAL_M[1]:
        return []
    numbers = size_m / UNITS_M[unit]
    likely = {name: numbers * scale for name, scale in UNITS_M.items() if LIKELY_M[0] <= numbers * scale <= LIKELY_M[1]}
    guess = " or ".join(f"--unit {name} ({metres:.3g} m)" for name, metres in likely.items())
    message = f"read in {unit} the scene is {size_m:.3g} m large" + (f"; is it {guess}?" if guess else "")
    return [_remark("unit", "note", message + " Shares of white do not depend on it")]
