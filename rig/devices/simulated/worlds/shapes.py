"""Shapes of triangles, (T, 3, 3) corners in metres; corners run counter-clockwise as seen from outside or above."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Point = tuple[float, float, float]


def room(size_m: Point) -> Mapping[str, FloatArray]:
    """Return the six walls of a room from the origin, by name, seen from inside."""
    x, y, z = size_m
    return {
        "floor": quad((0, 0, 0), (x, 0, 0), (0, y, 0)),
        "ceiling": quad((0, 0, z), (0, y, 0), (x, 0, 0)),
        "x0": quad((0, 0, 0), (0, y, 0), (0, 0, z)),
        "x1": quad((x, 0, 0), (0, 0, z), (0, y, 0)),
        "y0": quad((0, 0, 0), (0, 0, z), (x, 0, 0)),
        "y1": quad((0, y, 0), (x, 0, 0), (0, 0, z)),
    }


def quad(corner_m: Point, first_m: Point, second_m: Point) -> FloatArray:
    """Return a parallelogram of a corner and two edges; its normal is along their cross product."""
    a, u, v = (np.asarray(one, dtype=float) for one in (corner_m, first_m, second_m))
    return np.array([[a, a + u, a + u + v], [a, a + u + v, a + v]])


def block(centre_m: tuple[float, float], size_m: Point, *, bottom_m: float = 0.0, turn_deg: float = 0.0) -> FloatArray:
    """Return an upright box, turned about its middle; without a bottom where it stands on the floor."""
    x, y, z = size_m
    walls = [
        quad((0, 0, z), (x, 0, 0), (0, y, 0)),
        quad((0, 0, 0), (x, 0, 0), (0, 0, z)),
        quad((0, y, 0), (0, 0, z), (x, 0, 0)),
        quad((0, 0, 0), (0, 0, z), (0, y, 0)),
        quad((x, 0, 0), (0, y, 0), (0, 0, z)),
    ]
    if bottom_m > 0:
        walls.append(quad((0, 0, 0), (0, y, 0), (x, 0, 0)))
    about_axis = moved(np.concatenate(walls), (-x / 2, -y / 2, 0))
    return moved(turned(about_axis, turn_deg), (*centre_m, bottom_m))


def turned(triangles_m: FloatArray, turn_deg: float) -> FloatArray:
    """Return triangles turned about the vertical axis through the origin."""
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    return np.asarray(triangles_m @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]))


def moved(triangles_m: FloatArray, way_m: Point) -> FloatArray:
    """Return triangles elsewhere."""
    return np.asarray(triangles_m + np.array(way_m))


def sheet(place: Callable[[FloatArray, FloatArray], FloatArray], u: FloatArray, v: FloatArray) -> FloatArray:
    """Return a curved surface of triangles over a grid of two parameters.

    Parameters
    ----------
    place
        Of arrays of u and v, (n, m) each, the points (n, m, 3).
    u, v
        Grid lines; quads that shrink to a line at an edge leave one triangle.
    """
    points = place(*np.meshgrid(u, v, indexing="ij"))
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    triangles = np.concatenate([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)]).reshape(-1, 3, 3)
    area = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    return np.asarray(triangles[area > 1e-9])
