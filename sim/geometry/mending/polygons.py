"""Polygons of any number of corners cut into triangles: concave ones, with corners on a line, holes by a slit.

Ears are clipped (Meisters 1975): a corner that turns left, with no other corner in its triangle, is cut off, the one
with the shortest cut first. Which side of a line a point lies on is decided in floating point where its error bound
allows it (Shewchuk 1997, orient2d), else in exact fractions. All triangles that are cut are turned the same way, and
areas add up to the polygon's, so that they cover what the polygon goes round, once, and nothing else.

Polygons of as many corners are cut together: each step takes one corner off each of them. One that turns right
somewhere, or has a corner within a straight edge, is cut by itself, for what lies in its ears has to be looked at.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import ArrayLike

from sim.arrays import BoolArray, FloatArray, IntArray

FILTER = 3.3306690738754716e-16
"""(3 + 16 u) u with u = 2^-53: Shewchuk's bound of the error of a 2 x 2 determinant over the sum of its terms."""
ON_A_LINE = 1e-7
"""Width over length up to which a polygon without area is a line; a wider one is crossed by itself."""
BENT = 0.01
"""Distance of a corner from the middle plane, over the longest extent, above which a polygon is no surface."""
CROSSED = "its edges cross each other"


@dataclass(frozen=True, eq=False)
class CutPolygon:
    """A polygon in triangles, or why it is not."""

    triangles: IntArray
    """(T, 3) places in the polygon, turned as it is; none where it has a fault or is a line."""
    fault: str = ""


@dataclass(frozen=True, eq=False)
class CutPolygons:
    """Polygons of as many corners each in triangles, or why they are not."""

    triangles: IntArray
    """(T, 3) places in the polygon, turned as it is; none of one that has a fault or is a line."""
    polygon: IntArray
    """(T,) which one each is of, ascending."""
    faults: dict[int, str]
    """What is wrong with a polygon."""


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
    cut = cut_polygons(np.asarray(corners_m, dtype=np.float64)[np.newaxis])
    return CutPolygon(cut.triangles, cut.faults.get(0, ""))


def cut_polygons(corners_m: ArrayLike) -> CutPolygons:
    """Cut polygons of as many corners each into triangles.

    Parameters
    ----------
    corners_m : (M, N, 3) array
        Each as :func:`cut_polygon` takes it. [m]

    Returns
    -------
    CutPolygons
        With a fault for each that is NaN or infinite, not flat within 1 % of its size, or crosses itself.
    """
    corners = np.asarray(corners_m, dtype=np.float64)
    finite: BoolArray = np.asarray(np.isfinite(corners).all(axis=(1, 2)))
    faults = dict.fromkeys(np.flatnonzero(~finite).tolist(), "a corner is NaN or infinite")
    corners = np.where(finite[:, np.newaxis, np.newaxis], corners, 0.0)
    # In its own size, so that no square of a coordinate is beyond what numbers can be.
    unit_m = np.abs(corners).max(axis=(1, 2), initial=0.0)
    unit_m[unit_m == 0] = 1.0
    corners = corners / unit_m[:, np.newaxis, np.newaxis]
    relative = corners - corners.mean(axis=1, keepdims=True)
    normal = np.cross(relative, np.roll(relative, -1, axis=1)).sum(axis=1)
    size = np.ptp(corners, axis=1).max(axis=1, initial=0.0)
    length = np.linalg.norm(normal, axis=1)
    has_area = length > 1e-14 * size**2
    for i in np.flatnonzero(finite & ~has_area):
        if not _is_line(relative[i]):
            faults[int(i)] = CROSSED
    off = np.abs(np.einsum("mnk,mk->mn", relative, normal)).max(axis=1, initial=0.0) / np.where(has_area, length, 1.0)
    bent = has_area & (off > BENT * size)
    for i in np.flatnonzero(bent):
        limit_m = BENT * size[i] * unit_m[i]
        faults[int(i)] = f"corners lie {off[i] * unit_m[i]:.3g} m off its plane, limit {limit_m:.3g} m"
    flat = np.flatnonzero(has_area & ~bent)
    triangles, polygon, crossed = _all_clipped(_dropped(corners[flat], normal[flat]))
    faults |= dict.fromkeys(flat[crossed].tolist(), CROSSED)
    return CutPolygons(triangles, flat[polygon], faults)


