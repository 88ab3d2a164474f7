"""Openings in the walls of a measured room: niches, doorways, recessed windows, behind which something is seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from calibration.geometry.room import FACES
from calibration.surfaces.bodies import rim_of, sides_between
from rig.records import Record
from rig.stages.surface.walls import WallPatches, points_on
from sim.geometry.mesh import Mesh
from sim.geometry.rays import trace

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.intp]

_BEHIND = 5e-3
"""Of the room's largest size, from which on what lies behind a wall's plane is no error of the wall."""
_SAMPLES = 3
"""Along each side of a patch, through which the devices look."""
_MOSTLY = 0.5
"""Of a patch's samples: with more that open on something behind, the patch is not there."""
_TOUCHING = 0.01
"""Of the room's size, between two parts that meet: pixels at their edges are left out."""
_SEEN_EVERY, _FEW = 0.005, 2
"""Of the room's size, between points that a side must not hide, and how many it may: about a pixel of a camera with 320
columns each. Triangles are ten times as large: of odd room 1022 sides hid 140 pixels between their middles."""
_EITHER_WAY = 0.5**0.5
"""Of a depth that a length may have in it or not, as likely, what it is off by (root mean square), from either."""
_SHY = 1e-3
"""Of its distance, by which what hides a point is nearer."""


@dataclass(frozen=True, kw_only=True)
class SeenBehind(Record):
    """A wall behind whose plane something is seen."""

    face: str
    depth_m: float
    """Of what is seen there, at the median triangle. [m]"""


def behind_walls(corners_m: FloatArray, size_m: Sequence[float]) -> BoolArray:
    """Return (T,) which triangles (T, 3, 3) lie behind the walls of a room of that size."""
    return np.asarray((_depths_m(corners_m, size_m) > _BEHIND * max(size_m)).any(axis=1))


def seen_behind(corners_m: FloatArray, size_m: Sequence[float]) -> tuple[SeenBehind, ...]:
    """Return the walls of a room behind which triangles (T, 3, 3) lie."""
    depths_m = _depths_m(corners_m, size_m)
    behind = depths_m > _BEHIND * max(size_m)
    return tuple(
        SeenBehind(face=face, depth_m=float(np.median(depths_m[behind[:, k], k])))
        for k, face in enumerate(FACES)
        if behind[:, k].any()
    )


def left_open(behind: Sequence[SeenBehind], seen: Sequence[str]) -> tuple[SeenBehind, ...]:
    """Return the openings whose depth the room's size may hold: nobody saw the wall opposite, which it places."""
    return tuple(one for one in behind if one.face in seen and opposite(one.face) not in seen)


def opposite(face: str) -> str:
    """Return the face on the other side of the room."""
    return FACES[FACES.index(face) ^ 1]  # faces come in pairs


def sigmas_with_openings(sigmas: Mapping[str, float], openings: Sequence[SeenBehind]) -> dict[str, float]:
    """Return standard deviations of lengths and places where openings leave open to where the room's size counts.

    Parameters
    ----------
    sigmas : mapping of name to standard deviation
        By the names of :class:`rig.stages.geometry.GeometryRecord`. [m]
    openings
        What :func:`left_open` gives.
    """
    found = dict(sigmas)
    for one in openings:
        axis, is_far = divmod(FACES.index(one.face), 2)
        # Places count from the wall that nobody saw where the one with the opening is the far one.
        for name in ("room", *(("camera", "projector") if is_far else ())):
            key = f"{name}_{'xyz'[axis]}_m"
            if key in found:
                found[key] = float(np.hypot(found[key], _EITHER_WAY * one.depth_m))
    return found


def _depths_m(corners_m: FloatArray, size_m: Sequence[float]) -> FloatArray:
    """(T, 6) how far behind the plane of each of `FACES` a triangle's middle lies. [m]."""
    middle = corners_m.mean(axis=1)
    return np.stack([-middle, middle - np.array(size_m)], axis=2).reshape(len(middle), 6)


