"""Flat parts that the border of what is seen cuts, carried on to where nothing contradicts them."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from calibration.arrays import BoolArray, FloatArray, IntArray
from calibration.geometry.pinhole import PinholeModel, pixels_in, project, values_seen
from calibration.geometry.room import RoomBox
from calibration.surfaces.flat_parts import Parts
from calibration.surfaces.point_map import PointMap

_SAMPLES = 5
"""Along each side of a cell of a plane, to ask what it is."""
_BEHIND = 1e-3
"""Of the room's size, by which what is carried on lies behind the part: a cell may reach under its rim."""
_FARTHER = 0.01
"""Of the distance, from which on what a pixel sees lies behind a point: so much less is an error of either."""
_MOST_AGAINST, _MOST_SEEN, _LEAST_INSIDE = 0.2, 0.6, 0.2
"""Of a cell's samples: with more that is seen through, or seen, or with less in the room, it is not carried on."""
_FROM_DEVICES_M = 0.3
"""Nearer to a lens nothing stands."""
_LEAST_AREA = 1e-3
"""Of a cell: what the walls leave of it has to be more."""
_NOTHING, _SEEN, _OPEN = 0, 1, 2


@dataclass(frozen=True, eq=False, kw_only=True)
class Continued:
    """Triangles that nobody saw."""

    vertices_m: FloatArray
    """(V, 3)"""
    triangles: IntArray
    """(T, 3) corners, counter-clockwise seen from the camera."""
    part: IntArray
    """(T,) the flat part that each carries on."""


def continued(points: PointMap, parts: Parts, box: RoomBox, cell_m: float) -> Continued:
    """Carry flat parts on, in their planes, to the walls.

    A cell of a plane is carried on if it hangs together with what is seen of the part, and neither lens looks through
    it at something behind. What the camera would see in the projector's light, and does not, is not there; what hides
    behind something else is left as it is.

    Parameters
    ----------
    points : PointMap
        Of all that was decoded.
    parts : Parts
        Of what stands in the room.
    box : RoomBox
        The room, and the devices in it.
    cell_m : float
        Side of a cell. [m]

    Returns
    -------
    Continued
        Nothing where all parts end at edges.
    """
    through = _ThroughLenses.of(points, box)
    vertices, triangles, part = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    count = 0
    for number in np.flatnonzero(parts.flat):
        plane = _PlaneCells.of(parts.planes[number], box, cell_m)
        for corners in plane.cut(_carried_on(plane.kinds(through, parts.label == number))):
            vertices.append(corners)
            triangles.append(count + _fan(len(corners)))
            part.append(np.full(len(corners) - 2, number, dtype=np.int64))
            count += len(corners)
    return Continued(
        vertices_m=np.concatenate(vertices), triangles=np.concatenate(triangles), part=np.concatenate(part)
    )


def _fan(n: int) -> IntArray:
    """(n - 2, 3) triangles of a convex polygon."""
    return np.stack([np.zeros(n - 2, dtype=np.int64), np.arange(1, n - 1), np.arange(2, n)], axis=1)


def _carried_on(kind: IntArray) -> BoolArray:
    """(rows, columns) open cells that hang together with a seen one."""
    label = cv2.connectedComponents((kind != _NOTHING).astype(np.uint8), connectivity=4)[1]
    return np.asarray((kind == _OPEN) & np.isin(label, np.unique(label[kind == _SEEN])))


@dataclass(frozen=True, eq=False)
class _ThroughLenses:
    """How far camera and projector are known to look."""

    camera: PinholeModel
    projector: PinholeModel
    seen_m: FloatArray
    """(H, W) distance of what each camera pixel sees; NaN where it was not decoded."""
    lit_m: FloatArray
    """(height, width) distance of what each projector pixel is seen to light; NaN where the camera sees none."""

    @classmethod
    def of(cls, points: PointMap, box: RoomBox) -> _ThroughLenses:
        camera, projector = box.camera, box.projector
        known = points.known
        places = points.origin_m + points.distance_m[known][:, None] * points.rays[known]
        lit = np.full((projector.height_px, projector.width_px), np.nan)
        inside, at = pixels_in(project(projector, places), lit.shape)
        lit[at] = np.linalg.norm(places - projector.position_m, axis=1)[inside]
        return cls(camera, projector, points.distance_m, lit)

    def deny(self, places_m: FloatArray) -> BoolArray:
        """(N,) places that a lens looks through, or is in; and those that would be seen and are not, or are hidden."""
        seen_m, lit_m = (
            values_seen(self.seen_m, self.camera, places_m),
            values_seen(self.lit_m, self.projector, places_m),
        )
        against = np.isfinite(seen_m) | (_is_in(self.camera, places_m) & _is_in(self.projector, places_m))
        for lens, there in ((self.camera, seen_m), (self.projector, lit_m)):
            distance = np.linalg.norm(places_m - lens.position_m, axis=1)
            against |= (distance < _FROM_DEVICES_M) | (np.nan_to_num(there) > (1 + _FARTHER) * distance)
        return against


