"""The room of a plan as the light model's surface: box with openings, scene of the library, or mesh."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.offline.mesh_file import MeshOptions, open_mesh_file
from rig.plan.paints import ChosenPaint, chosen_paint
from rig.plan.request import Opening, PlanRequest, RoomShape
from rig.terminal import silent
from sim.errors import SimulationError
from sim.form_factors import FormFactors, form_factors
from sim.geometry.mesh import Mesh
from sim.geometry.rays import stands_in_air
from sim.geometry.scene import Face, Scene
from sim.geometry.surface import Surface
from sim.scenes.cluttered import corner_with_ball
from sim.scenes.gridded import LIBRARY, furnished_room, room
from sim.scenes.meshes import integrating_sphere, sloped_room

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

MOST_PATCHES = 6000
"""Whose dense form factors take 288 MB, and a minute or two of processor time."""
UPRIGHT = 0.5
"""Vertical part of a normal above which a surface is floor or ceiling."""
_SCENES: Mapping[str, Callable[[float], Scene | Mesh]] = {
    **LIBRARY,
    "furnished-room": furnished_room,
    "sloped-room": sloped_room,
    "sphere": lambda _: integrating_sphere(),
    "corner-with-ball": lambda _: corner_with_ball(),
}


@dataclass(frozen=True, eq=False, kw_only=True)
class BareShape:
    """Patches of a room, and what its surfaces are called; not yet painted."""

    surface: Scene | Mesh
    names: tuple[str, ...]
    """Of the S surfaces, openings included."""
    surface_of: IntArray
    """(P,) surface of each patch."""
    upright: tuple[bool, ...]
    """Whether each surface is a wall."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PlannedRoom:
    """A painted room."""

    shape: BareShape
    surface: Scene | Mesh
    """With its reflectance."""
    factors: FormFactors
    paints: tuple[ChosenPaint, ...]
    """Of each surface."""
    openings: tuple[str, ...]
    """Names of the surfaces that are openings."""
    own_exitance: FloatArray
    """(P,) light that openings send out by themselves. [lm/m²]"""

    @property
    def areas_m2(self) -> FloatArray:
        """(S,) of the surfaces."""
        return np.asarray(np.bincount(self.shape.surface_of, self.surface.areas, len(self.shape.names)), np.float64)

    def mean(self, values: FloatArray) -> FloatArray:
        """Return (S,) means over each surface of values (P,)."""
        weighted = np.bincount(self.shape.surface_of, values * self.surface.areas, len(self.shape.names))
        return np.asarray(weighted / self.areas_m2)


def planned_room(request: PlanRequest) -> PlannedRoom:
    """Return the painted room of a request.

    Raises
    ------
    UsageError
        For a room that cannot be, an unknown scene, file, surface or paint.
    """
    try:
        shape, factors = _shape(request.room, request.opening)
    except SimulationError as error:
        raise UsageError(f"room: {error}") from error
    openings = {one.name: one for one in request.opening}
    paints = tuple(_paint_of(name, upright, openings, request) for name, upright in zip(*_named(shape), strict=True))
    _check_known(request.paint, shape)
    rho = np.array([paint.reflectance for paint in paints])[shape.surface_of]
    own = np.array([np.pi * openings[name].emits_cdm2 if name in openings else 0.0 for name in shape.names])
    return PlannedRoom(
        shape=shape,
        surface=shape.surface.with_reflectance(rho),
        factors=factors,
        paints=paints,
        openings=tuple(openings),
        own_exitance=own[shape.surface_of],
    )


def _named(shape: BareShape) -> tuple[tuple[str, ...], tuple[bool, ...]]:
    return shape.names, shape.upright


def _paint_of(name: str, upright: bool, openings: Mapping[str, Opening], request: PlanRequest) -> ChosenPaint:
    if name in openings:
        return chosen_paint(openings[name].paint, request.named_paint, f"opening {name}")
    for key in (name, "walls" if upright else name, "all"):
        if key in request.paint:
            return chosen_paint(request.paint[key], request.named_paint, f"paint.{key}")
    raise UsageError(f"paint: nothing is said of {name}; name its paint, or give paint.all")


