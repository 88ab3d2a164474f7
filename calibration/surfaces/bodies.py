"""Where the backs of things may be that nobody saw: a guess, which the light has to bear out."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from calibration.arrays import BoolArray, FloatArray, IntArray
from calibration.geometry.room import RoomBox

_CLOSE = 1e-3
"""Of the room's size, between a back and its front, or the wall behind it: rays have to tell them apart."""
_TOUCHING = 0.01
"""Of the room's size: corners of two sides of a box are a few millimetres apart, two things a hand's breadth."""
_LEAST_WIDE = 0.2
"""Of a front, what its back has at least of its width and height: a point is no surface."""
_NO_AREA_M2 = 1e-6
"""Of a side between front and back: one that runs straight away from the devices has none."""
_UPRIGHT = 0.5
"""Of a normal, its upward share at most: walls, screens and sides of boxes stand, tops lie."""
_STANDS = 0.02
"""Of the room's size, between the floor and the lowest corner of what stands on it: pixels at its edge are left out."""


def guesses_of_backs(
    vertices_m: FloatArray, triangles: IntArray, part: IntArray, *, flat: BoolArray, box: RoomBox
) -> list[FloatArray]:
    """Return where backs may be: of bodies as deep as wide, of fronts that stand on the floor, too, and of all fronts.

    Columns, vases and boxes are about as deep as they are wide. An upright flat part that touches no other is a screen,
    or the one side of a column that is seen: light has to tell, of those that stand, as columns do, apart from those
    that hang. One that lies is a table's top, and stays thin.

    Parameters
    ----------
    vertices_m : (V, 3)
        Corners of the fronts, in the room. [m]
    triangles : (T, 3) int
        Corners of each triangle.
    part : (T,) int
        Part of surface that each belongs to.
    flat : (K,) bool
        Parts that are planes.
    box : RoomBox
        The room, and the devices in it.

    Returns
    -------
    list of (V, 3)
        Corners of the backs, a guess each; none where all are tops. [m]
    """
    thing = things_of(vertices_m, triangles, part, n_parts=len(flat), touching_m=_TOUCHING * max(box.size_m))[part]
    bodies: set[int] = set()
    stand: set[int] = set()
    hang: set[int] = set()
    highest_m = _STANDS * max(box.size_m)
    for one in np.unique(thing):
        mine = thing == one
        if len(np.unique(part[mine])) > 1 or not flat[part[mine]].all():
            bodies.add(int(one))
        elif _is_upright(vertices_m[triangles[mine]]):
            (stand if vertices_m[triangles[mine], 2].min() < highest_m else hang).add(int(one))
    guesses = dict.fromkeys(frozenset(some) for some in (bodies, bodies | stand, bodies | stand | hang) if some)
    return [as_deep_as_wide(vertices_m, triangles, thing, deep=deep, box=box) for deep in guesses]


def as_deep_as_wide(
    vertices_m: FloatArray, triangles: IntArray, thing: IntArray, *, deep: Collection[int], box: RoomBox
) -> FloatArray:
    """Let some things reach as far back from their nearest point as they are wide, or to the next wall.

    What they hide from both devices lies behind them, away from the middle between the two: no part of a back may be
    where a device looks past the front.

    Parameters
    ----------
    vertices_m : (V, 3)
        Corners of the fronts, in the room. [m]
    triangles : (T, 3) int
        Corners of each triangle.
    thing : (T,) int
        That each belongs to.
    deep
        Of the things, those that go on; the backs of others stay close behind.
    box : RoomBox
        The room, and the devices in it.

    Returns
    -------
    (V, 3)
        Corners of the backs. [m]
    """
    behind = vertices_m.copy()
    devices_m = np.stack([box.camera.position_m, box.projector.position_m])
    close_m = _CLOSE * max(box.size_m)
    for one in np.unique(thing):
        mine = np.unique(triangles[thing == one])
        front_m = vertices_m[mine]
        away = front_m.mean(axis=0) - devices_m.mean(axis=0)
        away[2] = 0.0
        away /= max(float(np.linalg.norm(away)), float(np.finfo(np.float64).tiny))
        # Along the view, across it, and upwards.
        axes = np.stack([away, (-away[1], away[0], 0.0), (0.0, 0.0, 1.0)])
        wide_m = float(np.ptp(front_m @ axes[1])) if one in deep else 0.0
        most_m = np.maximum(_to_wall_m(front_m, away, box) - close_m, close_m)
        depth_m = np.stack([np.full_like(most_m, close_m), most_m])
        behind[mine] = _hidden_behind(front_m @ axes.T, devices_m @ axes.T, wide_m, depth_m) @ axes
    return behind


