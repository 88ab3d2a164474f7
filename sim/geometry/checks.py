"""What is wrong with patches: found, counted and named one by one before any light is computed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sim.arrays import BoolArray, FloatArray, IntArray
from sim.errors import SimulationError
from sim.geometry.intersections import piercing_and_overlapping
from sim.geometry.surface import Surface
from sim.geometry.topology import WELD, Topology, extent

Kind = Literal[
    "not finite",
    "degenerate",
    "tiny",
    "self-intersecting",
    "non-convex",
    "non-planar",
    "scale",
    "duplicate",
    "inverted",
    "open",
    "not convex",
    "intersecting",
    "overlapping",
    "contact",
    "t-junction",
]
NOTES: frozenset[Kind] = frozenset({"contact", "t-junction"})
"""Kinds that are worth knowing but do no harm."""

SMALLEST_M, LARGEST_M = 0.01, 1000.0
"""Extents outside of these are taken for a wrong unit."""
EXTENTS_THAT_CAN_BE_SQUARED_M = 1e-60, 1e60
"""Outside of these, areas and squared lengths leave the range of numbers: nothing but the scale is looked at."""
SMALLEST_SHARE = 10 * WELD
"""Longest edge over the scene's extent below which a patch is as small as the distance at which corners are one."""
THINNEST = 1e-7
"""Area over squared longest diagonal or edge below which a patch has no area."""
FLATNESS = 1e-6
"""Distance of a quad's corners from its plane, over its longest diagonal, above which it is not flat."""
NAMED = 10
"""How many patches a message names."""


@dataclass(frozen=True)
class MeshFault:
    """One kind of fault and the patches that have it."""

    kind: Kind
    patches: tuple[int, ...]
    """All patches concerned, in order."""
    message: str
    """How many, the first ten with their figures, the limit, and what to try."""

    @property
    def refused(self) -> bool:
        """Whether a mesh with it is refused; otherwise it is a note."""
        return self.kind not in NOTES


def mesh_faults(surface: Surface | FloatArray, *, thorough: bool = False) -> tuple[MeshFault, ...]:
    """Return all that is wrong with the patches of a surface.

    Parameters
    ----------
    surface : Surface or (P, 4, 3) array
        A surface is also held to what it says of itself (closed, convex); bare corners say nothing. [m]
    thorough : bool
        Also look for patches that pierce or cover each other: seconds for 10,000 patches.

    Returns
    -------
    tuple of MeshFault
        One for each kind, notes included.
    """
    if isinstance(surface, np.ndarray):
        return tuple(_examined(surface, closed=False, convex=False, thorough=thorough)[0])
    return tuple(_examined(surface.vertices, closed=surface.closed, convex=surface.convex, thorough=thorough)[0])


def checked_topology(
    name: str, vertices: FloatArray, *, closed: bool = False, convex: bool = False, thorough: bool = False
) -> Topology:
    """Return the topology of (P, 4, 3) corners without faults [m].

    Raises
    ------
    SimulationError
        A line for each kind of fault, with patches and advice.
    """
    found, topology = _examined(vertices, closed=closed, convex=convex, thorough=thorough)
    refuse(name, found)
    return topology


def refuse(name: str, found: Iterable[MeshFault]) -> None:
    """Raise SimulationError, a line for each fault that is more than a note."""
    lines = [f"\n  {fault.kind}: {fault.message}" for fault in found if fault.refused]
    if lines:
        raise SimulationError(f"mesh {name}: bad geometry" + "".join(lines))


def _examined(vertices: FloatArray, *, closed: bool, convex: bool, thorough: bool) -> tuple[list[MeshFault], Topology]:
    """Faults, and the topology of the patches that have a shape."""
    size_m = extent(vertices[np.isfinite(vertices).all(axis=(1, 2))])
    smallest_m, largest_m = EXTENTS_THAT_CAN_BE_SQUARED_M
    if not (smallest_m <= size_m <= largest_m or size_m == 0):
        return _scale_faults(size_m), Topology.of(vertices[:0])
    faults = _shape_faults(vertices)
    shapeless = np.concatenate([fault.patches for fault in faults] or [np.zeros(0, dtype=np.intp)])
    sound = np.setdiff1d(np.arange(len(vertices)), shapeless)
    topology = Topology.of(vertices[sound])
    scale = _scale_faults(topology.size_m) if len(sound) else []
    faults += _joint_faults(topology, sound, closed, convex)
    if thorough:
        faults += _crossing_faults(topology, sound)
    return [fault.described(vertices) for fault in faults] + scale, topology


