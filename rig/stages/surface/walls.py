"""The walls of a measured room in patches that are finer where something stands, and beside lit edges between walls.

Light changes from one side of a thing to the other, and a patch that reaches under it is neither; beside an edge most
of it comes from what is near on the other wall.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from calibration.geometry.pinhole import PinholeModel, pixels_seen
from calibration.geometry.room import FACES
from sim.geometry.scene import Scene

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

_FINEST = 0.125
"""Of a patch's size, where something touches a wall. In the simulated `l-room` what global light of white leaves
unexplained falls from 6.9 % to 2.5 % with it."""
_FINEST_AT_EDGES = 0.4
"""The same beside edges between walls: patches of 0.8 and more are halved there, once. A quarter instead took a third
more off what compensated pictures are off there, for twice as many patches more."""
_NEAR = 0.35
"""Of its own size, within which a patch that has something before it is cut: then none that is touched stays large, and
neighbours differ by about a factor of two."""
_MOST_PATCHES = 2500
"""Of walls: where so much stands that there would be more, the finest are twice as large."""
_NEIGHBOURS = 8
"""Points about a patch's middle, among which the nearest to the patch is looked for."""


@dataclass(frozen=True, eq=False)
class WallPatches:
    """Rectangles of a room's walls."""

    vertices_m: FloatArray
    """(P, 4, 3) corners, wall after wall."""
    region: IntArray
    """(P,) number of each one's wall."""

    def only(self, chosen: NDArray[np.bool_]) -> WallPatches:
        """Return some of them."""
        return WallPatches(self.vertices_m[chosen], self.region[chosen])

    def wall_after_wall(self) -> WallPatches:
        """Return them in the order of their walls."""
        order = np.argsort(self.region, kind="stable")
        return WallPatches(self.vertices_m[order], self.region[order])


def finer_where(walls: Scene, points_m: FloatArray, most: int = _MOST_PATCHES) -> WallPatches:
    """Return a room's walls in patches that are the finer, the nearer something stands.

    Parameters
    ----------
    walls : Scene
        In even patches, along the axes.
    points_m : (N, 3) array
        On what stands, about as near to each other as the finest patches are wide. [m]
    most : int
        Patches that there may be; rather than more, the finest are larger.

    Returns
    -------
    WallPatches
    """
    even = WallPatches(walls.vertices, walls.region)
    if not len(points_m):
        return even
    tree, size_m = KDTree(points_m), float(_sizes(even.vertices_m).max())
    finest = _FINEST
    while True:
        found = _cut(even, tree, finest * size_m)
        if len(found.region) <= max(most, len(even.region)):
            return found.wall_after_wall()
        finest *= 2


def finer_along(walls: Scene, patches: WallPatches, edges_m: FloatArray, most: int = _MOST_PATCHES) -> WallPatches:
    """Return patches that are half as large beside edges, unless that makes too many.

    Parameters
    ----------
    walls : Scene
        In even patches, along the axes.
    patches : WallPatches
        What :func:`finer_where` has made of them.
    edges_m : (N, 3) array
        Points along the edges, of :func:`seen_edges`. [m]
    most : int
        Patches that there may be.

    Returns
    -------
    WallPatches
    """
    if not len(edges_m):
        return patches
    found = _cut(patches, KDTree(edges_m), _FINEST_AT_EDGES * float(_sizes(walls.vertices).max()))
    return found.wall_after_wall() if len(found.region) <= most else patches


def seen_edges(
    size_m: Sequence[float], faces: Sequence[str], devices: Sequence[PinholeModel], spacing_m: float
) -> FloatArray:
    """Return points along the edges between a room's walls that lie in the pictures of all devices.

    Parameters
    ----------
    size_m : (3,)
        Of the room. [m]
    faces : sequence of str
        Those of ``FACES`` that there are.
    devices : sequence of PinholeModel
    spacing_m : float
        Between points, at most. [m]

    Returns
    -------
    (N, 3) array
        [m]
    """
    found = [np.zeros((0, 3))]
    for axis, beside in enumerate(((1, 2), (0, 2), (0, 1))):
        along = np.linspace(0, size_m[axis], 1 + int(np.ceil(size_m[axis] / spacing_m)))
        for ends in product((0, 1), repeat=2):
            if all(FACES[2 * other + end] in faces for other, end in zip(beside, ends, strict=True)):
                points = np.zeros((len(along), 3))
                points[:, axis] = along
                points[:, beside] = [size_m[other] * end for other, end in zip(beside, ends, strict=True)]
                found.append(points)
    points = np.concatenate(found)
    seen = [pixels_seen(device, points, (device.height_px, device.width_px))[0] for device in devices]
    return points[np.all(seen, axis=0)]


def finest_m(walls: Scene) -> float:
    """Return how small the patches of a room's walls may become. [m]."""
    return _FINEST * float(_sizes(walls.vertices).max())


def _cut(patches: WallPatches, tree: KDTree, finest_m: float) -> WallPatches:
    """Quarter patches that something stands near, until they are as small as wanted."""
    done: list[WallPatches] = []
    while len(patches.region):
        size = _sizes(patches.vertices_m)
        cut = (size >= 2 * finest_m * (1 - 1e-6)) & (_distance_m(patches.vertices_m, tree) < _NEAR * size)
        done.append(patches.only(~cut))
        patches = _quarters(patches.only(cut))
    vertices, region = zip(*((one.vertices_m, one.region) for one in done), strict=True)
    return WallPatches(np.concatenate(vertices), np.concatenate(region))


def _sizes(vertices_m: FloatArray) -> FloatArray:
    """(P,) longest side. [m]."""
    return np.asarray(np.ptp(vertices_m, axis=1).max(axis=1))


def _distance_m(vertices_m: FloatArray, tree: KDTree) -> FloatArray:
    """(P,) from rectangles along the axes to the nearest of the points. [m]."""
    middle, half = vertices_m.mean(axis=1), np.ptp(vertices_m, axis=1) / 2
    _, index = tree.query(middle, k=min(_NEIGHBOURS, tree.n))
    near = tree.data[index.reshape(len(middle), -1)]
    beyond = np.maximum(np.abs(near - middle[:, None]) - half[:, None], 0.0)
    return np.asarray(np.linalg.norm(beyond, axis=2).min(axis=1))


def _quarters(patches: WallPatches) -> WallPatches:
    a, b, c, d = np.moveaxis(patches.vertices_m, 1, 0)
    ab, bc, cd, da, middle = (a + b) / 2, (b + c) / 2, (c + d) / 2, (d + a) / 2, (a + c) / 2
    corners = ((a, ab, middle, da), (ab, b, bc, middle), (middle, bc, c, cd), (da, middle, cd, d))
    return WallPatches(
        np.concatenate([np.stack(each, axis=1) for each in corners]), np.tile(patches.region, len(corners))
    )


def points_on(vertices_m: FloatArray, triangles: IntArray, spacing_m: float) -> FloatArray:
    """Return (N, 3) points all over triangles, in rows no further from each other than wanted. [m]."""
    found = [np.zeros((0, 3))]
    for a, b, c in vertices_m[triangles]:
        parts = max(
            1, int(np.ceil(max(np.linalg.norm(b - a), np.linalg.norm(c - a), np.linalg.norm(c - b)) / spacing_m))
        )
        first, second = np.meshgrid(np.arange(parts + 1), np.arange(parts + 1))
        inside = first + second <= parts
        s, t = (each[inside, None] / parts for each in (first, second))
        found.append(a + s * (b - a) + t * (c - a))
    return np.concatenate(found)