def _is_in(lens: PinholeModel, places_m: FloatArray) -> BoolArray:
    """(N,) places that a lens has in its picture."""
    return np.isfinite(values_seen(np.ones((lens.height_px, lens.width_px)), lens, places_m))


@dataclass(frozen=True, eq=False, kw_only=True)
class _PlaneCells:
    """A plane within a room, in square cells."""

    corner_m: FloatArray
    """(3,) of the first cell."""
    u: FloatArray
    v: FloatArray
    """Unit vectors in the plane; u x v looks to the camera."""
    shape: tuple[int, int]
    cell_m: float
    size_m: FloatArray
    """(3,) of the room."""

    @classmethod
    def of(cls, plane: FloatArray, box: RoomBox, cell_m: float) -> _PlaneCells:
        """Of n, n · (x - camera) = 1, over all of the room."""
        normal, size = -plane / np.linalg.norm(plane), np.array(box.size_m)
        up = np.array([0.0, 0.0, 1.0]) if abs(normal[2]) < np.sqrt(0.5) else np.array([1.0, 0.0, 0.0])
        u = np.cross(up, normal)
        u /= np.linalg.norm(u)
        v = np.cross(normal, u)
        foot = box.camera.position_m + plane / (plane @ plane) - _BEHIND * size.max() * normal
        corners = np.array(np.meshgrid(*[(0.0, side) for side in size])).reshape(3, -1).T - foot
        low, high = (np.array([pick(corners @ axis) for axis in (u, v)]) for pick in (np.min, np.max))
        columns, rows = np.ceil((high - low) / cell_m).astype(int).tolist()
        corner_m = foot + low[0] * u + low[1] * v
        return cls(corner_m=corner_m, u=u, v=v, shape=(rows, columns), cell_m=cell_m, size_m=size)

    def kinds(self, through: _ThroughLenses, seen: BoolArray) -> IntArray:
        """(rows, columns) whether a cell is seen by the pixels of its part, open, or nothing."""
        rows, columns = self.shape
        share = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
        y = (np.arange(rows)[:, None] + share).ravel() * self.cell_m
        x = (np.arange(columns)[:, None] + share).ravel() * self.cell_m
        places = (self.corner_m + y[:, None, None] * self.v + x[None, :, None] * self.u).reshape(-1, 3)
        inside: BoolArray = np.asarray(((places > 0) & (places < self.size_m)).all(axis=1))
        is_seen: BoolArray = np.asarray(values_seen(seen.astype(np.float64), through.camera, places) > 0)
        asked = (inside, is_seen, through.deny(places) & ~is_seen)
        within, of_part, against = (_shares(np.asarray(inside & one), self.shape) for one in asked)
        within = np.maximum(within, np.finfo(float).tiny)
        is_open = (of_part <= _MOST_SEEN * within) & (against <= _MOST_AGAINST * within) & (within >= _LEAST_INSIDE)
        return np.where(is_open, _OPEN, np.where(of_part > 0.5 * within, _SEEN, _NOTHING))

    def cut(self, chosen: BoolArray) -> list[FloatArray]:
        """Convex polygons (n, 3) of chosen cells within the room."""
        found = []
        for row, column in np.argwhere(chosen):
            square = np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) + np.array([column, row])
            corners = self.corner_m + self.cell_m * (square[:, :1] * self.u + square[:, 1:] * self.v)
            polygon = _within(corners, self.size_m)
            if len(polygon) >= 3 and _area(polygon) > _LEAST_AREA * self.cell_m**2:
                found.append(polygon)
        return found


def _shares(samples: BoolArray, shape: tuple[int, int]) -> FloatArray:
    """(rows, columns) means over the samples of each cell."""
    rows, columns = shape
    return np.asarray(samples.reshape(rows, _SAMPLES, columns, _SAMPLES).mean(axis=(1, 3)))


def _within(polygon: FloatArray, size_m: FloatArray) -> FloatArray:
    """The part of a convex polygon (n, 3) that lies in a room, by Sutherland and Hodgman 1974."""
    for axis in range(3):
        for sign, limit in ((1.0, 0.0), (-1.0, -size_m[axis])):
            kept: list[FloatArray] = []
            height = sign * polygon[:, axis] - limit if len(polygon) else np.zeros(0)
            for k in range(len(polygon)):
                here, there = polygon[k - 1], polygon[k]
                if (height[k - 1] > 0) != (height[k] > 0):
                    kept.append(here + height[k - 1] / (height[k - 1] - height[k]) * (there - here))
                if height[k] > 0:
                    kept.append(there)
            polygon = np.array(kept).reshape(-1, 3)
    return polygon


def _area(polygon: FloatArray) -> float:
    sides = polygon[1:] - polygon[0]
    return float(np.linalg.norm(np.cross(sides[:-1], sides[1:]).sum(axis=0)) / 2)