def _is_line(relative: FloatArray) -> bool:
    """Whether corners (N, 3) about their middle lie on a line."""
    widths = np.linalg.svd(relative, compute_uv=False)
    return len(relative) < 3 or bool(widths[1] <= ON_A_LINE * widths[0])


def _dropped(corners: FloatArray, normal: FloatArray) -> FloatArray:
    """(M, N, 2) polygons that go round to the left: of (M, N, 3), the coordinate along the normal (M, 3) is dropped."""
    # Dropping a coordinate keeps the others exactly as they are.
    drop = np.abs(normal).argmax(axis=1)
    kept = np.stack([(drop + 1) % 3, (drop + 2) % 3], axis=1)
    flat = np.take_along_axis(corners, kept[:, np.newaxis], axis=2)
    flat[:, :, 0] *= np.where(normal[np.arange(len(drop)), drop] > 0, 1, -1)[:, np.newaxis]
    return np.asarray(flat)


def _all_clipped(points: FloatArray) -> tuple[IntArray, IntArray, IntArray]:
    """(T, 3) places in polygons (M, N, 2) that go round to the left, (T,) whose, and which ones have no ear left."""
    found, whose, alone = _convex_clipped(points)
    crossed = []
    for i in alone:
        own = _ears_clipped(points[i])
        if own is None:
            crossed.append(i)
        else:
            found.append(own)
            whose.append(np.full(len(own), i))
    polygon = np.concatenate(whose) if whose else np.zeros(0, dtype=np.intp)
    order = np.argsort(polygon, kind="stable")
    triangles = np.concatenate(found) if found else np.zeros((0, 3), dtype=np.intp)
    return triangles[order], polygon[order], np.array(crossed, dtype=np.intp)


def _convex_clipped(points: FloatArray) -> tuple[list[IntArray], list[IntArray], IntArray]:
    """Triangles of polygons (M, N, 2) that only turn left, as ears are clipped; whose; and the other polygons."""
    count, n = points.shape[:2]
    rows, ring = np.arange(count), np.tile(np.arange(n), (count, 1))
    found, whose, alone = [], [], np.zeros(count, dtype=bool)
    while ring.shape[1] >= 3 and len(rows):
        here = points[rows[:, np.newaxis], ring]
        before, after = np.roll(here, 1, axis=1), np.roll(here, -1, axis=1)
        turn = _side(*(x.reshape(-1, 2) for x in (before, here, after))).reshape(ring.shape)
        spikes = (turn == 0) & (((here - before) * (here - after)).sum(axis=2) >= 0)
        spiked = spikes.any(axis=1)
        gone = np.where(spiked, spikes.argmax(axis=1), ((before - after) ** 2).sum(axis=2).argmin(axis=1))
        cut = ~spiked & (turn > 0).all(axis=1)
        at = np.arange(len(rows))
        ears = np.stack([ring[at, (gone + k) % ring.shape[1]] for k in (-1, 0, 1)], axis=1)
        found.append(ears[cut])
        whose.append(rows[cut])
        alone[rows[~spiked & ~cut]] = True
        left = np.arange(ring.shape[1]) != gone[:, np.newaxis]
        ring = ring[left].reshape(len(rows), -1)[spiked | cut]
        rows = rows[spiked | cut]
    # What was begun together and turned out to be none of these begins anew.
    kept = [~alone[rows] for rows in whose]
    found = [triangles[keep] for triangles, keep in zip(found, kept, strict=True)]
    whose = [rows[keep] for rows, keep in zip(whose, kept, strict=True)]
    return found, whose, np.flatnonzero(alone)


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
    # A difference is exactly 0 only of equal numbers: corners that come twice and edges along an axis need no more.
    zero = ((a[:, 0] == c[:, 0]) | (b[:, 1] == c[:, 1])) & ((a[:, 1] == c[:, 1]) | (b[:, 0] == c[:, 0]))
    zero |= (a == b).all(axis=1)
    for i in np.flatnonzero(~zero & (np.abs(result) <= FILTER * (np.abs(one) + np.abs(other)))):
        (ax, ay), (bx, by), (cx, cy) = ([Fraction(float(x)) for x in point] for point in (a[i], b[i], c[i]))
        exact = (ax - cx) * (by - cy) - (ay - cy) * (bx - cx)
        result[i] = (exact > 0) - (exact < 0)
    return result
