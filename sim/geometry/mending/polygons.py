"""Polygons of any number of corners cut into triangles: concave ones, with corners on a line, holes by a slit.

Ears are clipped (Meisters 1975): a corner that turns left, with no other corner in its triangle, is cut off, the one
with the shortest cut first. Which side of a line a point lies on is decided in floating point where its error bound
allows it (Shewchuk 1997, orient2d), else in exact fractions. All triangles that are cut are turned the same way, and
areas add up to the polygon's, so that they cover what the polygon goes round, once, and nothing else.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import ArrayLike

from sim.arrays import FloatArray, IntArray

FILTER = 3.3306690738754716e-16
"""(3 + 16 u) u with u = 2^-53: Shewchuk's bound of the error of a 2 x 2 determinant over the sum of its terms."""
ON_A_LINE = 1e-7
"""Width over length up to which a polygon without area is a line; a wider one is crossed by itself."""
BENT = 0.01
"""Distance of a corner from the middle plane, over the longest extent, above which a polygon is no surface."""


@dataclass(frozen=True, eq=False)
class CutPolygon:
    """A polygon in triangles, or why it is not."""

    triangles: IntArray
    """(T, 3) places in the polygon, turned as it is; none where it has a fault or is a line."""
    fault: str = ""


def cut_polygon(corners_m: ArrayLike) -> CutPolygon:
    """Cut a polygon into triangles.

    Parameters
    ----------
    corners_m : (N, 3) array
        In order; a hole is joined to the outline by a slit that is walked both ways. [m]

    Returns
    -------
    CutPolygon
        With a fault if corners lie further off a plane than 1 % of the polygon's size, or edges cross.
    """
    corners = np.asarray(corners_m, dtype=np.float64)
    none = np.zeros((0, 3), dtype=np.intp)
    if not np.isfinite(corners).all():
        return CutPolygon(none, "a corner is NaN or infinite")
    # In its own size, so that no square of a coordinate is beyond what numbers can be.
    unit_m = float(np.abs(corners).max(initial=0.0)) or 1.0
    corners = corners / unit_m
    relative = corners - corners.mean(axis=0)
    normal = np.cross(relative, np.roll(relative, -1, axis=0)).sum(axis=0)
    size = float(np.ptp(corners, axis=0).max(initial=0))
    length = float(np.linalg.norm(normal))
    if length <= 1e-14 * size**2:
        widths = np.linalg.svd(relative, compute_uv=False)
        on_a_line = len(corners) < 3 or widths[1] <= ON_A_LINE * widths[0]
        return CutPolygon(none, "" if on_a_line else "its edges cross each other")
    off = float(np.abs(relative @ normal).max() / length)
    if off > BENT * size:
        return CutPolygon(none, f"corners lie {off * unit_m:.3g} m off its plane, limit {BENT * size * unit_m:.3g} m")
    # Dropping a coordinate keeps the others exactly as they are.
    drop = int(np.abs(normal).argmax())
    flat = corners[:, [(drop + 1) % 3, (drop + 2) % 3]]
    triangles = _ears_clipped(flat if normal[drop] > 0 else flat * (-1, 1))
    return CutPolygon(none, "its edges cross each other") if triangles is None else CutPolygon(triangles)


def _ears_clipped(points: FloatArray) -> IntArray | None:
    """(T, 3) places in points (N, 2) that go round to the left; None where no ear is left before the end."""
    ring = np.arange(len(points))
    found = []
    while len(ring) >= 3:
        here, before, after = points[ring], points[np.roll(ring, 1)], points[np.roll(ring, -1)]
        turn = _side(before, here, after)
        spikes = (turn == 0) & (((here - before) * (here - after)).sum(axis=1) >= 0)
        if spikes.any():
            # A corner that comes twice, or a way there and back: no area.
            ring = np.delete(ring, int(spikes.argmax()))
            continue
        if not (turn != 0).any():
            break
        left = np.flatnonzero(turn > 0)
        order = left[np.argsort(((before - after)[left] ** 2).sum(axis=1), kind="stable")]
        blocking = here[turn <= 0]
        ear = next((int(k) for k in order if not _holds_one(before[k], here[k], after[k], blocking)), None)
        if ear is None:
            return None
        found.append((ring[ear - 1], ring[ear], ring[(ear + 1) % len(ring)]))
        ring = np.delete(ring, ear)
    return np.array(found, dtype=np.intp).reshape(-1, 3)


def _holds_one(a: FloatArray, b: FloatArray, c: FloatArray, points: FloatArray) -> bool:
    """Whether a triangle that goes round to the left has one of the points in it or on it, its own corners apart."""
    low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    near = points[((points >= low) & (points <= high)).all(axis=1)]
    near = near[~np.any([(near == corner).all(axis=1) for corner in (a, b, c)], axis=0)]
    inside = np.ones(len(near), dtype=bool)
    for start, end in ((a, b), (b, c), (c, a)):
        inside &= _side(np.broadcast_to(start, near.shape), np.broadcast_to(end, near.shape), near) >= 0
    return bool(inside.any())


def _side(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """(N,) above 0 where a, b, c (N, 2) turn left, below 0 where right, exactly 0 on one line."""
    one = (a[:, 0] - c[:, 0]) * (b[:, 1] - c[:, 1])
    other = (a[:, 1] - c[:, 1]) * (b[:, 0] - c[:, 0])
    result = one - other
    for i in np.flatnonzero(np.abs(result) <= FILTER * (np.abs(one) + np.abs(other))):
        (ax, ay), (bx, by), (cx, cy) = ([Fraction(float(x)) for x in point] for point in (a[i], b[i], c[i]))
        exact = (ax - cx) * (by - cy) - (ay - cy) * (bx - cx)
        result[i] = (exact > 0) - (exact < 0)
    return result
