"""Scenes that no gridded rectangles can make: a room under a sloped ceiling, spheres."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sim.arrays import FloatArray
from sim.errors import SimulationError
from sim.geometry.mesh import Mesh

ROOM_M = (4.8, 4.8, 2.4)
HIGH_SIDE_M = 3.2
"""Height of the sloped room's wall at the largest x."""


def sloped_room(patch_size_m: float = 0.4, rotation: ArrayLike | None = None, reflectance: float = 0.7) -> Mesh:
    """Return the paper's room under a ceiling that climbs from 2.4 m at x = 0 to 3.2 m at x = 4.8 m.

    The walls at both ends of y are trapezoids; patches of all faces meet corner to corner. 576 patches at 0.4 m.

    Parameters
    ----------
    patch_size_m : float
        Wanted patch size along the floor and the lowest wall; counts are rounded, at least 1. [m]
    rotation : (3, 3) array, optional
        Turns the whole room.
    reflectance : float
        Of all faces, in [0, 1].

    Returns
    -------
    Mesh

    Raises
    ------
    SimulationError
        For a patch size not above 0 or a matrix that is no rotation.
    """
    if not 0 < patch_size_m < np.inf:
        raise SimulationError(f"patch size {patch_size_m} m; it must be above 0 and finite")
    turn = _checked_rotation(rotation)
    x, y, z = ROOM_M
    low = np.array([[0, 0, 0], [x, 0, 0], [x, y, 0], [0, y, 0]])
    high = low + np.array([[0, 0, z], [0, 0, HIGH_SIDE_M], [0, 0, HIGH_SIDE_M], [0, 0, z]])
    along = max(1, round(x / patch_size_m))
    up = max(1, round(z / patch_size_m))
    walls = [grid_of_quad([low[b], low[a], high[a], high[b]], along, up) for a, b in ((0, 1), (1, 2), (2, 3), (3, 0))]
    grids = [grid_of_quad(low, along, along), grid_of_quad(high[::-1], along, along), *walls]
    region = np.repeat(np.arange(len(grids)), [len(grid) for grid in grids])
    vertices = np.concatenate(grids) @ turn.T
    shares = np.full(len(vertices), float(reflectance))
    return Mesh(name="sloped-room", vertices=vertices, reflectance=shares, convex=True, closed=True, region=region)


def grid_of_quad(corners: ArrayLike, columns: int, rows: int) -> FloatArray:
    """Return (rows * columns, 4, 3) patches of a flat quad, its sides in equal parts; columns along the first side."""
    a, b, c, d = np.asarray(corners, dtype=np.float64)
    u, v = (axis[..., None] for axis in np.meshgrid(np.arange(columns + 1) / columns, np.arange(rows + 1) / rows))
    points = (1 - u) * (1 - v) * a + u * (1 - v) * b + u * v * c + (1 - u) * v * d
    patches = np.stack([points[:-1, :-1], points[:-1, 1:], points[1:, 1:], points[1:, :-1]], axis=2)
    return np.asarray(patches.reshape(-1, 4, 3))


def integrating_sphere(subdivisions: int = 2, radius_m: float = 1.0, reflectance: float = 0.9) -> Mesh:
    """Return a sphere seen from inside: an icosahedron's triangles, each cut into four `subdivisions` times.

    The corners lie on the sphere; the flat triangles see a little more of their neighbours the finer they are:
    F_ij goes to A_j / (4 pi R²).

    Raises
    ------
    SimulationError
        For fewer than 0 or more than 7 subdivisions, or a radius not above 0.
    """
    if not (0 <= subdivisions <= 7 and 0 < radius_m < np.inf):
        raise SimulationError(f"sphere of radius {radius_m} m, {subdivisions} subdivisions; above 0 m and 0 ... 7")
    inside = radius_m * icosphere(subdivisions)[:, [0, 2, 1, 1]]
    shares = np.full(len(inside), float(reflectance))
    region = np.arange(len(inside))
    return Mesh(name="integrating-sphere", vertices=inside, reflectance=shares, convex=True, closed=True, region=region)


def icosphere(subdivisions: int) -> FloatArray:
    """Return (20 * 4^subdivisions, 3, 3) triangles of the unit sphere, counter-clockwise seen from outside."""
    triangles = _icosahedron()
    for _ in range(subdivisions):
        a, b, c = np.moveaxis(triangles, 1, 0)
        ab, bc, ca = (_unit(p + q) for p, q in ((a, b), (b, c), (c, a)))
        quarters = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
        triangles = np.concatenate([np.stack(quarter, axis=1) for quarter in quarters])
    return triangles


def _checked_rotation(rotation: ArrayLike | None) -> FloatArray:
    turn = np.eye(3) if rotation is None else np.asarray(rotation, dtype=np.float64)
    if turn.shape != (3, 3) or np.abs(turn @ turn.T - np.eye(3)).max() > 1e-9 or np.linalg.det(turn) < 0:
        raise SimulationError(f"no rotation: {turn.tolist()}; give an orthonormal 3 x 3 matrix of determinant 1")
    return turn


def _unit(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def _icosahedron() -> FloatArray:
    """(20, 3, 3) triangles of unit vectors, counter-clockwise seen from outside."""
    golden = (1 + 5**0.5) / 2
    cyclic = [np.roll([0, one, other], shift) for shift in range(3) for one in (-1, 1) for other in (-golden, golden)]
    corners = _unit(np.array(cyclic))
    near = np.isclose(corners @ corners.T, 1 / 5**0.5)
    faces = []
    for a in range(12):
        for b in range(a + 1, 12):
            for c in range(b + 1, 12):
                if near[a, b] and near[b, c] and near[a, c]:
                    outward = np.linalg.det(corners[[a, b, c]]) > 0
                    faces.append(corners[[a, b, c] if outward else [a, c, b]])
    return np.array(faces)
