"""The nearest place on a mesh, on the side that a camera looks at."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from calibration.arrays import BoolArray, FloatArray, IntArray

_SAMPLES = 40_000
"""Points by which triangles are found: a hundredth of a mesh's size apart and less."""
_CANDIDATES = 8
"""Samples whose triangles are looked at: about a corner as many meet."""
_EDGE_ON = 0.02
"""Cosine between ray and normal below which a side is not seen."""


@dataclass(frozen=True, eq=False)
class NearestOnMesh:
    """Nearest places of N points."""

    triangle: IntArray
    """(N,) on which each lies."""
    place_m: FloatArray
    """(N, 3)"""
    facing: BoolArray
    """(N,) whether its lit side looks towards the camera."""


@dataclass(frozen=True, eq=False)
class SampledMesh:
    """Triangles with points all over them."""

    triangles_m: FloatArray
    """(T, 3, 3) corners, counter-clockwise seen from the lit side. [m]"""

    @cached_property
    def normals(self) -> FloatArray:
        """(T, 3) unit normals; 0 of a triangle without area."""
        a, b, c = np.moveaxis(self.triangles_m, 1, 0)
        doubled = np.cross(b - a, c - a)
        return np.asarray(doubled / np.maximum(np.linalg.norm(doubled, axis=1, keepdims=True), np.finfo(float).tiny))

    @cached_property
    def size_m(self) -> float:
        """Diagonal of its bounding box."""
        corners = self.triangles_m.reshape(-1, 3)
        return float(np.linalg.norm(np.ptp(corners, axis=0)))

    @cached_property
    def samples(self) -> tuple[FloatArray, IntArray]:
        """(S, 3) points spread evenly by area, at least one a triangle, and (S,) the triangle of each."""
        a, b, c = np.moveaxis(self.triangles_m, 1, 0)
        area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        count = 1 + np.floor(_SAMPLES * area / max(area.sum(), np.finfo(float).tiny)).astype(np.intp)
        triangle = np.repeat(np.arange(len(count)), count)
        within = np.arange(len(triangle)) - np.repeat(np.cumsum(count) - count, count)
        # Golden ratios spread points evenly over a square (Roberts 2018, the R2 sequence).
        u, v = (within * 0.7548776662466927 + 0.5) % 1, (within * 0.5698402909980532 + 0.5) % 1
        beyond = u + v > 1
        u, v = np.where(beyond, 1 - u, u)[:, None], np.where(beyond, 1 - v, v)[:, None]
        return a[triangle] + u * (b - a)[triangle] + v * (c - a)[triangle], triangle

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.samples[0])

    def nearest(self, points_m: FloatArray, rays: FloatArray) -> NearestOnMesh:
        """Return the nearest place of each point, on a side that its ray meets where there is one near.

        Parameters
        ----------
        points_m : (N, 3)
            In the mesh's frame. [m]
        rays : (N, 3)
            Unit directions from the camera.
        """
        found = self.samples[1][self._tree.query(points_m, k=min(_CANDIDATES, len(self.samples[1])))[1]]
        candidate = found.reshape(len(points_m), -1)
        places = nearest_on_triangles(points_m[:, None], self.triangles_m[candidate])
        facing = np.einsum("nkc,nc->nk", self.normals[candidate], rays) < -_EDGE_ON
        distance = np.linalg.norm(places - points_m[:, None], axis=2)
        best = np.where(facing, distance, distance + 10 * self.size_m).argmin(axis=1)
        one = np.arange(len(points_m))
        return NearestOnMesh(candidate[one, best], places[one, best], facing[one, best])


def nearest_on_triangles(points: FloatArray, triangles: FloatArray) -> FloatArray:
    """Return (…, 3) the nearest places on triangles (…, 3, 3) of points that broadcast to (…, 3).

    References
    ----------
    C. Ericson, Real-Time Collision Detection, 2005, section 5.1.5.
    """
    a, b, c = (triangles[..., k, :] for k in range(3))
    ab, ac = b - a, c - a
    d1, d2 = _dot(ab, points - a), _dot(ac, points - a)
    d3, d4 = _dot(ab, points - b), _dot(ac, points - b)
    d5, d6 = _dot(ab, points - c), _dot(ac, points - c)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    total = va + vb + vc
    inner = a + _over(vb, total)[..., None] * ab + _over(vc, total)[..., None] * ac
    on_ab = a + _over(d1, d1 - d3)[..., None] * ab
    on_ac = a + _over(d2, d2 - d6)[..., None] * ac
    on_bc = b + _over(d4 - d3, (d4 - d3) + (d5 - d6))[..., None] * (c - b)
    cases = [
        ((d1 <= 0) & (d2 <= 0), a),
        ((d3 >= 0) & (d4 <= d3), b),
        ((vc <= 0) & (d1 >= 0) & (d3 <= 0), on_ab),
        ((d6 >= 0) & (d5 <= d6), c),
        ((vb <= 0) & (d2 >= 0) & (d6 <= 0), on_ac),
        ((va <= 0) & (d4 - d3 >= 0) & (d5 - d6 >= 0), on_bc),
    ]
    return np.asarray(np.select([case[..., None] for case, _ in cases], [place for _, place in cases], inner))


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray((a * b).sum(axis=-1))


def _over(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.divide(a, b, out=np.zeros(np.broadcast_shapes(a.shape, b.shape)), where=np.abs(b) > 0)