def _hidden_behind(front_m: FloatArray, devices_m: FloatArray, reach_m: float, depth_m: FloatArray) -> FloatArray:
    """(N, 3) corners of a back along, across and up, behind a front (N, 3) that reaches so far from its nearest point.

    How far each may be behind its own corner, least and most, is `depth_m` (2, N). A ray from a device (2, 3) to a
    place t of the front's distance behind it passes the front where it does; a back is as much narrower as that asks.
    """
    nearest_m = float(front_m[:, 0].min())
    distance_m = np.maximum(nearest_m - devices_m[:, 0], depth_m[0, 0])
    behind_m = np.clip(nearest_m + reach_m - front_m[:, 0], *depth_m)
    found = front_m + behind_m[:, None] * (1.0, 0.0, 0.0)
    beyond = behind_m[:, None] / distance_m
    for axis in (1, 2):
        low, high = front_m[:, axis].min(), front_m[:, axis].max()
        ends = np.stack([low + beyond * (low - devices_m[:, axis]), high + beyond * (high - devices_m[:, axis])])
        first, last = np.maximum(ends[0].max(axis=1), low), np.minimum(ends[1].min(axis=1), high)
        least = _LEAST_WIDE * (high - low) / 2
        middle = (first + last) / 2
        first, last = np.minimum(first, middle - least), np.maximum(last, middle + least)
        found[:, axis] = first + (front_m[:, axis] - low) / max(high - low, depth_m[0, 0]) * (last - first)
    return np.asarray(found)


def things_of(
    vertices_m: FloatArray, triangles: IntArray, part: IntArray, *, n_parts: int, touching_m: float
) -> IntArray:
    """(K,) number of the thing that each part belongs to: parts with corners so near to each other are of one."""
    of_corner, corners = np.repeat(part, 3), vertices_m[triangles].reshape(-1, 3)
    pairs = cKDTree(corners).query_pairs(touching_m, output_type="ndarray")
    a, b = of_corner[pairs].T
    touch = coo_array((np.ones(len(a)), (a, b)), shape=(n_parts, n_parts))
    return np.asarray(connected_components(touch, directed=False)[1])


def rim_of(triangles: IntArray) -> tuple[IntArray, IntArray]:
    """Return (E, 2) sides that no two triangles share, as their own triangle goes around, and (E,) that triangle."""
    sides = np.concatenate([triangles[:, [k, (k + 1) % 3]] for k in range(3)])
    low, high = np.sort(sides, axis=1).T
    _, first, count = np.unique(low * (int(sides.max(initial=0)) + 1) + high, return_index=True, return_counts=True)
    alone = np.sort(first[count == 1])
    return sides[alone], alone % len(triangles)


def sides_between(
    vertices_m: FloatArray, others_m: FloatArray, triangles: IntArray
) -> tuple[FloatArray, IntArray, IntArray]:
    """Return what lies between the rims of a surface and of the same surface moved.

    Parameters
    ----------
    vertices_m, others_m : (V, 3)
        Corners of the surface, and where each is moved. [m]
    triangles : (T, 3) int
        Corners of each triangle of the surface.

    Returns
    -------
    (S, 4, 3)
        Triangles whose last corner comes twice; they face outwards where the other lies behind the surface. [m]
    (S,)
        The surface's triangle that each belongs to.
    (S,)
        The side of the rim that each belongs to: two of most.
    """
    rim, owner = rim_of(triangles)
    (a, b), (c, d) = (corners[rim].swapaxes(0, 1) for corners in (vertices_m, others_m))
    sides = np.concatenate([np.stack([b, a, c, c], axis=1), np.stack([b, c, d, d], axis=1)])
    double_m2 = np.linalg.norm(np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0]), axis=1)
    wide = double_m2 > _NO_AREA_M2
    number = np.arange(len(rim))
    return sides[wide], np.concatenate([owner, owner])[wide], np.concatenate([number, number])[wide]


def _is_upright(corners_m: FloatArray) -> bool:
    """Whether triangles (T, 3, 3) stand rather than lie."""
    a, b, c = corners_m.swapaxes(0, 1)
    normal = np.cross(b - a, c - a).sum(axis=0)
    return bool(abs(normal[2]) < _UPRIGHT * np.linalg.norm(normal))


def _to_wall_m(points_m: FloatArray, away: FloatArray, box: RoomBox) -> FloatArray:
    """(N,) distance of points (N, 3) from the walls along a direction."""
    size_m = np.array(box.size_m)
    with np.errstate(divide="ignore", invalid="ignore"):
        along = np.where(away > 0, (size_m - points_m) / away, np.where(away < 0, -points_m / away, np.inf))
    return np.asarray(along.min(axis=1))
