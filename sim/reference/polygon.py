"""Form factors of polygons by point-to-polygon factors in plain numpy, independent of the contour integral."""

from __future__ import annotations

import numpy as np

from sim.arrays import FloatArray


def point_to_polygon(points: FloatArray, normals: FloatArray, polygon: FloatArray) -> FloatArray:
    """Return (N,) exact factors from points with a normal to a flat polygon (Lambert 1760).

    F = 1/(2 pi) sum over edges of the angle under which an edge is seen times the cosine between the point's
    normal and that of the plane through point and edge. What lies below a point's horizon is cut off.

    Parameters
    ----------
    points, normals : (N, 3) array
        Places [m] and unit normals.
    polygon : (M, 3) array
        Convex, counter-clockwise seen from its lit side, which looks at the points [m].
    """
    corners = polygon - points[:, None]
    heights = np.einsum("nmk,nk->nm", corners, normals)
    total = np.zeros(len(points))
    leaves, enters = np.zeros_like(points), np.zeros_like(points)
    for k in range(len(polygon)):
        after = (k + 1) % len(polygon)
        begin, end = _above(corners[:, k], corners[:, after], heights[:, k], heights[:, after])
        total += _edge_share(begin, end, normals)
        down = (heights[:, k] >= 0) & (heights[:, after] < 0)
        up = (heights[:, k] < 0) & (heights[:, after] >= 0)
        leaves[down], enters[up] = end[down], begin[up]
    return np.asarray(total + _edge_share(leaves, enters, normals))


def _above(
    begin: FloatArray, end: FloatArray, height_begin: FloatArray, height_end: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(N, 3) ends of the part of a segment above the horizon; both the same where there is none."""
    drop = height_begin - height_end
    share = np.where(drop == 0, 0.0, height_begin / np.where(drop == 0, 1.0, drop))[:, None]
    horizon = begin + share * (end - begin)
    below_begin, below_end = (height_begin < 0)[:, None], (height_end < 0)[:, None]
    new_begin = np.where(below_begin, np.where(below_end, end, horizon), begin)
    return new_begin, np.where(below_end & ~below_begin, horizon, end)


def _edge_share(begin: FloatArray, end: FloatArray, normals: FloatArray) -> FloatArray:
    across = np.cross(end, begin)
    length = np.linalg.norm(across, axis=1)
    angle = np.arctan2(length, (begin * end).sum(axis=1))
    cosine = (across * normals).sum(axis=1) / np.where(length > 0, length, 1.0)
    return np.asarray(angle * cosine / (2 * np.pi))


def exchange_area(first: FloatArray, second: FloatArray, order: int) -> float:
    """Return A F of two convex polygons by n x n Gauss points on the first and exact factors to the second [m²].

    Slow, and independent of the contour integral; its error falls like n^-4 where the two touch.

    Parameters
    ----------
    first, second : (M, 3) array
        Corners, counter-clockwise seen from the lit side [m].
    order : int
        Points along each side of every triangle that the first is cut into.
    """
    before = _cut(first, _normal(second), second[0])
    normal, nodes, weights = _normal(first), *np.polynomial.legendre.leggauss(order)
    u, v = (axis.ravel() for axis in np.meshgrid((nodes + 1) / 2, (nodes + 1) / 2))
    weight = np.outer(weights, weights).ravel() / 4
    total = 0.0
    for k in range(1, len(before) - 1):
        a, b, c = before[0], before[k], before[k + 1]
        points = a + v[:, None] * ((1 - u)[:, None] * (b - a) + u[:, None] * (c - a))
        density = weight * v * np.linalg.norm(np.cross(b - a, c - a))
        total += float(density @ point_to_polygon(points, np.tile(normal, (len(points), 1)), second))
    return total


def _normal(polygon: FloatArray) -> FloatArray:
    vector = np.cross(polygon[1:-1] - polygon[0], polygon[2:] - polygon[0]).sum(axis=0)
    return np.asarray(vector / np.linalg.norm(vector))


def _cut(polygon: FloatArray, normal: FloatArray, point: FloatArray) -> FloatArray:
    """Corners of the part of a convex polygon before a plane (Sutherland & Hodgman)."""
    heights = (polygon - point) @ normal
    kept = []
    for k in range(len(polygon)):
        if heights[k - 1] * heights[k] < 0:
            share = heights[k - 1] / (heights[k - 1] - heights[k])
            kept.append(polygon[k - 1] + share * (polygon[k] - polygon[k - 1]))
        if heights[k] >= 0:
            kept.append(polygon[k])
    return np.array(kept).reshape(-1, 3)