@dataclass(frozen=True, eq=False)
class _Finding:
    """A kind of fault before it is put into words."""

    kind: Kind
    patches: IntArray
    """(N,) patches or (N, 2) pairs of them."""
    advice: str
    figures: tuple[str, ...] = ()
    """Something to say of each of the first patches."""

    def described(self, vertices: FloatArray) -> MeshFault:
        """Put it into words, with the place of each patch's first corner."""
        rows = self.patches.reshape(len(self.patches), -1)
        words = []
        for i, row in enumerate(rows[:NAMED]):
            place = ", ".join(f"{coordinate:.4g}" for coordinate in vertices[row[0], 0])
            figure = f", {self.figures[i]}" if self.figures else ""
            words.append(f"{' and '.join(map(str, row))} at ({place}) m{figure}")
        more = [f"and {len(rows) - NAMED} more"] if len(rows) > NAMED else []
        singular, plural = ("pair", "pairs") if rows.shape[1] == 2 else ("patch", "patches")
        counted = f"{len(rows)} {singular if len(rows) == 1 else plural}"
        message = f"{counted}: {'; '.join(words + more)}: {self.advice}"
        return MeshFault(self.kind, tuple(int(patch) for patch in np.unique(rows)), message)


def _named(kind: Kind, patches: IntArray, advice: str, figures: Iterable[str] = ()) -> list[_Finding]:
    """Nothing for no patches."""
    return [_Finding(kind, patches, advice, tuple(figures))] if len(patches) else []


def _shape_faults(vertices: FloatArray) -> list[_Finding]:
    finite = np.isfinite(vertices).all(axis=(1, 2))
    found = _named("not finite", np.flatnonzero(~finite), "a corner is NaN or infinite; correct the coordinates")
    left = np.flatnonzero(finite)
    shape = _Shape.of(vertices[left])
    crossed = shape.turns_back == 2
    flat = shape.deviation_m <= shape.flat_within_m
    thin = shape.repeats | (~crossed & flat & (shape.thickness < THINNEST))
    found += _named(
        "degenerate",
        left[thin],
        "a corner is repeated or all lie on a line: no area; remove the patch (a triangle repeats its last corner)",
    )
    tiny = ~thin & (shape.longest_m < SMALLEST_SHARE * extent(vertices[left]))
    found += _named(
        "tiny",
        left[tiny],
        f"no edge is longer than {SMALLEST_SHARE:g} of the scene, so that its corners are one point; remove the patch, "
        "or what lies far away",
        (f"{longest:.2g} m" for longest in shape.longest_m[tiny]),
    )
    thin |= tiny
    found += _named(
        "self-intersecting",
        left[~thin & crossed & flat],
        "two edges of the quad cross (a bow-tie); swap two neighbouring corners",
    )
    found += _named(
        "non-convex",
        left[~thin & flat & np.isin(shape.turns_back, (1, 3))],
        "a corner of the quad points inwards; cut it into two triangles",
    )
    bent = np.flatnonzero(~thin & ~flat)
    off_mm, limit_mm = 1e3 * shape.deviation_m[bent], 1e3 * shape.flat_within_m[bent]
    found += _named(
        "non-planar",
        left[bent],
        "the corners of a quad must lie in one plane; cut it into two triangles",
        (f"{off:.2g} mm off its plane, limit {limit:.2g} mm" for off, limit in zip(off_mm, limit_mm, strict=True)),
    )
    return found


@dataclass(frozen=True, eq=False, kw_only=True)
class _Shape:
    """Shape of each of P finite patches."""

    repeats: BoolArray
    """A corner comes twice, other than the last of a triangle."""
    thickness: FloatArray
    """Area over squared longest edge or diagonal."""
    longest_m: FloatArray
    """Longest edge or diagonal."""
    deviation_m: FloatArray
    """Largest distance of a corner from the middle plane."""
    flat_within_m: FloatArray
    """Largest deviation of what passes for flat."""
    turns_back: IntArray
    """Corners that turn against the sharpest one: 0 convex, 1 or 3 one points inwards, 2 bow-tie."""

    @classmethod
    def of(cls, vertices: FloatArray) -> _Shape:
        edges = np.roll(vertices, -1, axis=1) - vertices
        diagonals = vertices[:, 2:] - vertices[:, :2]
        length = np.linalg.norm(np.concatenate([edges, diagonals], axis=1), axis=2)
        longest = length.max(axis=1, initial=0)
        squared = np.maximum(longest**2, np.finfo(float).tiny)
        same = length <= 1e-12 * longest[:, None]
        normal = np.cross(diagonals[:, 0], diagonals[:, 1])
        turn = np.cross(np.roll(edges, 1, axis=1), edges)
        sharpest = np.take_along_axis(turn, np.linalg.norm(turn, axis=2).argmax(axis=1)[:, None, None], axis=1)
        back = np.einsum("nkc,nc->nk", turn, sharpest[:, 0]) < -1e-9 * squared[:, None] * _norm(sharpest[:, 0])
        # A bow-tie may have no area vector: then its sharpest corner gives the plane.
        thickness = np.linalg.norm(normal, axis=1) / (2 * squared)
        plane = np.where(thickness[:, None] < THINNEST, sharpest[:, 0], normal)
        plane = plane / np.maximum(_norm(plane), np.finfo(float).tiny)
        height = np.einsum("nkc,nc->nk", vertices - vertices.mean(axis=1, keepdims=True), plane)
        limit = np.maximum(FLATNESS * longest, WELD * extent(vertices))
        return cls(
            repeats=same[:, [0, 1, 3, 4, 5]].any(axis=1),
            thickness=thickness,
            longest_m=longest,
            deviation_m=np.abs(height).max(axis=1, initial=0),
            flat_within_m=limit,
            turns_back=back.sum(axis=1),
        )