def on_the_way(points_m: FloatArray, size_m: Sequence[float], position_m: FloatArray) -> FloatArray:
    """Return (N, 3) where the rays from a device in a room to points (N, 3) behind its walls leave it. [m]."""
    ahead = points_m - position_m
    bound = np.where(ahead > 0, np.array(size_m), 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(ahead == 0, np.inf, (bound - position_m) / ahead).min(axis=1)
    return np.asarray(position_m + np.clip(share, 0.0, 1.0)[:, None] * ahead)


def with_openings(walls: WallPatches, behind_m: FloatArray, devices_m: Sequence[FloatArray]) -> WallPatches:
    """Return the patches of a room's walls without those through which a device sees, or lights, something behind.

    Parameters
    ----------
    walls : WallPatches
        Fine enough about the openings.
    behind_m : (T, 3, 3) array
        Triangles behind the walls. [m]
    devices_m : sequence of (3,) arrays
        Positions of the devices. [m]

    Returns
    -------
    WallPatches
    """
    behind, samples = _mesh(behind_m[:, [0, 1, 2, 2]]), _samples(walls.vertices_m)
    opens = np.zeros(samples.shape[:2], dtype=bool)
    for position_m in devices_m:
        hits = trace(behind, position_m, _towards(position_m, samples.reshape(-1, 3)))
        opens |= (hits.face >= 0).reshape(opens.shape)
    return walls.only(opens.mean(axis=1) <= _MOSTLY)


def sides_of_openings(
    vertices_m: FloatArray,
    behind: IntArray,
    part: IntArray,
    *,
    size_m: Sequence[float],
    devices_m: Sequence[FloatArray],
) -> tuple[FloatArray, IntArray]:
    """Return what closes the gap between walls and what is seen through their openings, which nobody saw.

    From each side of the rim it runs straight to the wall, or else along the rays of a device: as it hides nothing of
    what any device sees, or lights, there. Where all of these would, the gap stays open. Where two parts meet, as the
    back and a side of a niche do, there is none.

    Parameters
    ----------
    vertices_m : (V, 3) array
        Corners of what was measured. [m]
    behind : (T, 3) array
        Corners of each triangle behind the walls.
    part : (T,) array
        Part of surface of each.
    size_m : (3,)
        Of the room. [m]
    devices_m : sequence of (3,) arrays
        Positions of the devices. [m]

    Returns
    -------
    (S, 4, 3) array
        Triangles that face the room; the last corner comes twice. [m]
    (S,) array
        The triangle behind the walls that each belongs to.
    """
    ends = [_straight_to_wall(vertices_m, size_m)]
    ends += [on_the_way(vertices_m, size_m, position_m) for position_m in devices_m]
    seen = {one: points_on(vertices_m, behind[part == one], _SEEN_EVERY * max(size_m)) for one in np.unique(part)}
    looked_at = np.concatenate([np.zeros((0, 3)), *seen.values()])
    found, owners = [np.zeros((0, 4, 3))], [np.zeros(0, dtype=np.intp)]
    closed = _joints(vertices_m, behind, part, seen=seen, near_m=_TOUCHING * max(size_m))
    for at_wall in ends:
        sides, owner, rim = sides_between(vertices_m, at_wall, behind)
        hides = np.zeros(len(sides), dtype=bool)
        for position_m in devices_m if len(sides) else ():
            hides |= _hides(sides, position_m, looked_at)
        taken = ~np.isin(rim, rim[hides]) & ~closed[rim]
        closed[rim[taken]] = True
        found.append(sides[taken])
        owners.append(owner[taken])
    return np.concatenate(found), np.concatenate(owners)


def _joints(
    vertices_m: FloatArray, triangles: IntArray, part: IntArray, *, seen: Mapping[int, FloatArray], near_m: float
) -> BoolArray:
    """(R,) sides of the rim that lie on another part of surface, to within so much; seen: points all over each part."""
    rim, owner = rim_of(triangles)
    middle, of_part = vertices_m[rim].mean(axis=1), part[owner]
    found = np.zeros(len(rim), dtype=bool)
    for one in seen if len(seen) > 1 else ():
        others = np.concatenate([points_m for other, points_m in seen.items() if other != one])
        found[of_part == one] = KDTree(others).query(middle[of_part == one])[0] < near_m
    return found


def _straight_to_wall(vertices_m: FloatArray, size_m: Sequence[float]) -> FloatArray:
    """(V, 3) where corners (V, 3) come to the wall behind which they lie furthest, and to no other.

    What lies a little below the floor, too, would else end on the line between wall and floor, and run to and fro on
    it: sides that look two ways, of which no mesh is made (odd room 1007 was refused for them).
    """
    every, axis = np.arange(len(vertices_m)), _depths_m(vertices_m[:, None], size_m).argmax(axis=1) // 2
    ends = vertices_m.copy()
    ends[every, axis] = np.clip(vertices_m[every, axis], 0.0, np.array(size_m)[axis])
    return ends


def _hides(sides_m: FloatArray, position_m: FloatArray, points_m: FloatArray) -> BoolArray:
    """(S,) triangles (S, 4, 3) that stand between a device and more than a few of the points (N, 3)."""
    hits = trace(_mesh(sides_m), position_m, _towards(position_m, points_m))
    nearer = hits.distance < (1 - _SHY) * np.linalg.norm(points_m - position_m, axis=1)
    return np.asarray(np.bincount(hits.face[nearer], minlength=len(sides_m)) > _FEW)


def _towards(position_m: FloatArray, points_m: FloatArray) -> FloatArray:
    ahead = points_m - position_m
    return np.asarray(ahead / np.linalg.norm(ahead, axis=-1, keepdims=True))


def _mesh(corners_m: FloatArray) -> Mesh:
    """Each of (T, 4, 3) quadrilaterals a region of its own."""
    count = len(corners_m)
    return Mesh(name="behind the walls", vertices=corners_m, reflectance=np.full(count, 0.5), region=np.arange(count))


def _samples(vertices_m: FloatArray) -> FloatArray:
    """(P, N, 3) points all over rectangles (P, 4, 3). [m]."""
    share = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    s, t = (each.ravel()[None, :, None] for each in np.meshgrid(share, share))
    a, b, _, d = (corner[:, None] for corner in np.moveaxis(vertices_m, 1, 0))
    return np.asarray(a + s * (b - a) + t * (d - a))