def _check_known(paint: Mapping[str, object], shape: BareShape) -> None:
    unknown = [key for key in paint if key not in (*shape.names, "walls", "all")]
    if unknown:
        there = ", ".join(dict.fromkeys((*shape.names, "walls", "all")))
        raise UsageError(f"paint.{unknown[0]}: the room has no such surface; there are {there}")


@lru_cache(maxsize=8)
def _shape(asked: RoomShape, openings: tuple[Opening, ...]) -> tuple[BareShape, FormFactors]:
    """Shape and form factors; kept, for a search asks for the same shape again and again."""
    if asked.size_m is not None:
        shape = _box(asked, openings)
    elif asked.scene is not None:
        if asked.scene not in _SCENES:
            raise UsageError(f"room.scene: {asked.scene!r} is not known; there are {', '.join(_SCENES)}")
        shape = _by_kind(_SCENES[asked.scene](asked.patch_m))
    else:
        shape = _by_kind(_mesh(asked))
    _check_count(shape.surface.n_patches, asked)
    return shape, form_factors(shape.surface)


def _check_count(patches: int, asked: RoomShape) -> None:
    """Raise UsageError for more patches than a plan takes."""
    if patches > MOST_PATCHES:
        raise UsageError(
            f"room: {patches} patches, a plan takes {MOST_PATCHES}; give a larger room.patch_m than "
            f"{asked.patch_m:g}, or a simpler mesh (`rig simulate` computes fine ones)"
        )


def _mesh(asked: RoomShape) -> Mesh:
    path = Path(str(asked.mesh))
    file = open_mesh_file(path, MeshOptions(unit=asked.unit, up=asked.up), 0.5, silent)
    return file.mend(file.facets).mesh


def _by_kind(surface: Scene | Mesh) -> BareShape:
    """Names of a library's faces, or of a mesh's regions: floor, ceiling, walls."""
    if isinstance(surface, Scene):
        names = tuple(face.name for face in surface.faces)
        upright = tuple(abs(face.normal[2]) < UPRIGHT for face in surface.faces)
        return BareShape(surface=surface, names=names, surface_of=surface.region, upright=upright)
    up = surface.normals[:, 2]
    kind = np.where(up > UPRIGHT, 0, np.where(up < -UPRIGHT, 1, 2))
    there, surface_of = np.unique(kind, return_inverse=True)
    names = tuple(("floor", "ceiling", "walls")[k] for k in there)
    return BareShape(
        surface=surface, names=names, surface_of=surface_of, upright=tuple(name == "walls" for name in names)
    )


def _box(asked: RoomShape, openings: tuple[Opening, ...]) -> BareShape:
    x, y, z = asked.size_m or (0.0, 0.0, 0.0)
    _check_count(round(2 * (x * y + y * z + z * x) * len(asked.surfaces) / 6 / asked.patch_m**2), asked)
    bare = room(asked.size_m or (0.0, 0.0, 0.0), asked.patch_m, reflectance=0.5, faces=asked.surfaces)
    for one in openings:
        _check_opening(one, bare, openings)
    pieces: list[Face] = []
    for face in bare.faces:
        pieces += _cut(face, [one for one in openings if one.surface == face.name], asked.patch_m)
    numbered, first = [], 0
    for piece in pieces:
        numbered.append(replace(piece, first_patch=first))
        first += piece.n_patches
    scene = Scene("room", tuple(numbered), np.full(first, 0.5), convex=True)
    names = tuple(dict.fromkeys(face.name for face in numbered))
    of_face = np.array([names.index(face.name) for face in numbered])
    upright = tuple(next(abs(f.normal[2]) < UPRIGHT for f in numbered if f.name == name) for name in names)
    return BareShape(surface=scene, names=names, surface_of=of_face[scene.region], upright=upright)