def _norm(vectors: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(vectors, axis=1, keepdims=True))


def refuse_extent(name: str, points_m: FloatArray) -> None:
    """Raise SimulationError when the finite ones of points (V, 3) have an extent that no room has [m]."""
    refuse(name, _scale_faults(extent(points_m[np.isfinite(points_m).all(axis=1)])))


def _scale_faults(size_m: float) -> list[MeshFault]:
    if SMALLEST_M <= size_m <= LARGEST_M:
        return []
    guess = "millimetres taken for metres" if size_m > LARGEST_M else "metres taken for millimetres"
    message = (
        f"the scene is {size_m:.4g} m large, expected {SMALLEST_M:g} ... {LARGEST_M:g} m: probably {guess}; "
        "give coordinates in metres (of a file, the unit it is in)"
    )
    return [MeshFault("scale", (), message)]


def _joint_faults(topology: Topology, sound: IntArray, closed: bool, convex: bool) -> list[_Finding]:
    """What is wrong with patches as neighbours; ``sound`` are the numbers of the topology's patches."""
    copies, contacts = _copies(topology)
    found = _named(
        "duplicate",
        sound[copies],
        "same corners, same side; remove one of each pair",
    )
    found += _named(
        "inverted", sound[_inverted(topology)], "looks the other way than its neighbours; reverse its order of corners"
    )
    if closed:
        loose = np.setdiff1d(np.flatnonzero(topology.open_edges), topology.conflicts)
        found += _named(
            "open",
            sound[np.unique(topology.patch[loose])],
            "called closed, but an edge of the patch meets no other patch; close the gap or say closed=False",
        )
        if not topology.open_edges.any() and not topology.closed:
            everyone = np.arange(topology.n_patches)
            advice = "the closed mesh is lit from outside; reverse the order of corners, or say closed=False"
            found += _named("inverted", sound[everyone], advice)
    if convex:
        advice = "called convex, but something lies behind the patch, so it may cast a shadow; say convex=False"
        found += _named("not convex", sound[np.flatnonzero(topology.covers)], advice)
    found += _named(
        "contact",
        sound[contacts],
        "same corners, opposite sides: a sheet without thickness",
    )
    found += _named("t-junction", sound[topology.cut], "a corner of another patch lies on an edge; harmless")
    return found


def _copies(topology: Topology) -> tuple[IntArray, IntArray]:
    """(N, 2) patches with the same corners that look the same way, and (M, 2) that look opposite ways."""
    corners = np.sort(topology.corner, axis=1)
    # The corner that a triangle repeats may be any of its three.
    twice = corners[:, 1:] == corners[:, :-1]
    corners[:, 1:][twice] = -1
    corners = np.sort(corners, axis=1)
    _, group, count = np.unique(corners, axis=0, return_inverse=True, return_counts=True)
    group = group.reshape(-1)
    order = np.argsort(group, kind="stable")
    order = order[count[group[order]] > 1]
    next_same = group[order][1:] == group[order][:-1]
    pairs = np.stack([order[:-1][next_same], order[1:][next_same]], axis=1)
    same_side = (topology.normals[pairs[:, 0]] * topology.normals[pairs[:, 1]]).sum(axis=1) > 0
    return pairs[same_side], pairs[~same_side]


def _inverted(topology: Topology) -> IntArray:
    """Patches that contradict their neighbours: of two sheets that disagree, the one of fewer patches."""
    first, second = topology.patch[topology.conflicts].T
    sheet = topology.sheet
    size = np.bincount(sheet, minlength=1)[sheet]
    twisted = sheet[first] == sheet[second]
    copied = (np.sort(topology.corner[first]) == np.sort(topology.corner[second])).all(axis=1)
    fewer = np.where(size[first] < size[second], first, second)[~twisted]
    return np.union1d(np.flatnonzero(np.isin(sheet, sheet[fewer])), second[twisted & ~copied])


def _crossing_faults(topology: Topology, sound: IntArray) -> list[_Finding]:
    pierce, overlap = piercing_and_overlapping(topology)
    same_side = (topology.normals[overlap[:, 0]] * topology.normals[overlap[:, 1]]).sum(axis=1) > 0
    copies = set(map(tuple, np.concatenate(_copies(topology)).tolist()))
    new = np.array([tuple(pair) not in copies for pair in overlap.tolist()], dtype=bool)
    found = _named(
        "intersecting",
        sound[pierce],
        "the patches cut through each other; cut them where they meet",
    )
    found += _named(
        "overlapping",
        sound[overlap[new & same_side]],
        "the patches share area in one plane, so that it counts twice; remove or cut one",
    )
    found += _named(
        "contact",
        sound[overlap[new & ~same_side]],
        "the patches touch back to back or face to face: no light passes between",
    )
    return found
