"""Triangles of a known mesh made patches of: within the room, no larger than wanted, in smooth parts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from calibration.errors import CalibrationError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

_OWN_WALL = 0.01
"""Of the room's size: what is nearer to a wall and lies along it is that wall; what stands further out is astray."""
_ALONG = 0.98
"""Cosine between normals from which on a triangle lies along a wall."""
_MOST_BEYOND = 0.5
"""Share of triangles behind walls: a file of several rooms has many, a thing in this room none."""
_LONGER = 1.5
"""Times the wanted size, from which on a side is halved: halves are then 0.75 of it and more."""
_CREASE = np.cos(np.radians(30.0))
"""Between neighbours whose normals differ by more, light does not go on smoothly."""


def within_room(
    vertices_m: FloatArray, triangles: IntArray, size_m: tuple[float, float, float], *, name: str
) -> tuple[FloatArray, IntArray]:
    """Return a mesh without triangles that are the room's walls; what stands out a little ends at the wall.

    Raises
    ------
    CalibrationError
        It stands through a wall.
    """
    limit = _OWN_WALL * max(size_m)
    a, b, c = (vertices_m[triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(float).tiny)
    is_wall = np.zeros(len(triangles), dtype=bool)
    for axis in range(3):
        for place in (0.0, size_m[axis]):
            near = (np.abs(vertices_m[triangles][:, :, axis] - place) < limit).all(axis=1)
            is_wall |= near & (np.abs(normal[:, axis]) > _ALONG)
    corners = vertices_m[triangles]
    beyond = ((corners < -limit) | (corners > np.array(size_m) + limit)).any(axis=(1, 2)) & ~is_wall
    left = triangles[~is_wall & ~beyond]
    if beyond.mean() > _MOST_BEYOND or not len(left):
        raise CalibrationError(
            f"{name}: {100 * beyond.mean():.0f} % of its triangles stand behind the room's walls, or all "
            "of it is walls; is it of another room? [surface] kind = 'free' measures what there is"
        )
    used, renamed = np.unique(left, return_inverse=True)
    return np.clip(vertices_m[used], 0.0, np.array(size_m)), renamed.reshape(-1, 3)


def outwards(vertices_m: FloatArray, triangles: IntArray) -> tuple[IntArray, NDArray[np.bool_]]:
    """Return triangles turned so that bodies are lit from outside, and (T,) which belong to open sheets.

    What hangs together is a body if every side of its triangles meets another; files of bodies turned inside out are
    common, and nobody sees a body's inside.
    """
    corners = _merged(vertices_m)[triangles]
    directed = corners[:, [[0, 1], [1, 2], [2, 0]]]
    edges = np.sort(directed.reshape(-1, 2), axis=1)
    _, number, count = np.unique(edges, axis=0, return_inverse=True, return_counts=True)
    owner = np.repeat(np.arange(len(triangles)), 3)
    first = np.zeros(len(count), dtype=np.intp)
    first[number.reshape(-1)] = owner
    graph = coo_array((np.ones(len(owner)), (owner, first[number.reshape(-1)])), shape=(len(triangles),) * 2)
    label = connected_components(graph, directed=False)[1]
    is_open = np.bincount(label, weights=(count[number.reshape(-1)].reshape(-1, 3) == 1).any(axis=1)) > 0
    a, b, c = (vertices_m[triangles[:, k]] for k in range(3))
    volume = np.bincount(label, weights=np.einsum("nc,nc->n", a, np.cross(b, c)))
    turned = (volume < 0) & ~is_open
    return np.where(turned[label][:, None], triangles[:, ::-1], triangles), np.asarray(is_open[label])


def _merged(vertices_m: FloatArray) -> IntArray:
    """(V,) one number for corners in one place, to a micrometre."""
    return np.asarray(np.unique(np.round(vertices_m, 6), axis=0, return_inverse=True)[1].reshape(-1), dtype=np.intp)


def cut_to_size(vertices_m: FloatArray, triangles: IntArray, size_m: float) -> tuple[FloatArray, IntArray]:
    """Return triangles whose sides are at most 1.5 times a size: long sides are halved, neighbours with them."""
    while True:
        edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
        length = np.linalg.norm(vertices_m[edges[:, :, 0]] - vertices_m[edges[:, :, 1]], axis=2)
        worst = length.max(axis=1)
        if not (worst > _LONGER * size_m).any():
            return vertices_m, triangles
        # Only the longest side of each triangle, so that none gets thin; a neighbour follows when its turn comes.
        longest = length.argmax(axis=1)
        one = np.arange(len(triangles))
        wanted = np.unique(edges[one, longest][worst > _LONGER * size_m], axis=0)
        vertices_m, triangles = _halved(vertices_m, triangles, wanted)


def _halved(vertices_m: FloatArray, triangles: IntArray, edges: IntArray) -> tuple[FloatArray, IntArray]:
    """The mesh with the middles of edges (E, 2) as corners; triangles at them are cut in two, edge by edge."""
    middles = vertices_m[edges].mean(axis=1)
    number = {(int(a), int(b)): len(vertices_m) + k for k, (a, b) in enumerate(edges)}
    made: list[tuple[int, int, int]] = []
    waiting = [(int(a), int(b), int(c)) for a, b, c in triangles]
    while waiting:
        a, b, c = waiting.pop()
        for p, q, r in ((a, b, c), (b, c, a), (c, a, b)):
            middle = number.get((min(p, q), max(p, q)))
            if middle is not None:
                waiting += [(p, middle, r), (middle, q, r)]
                break
        else:
            made.append((a, b, c))
    return np.concatenate([vertices_m, middles]), np.array(made, dtype=np.intp)


def smooth_parts(vertices_m: FloatArray, triangles: IntArray) -> IntArray:
    """Return (T,) number of the part of each triangle: neighbours whose normals differ by less than 30 degrees."""
    corners = _merged(vertices_m)[triangles]
    a, b, c = (vertices_m[triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(float).tiny)
    edges = np.sort(corners[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    owner = np.repeat(np.arange(len(triangles)), 3)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    same = (edges[order][1:] == edges[order][:-1]).all(axis=1)
    first, second = owner[order][:-1][same], owner[order][1:][same]
    smooth = np.einsum("nc,nc->n", normal[first], normal[second]) > _CREASE
    graph = coo_array((np.ones(int(smooth.sum())), (first[smooth], second[smooth])), shape=(len(triangles),) * 2)
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.intp)


def flat_parts(vertices_m: FloatArray, triangles: IntArray, part: IntArray) -> NDArray[np.bool_]:
    """Return (K,) parts all of whose triangles look the same way."""
    a, b, c = (vertices_m[triangles[:, k]] for k in range(3))
    doubled = np.cross(b - a, c - a)
    length = np.linalg.norm(doubled, axis=1)
    total = np.stack([np.bincount(part, weights=doubled[:, k]) for k in range(3)], axis=1)
    return np.asarray(np.linalg.norm(total, axis=1) > (1 - 1e-6) * np.bincount(part, weights=length))