def _check_opening(one: Opening, bare: Scene, openings: tuple[Opening, ...]) -> None:
    face = next((face for face in bare.faces if face.name == one.surface), None)
    if face is None:
        raise UsageError(f"opening {one.name}: the room has no {one.surface}; see room.surfaces")
    (u0, v0), (u1, v1), (width, height) = one.from_m, one.to_m, face.size_m
    if not (u0 < u1 <= width * (1 + 1e-9) and v0 < v1 <= height * (1 + 1e-9)):
        raise UsageError(
            f"opening {one.name}: from {list(one.from_m)} to {list(one.to_m)} m does not lie in {one.surface}, which "
            f"is {width:g} x {height:g} m; from_m is the lower left corner seen from inside, to_m the upper right one"
        )
    if one.name in [face.name for face in bare.faces] or [other.name for other in openings].count(one.name) > 1:
        raise UsageError(f"opening {one.name}: something else has this name; give another")
    for other in openings:
        if other is not one and other.surface == one.surface and _overlap(one, other):
            raise UsageError(f"opening {one.name}: overlaps opening {other.name}; move one")


def _overlap(one: Opening, other: Opening) -> bool:
    return all(one.from_m[k] < other.to_m[k] and other.from_m[k] < one.to_m[k] for k in (0, 1))


def _cut(face: Face, openings: Iterable[Opening], patch_m: float) -> list[Face]:
    """A face cut into rectangles, each wholly within or beside every opening."""
    width, height = face.size_m
    pieces = [(0.0, 0.0, width, height, face.name)]
    for one in openings:
        pieces = [part for piece in pieces for part in _split(piece, one)]
    if len(pieces) == 1 and pieces[0][4] == face.name:
        return [face]
    return [_part(face, piece, patch_m) for piece in pieces]


Piece = tuple[float, float, float, float, str]


def _split(piece: Piece, one: Opening) -> list[Piece]:
    """What is left, right, below and above of an opening, and its part in the piece."""
    left, low, right, high, name = piece
    (u0, v0), (u1, v1) = one.from_m, one.to_m
    u0, u1, v0, v1 = max(u0, left), min(u1, right), max(v0, low), min(v1, high)
    if u0 >= u1 or v0 >= v1:
        return [piece]
    parts = [
        (left, low, u0, high, name),
        (u1, low, right, high, name),
        (u0, low, u1, v0, name),
        (u0, v1, u1, high, name),
        (u0, v0, u1, v1, one.name),
    ]
    return [part for part in parts if part[2] - part[0] > 1e-9 and part[3] - part[1] > 1e-9]


def _part(face: Face, piece: Piece, patch_m: float) -> Face:
    left, low, right, high, name = piece
    u, v, _ = face.axes
    return Face(
        name=name,
        origin_m=face.origin_m + left * u + low * v,
        edge_u_m=(right - left) * u,
        edge_v_m=(high - low) * v,
        rows=max(1, round((high - low) / patch_m)),
        columns=max(1, round((right - left) / patch_m)),
        first_patch=0,
    )


class ImpossiblePlace(UsageError):
    """A place or an aim that a projector or viewer cannot have in this room."""


def check_inside(surface: Surface, point_m: tuple[float, float, float], what: str) -> None:
    """Raise ImpossiblePlace for a point that is not in the room's air: the surface is met from behind, or touched.

    Parameters
    ----------
    surface
        The room.
    point_m
        [m]
    what
        Whose place it is, in the message.
    """
    if not stands_in_air(surface, point_m):
        low, high = surface.vertices.min(axis=(0, 1)), surface.vertices.max(axis=(0, 1))
        room_m = " x ".join(f"{a:g} ... {b:g}" for a, b in zip(low, high, strict=True))
        place = ", ".join(f"{one:g}" for one in point_m)
        raise ImpossiblePlace(
            f"{what}: ({place}) m is not in the air of the room: it is in or behind a wall, or outside; the room is "
            f"{room_m} m; move it inside"
        )
