"""Exact form factors between axis-parallel rectangles (native; definition in ``sim.reference.closed_form``).

A_1 F_12 of two parallel or perpendicular rectangles is a fourfold alternating sum of one corner function of
their edge coordinates (Ehlert & Smith, J. Thermophys. Heat Transfer 7, 1993). For small patches far apart that
sum cancels: at 50 patch sizes it keeps 5 digits of a grazing pair. There Gauss rules for the two differences of
coordinates take over, so that every factor has a relative error below 1e-9.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim import _kernel
from sim.arrays import BoolArray, FloatArray
from sim.errors import SimulationError
from sim.geometry.scene import Scene
from sim.geometry.surface import Surface

ALIGNMENT_TOLERANCE = 1e-9
"""Sine of the angle up to which faces count as parallel or perpendicular."""
NEAR_AN_AXIS = 0.99
"""A patch whose normal has less along each axis is known to be none of them before its corners are looked at."""


def applies(surface: Surface) -> bool:
    """Tell if every two patches that may see each other are parallel or perpendicular rectangles."""
    if isinstance(surface, Scene) and _misaligned(surface, _facing(surface)) is None:
        return True
    return _axis_parallel(surface) is not None


def fill(surface: Surface, matrix: FloatArray, row_sums: FloatArray) -> None:
    """Fill (P, P) form factors and their (P,) row sums, occluders left out.

    Raises
    ------
    SimulationError
        If two patches that can see each other are neither parallel nor perpendicular rectangles.
    """
    if isinstance(surface, Scene):
        _fill_grids(surface, matrix, row_sums)
        return
    box = _axis_parallel(surface)
    if box is None:
        raise SimulationError(
            f"{surface.name}: its patches are not all rectangles along three axes: no closed form; use method 'polygon'"
        )
    _kernel.rectangle_exchange_areas(*box, matrix)
    _kernel.divide_rows(matrix, surface.areas, row_sums)


def _fill_grids(scene: Scene, matrix: FloatArray, row_sums: FloatArray) -> None:
    facing = _facing(scene)
    misaligned = _misaligned(scene, facing)
    if misaligned is not None:
        first, second, degrees = misaligned
        raise SimulationError(
            f"faces {first} and {second} are neither parallel nor perpendicular along their edges "
            f"(normals at {degrees:.3f} degrees): no closed form; align them, or use method 'polygon'"
        )
    frames = np.array([[face.origin_m, face.edge_u_m, face.edge_v_m, face.normal] for face in scene.faces])
    counts = np.array([[face.columns, face.rows, face.first_patch] for face in scene.faces], dtype=np.int64)
    _kernel.grid_form_factors(frames, counts, facing, factors=matrix, row_sums=row_sums)


def _facing(scene: Scene) -> BoolArray:
    """(F, F) bool: some of each face lies on the lit side of the other."""
    corners = np.stack([face.points([0, 1, 1, 0], [0, 0, 1, 1]) for face in scene.faces])
    normals = np.stack([face.normal for face in scene.faces])
    heights = (corners.reshape(-1, 3) @ normals.T).T.reshape(len(normals), -1, 4)
    heights -= (corners[:, 0] * normals).sum(axis=1)[:, None, None]
    size = np.array([max(face.size_m) for face in scene.faces])
    in_front = heights.max(axis=2) > 1e-9 * np.maximum.outer(size, size)
    return np.ascontiguousarray(in_front & in_front.T)


def _misaligned(scene: Scene, facing: BoolArray) -> tuple[str, str, float] | None:
    """Names of two faces that see each other at an angle, and the angle between their normals [degrees]."""
    axes = np.stack([face.axes for face in scene.faces])
    flat = axes.reshape(-1, 3)
    n = len(axes)
    cosines = np.abs((flat @ flat.T).reshape(n, 3, n, 3).transpose(0, 2, 1, 3))
    off = np.abs(cosines - np.round(cosines)).max(axis=(2, 3)) >= ALIGNMENT_TOLERANCE
    pairs = np.argwhere(off & facing)
    if not len(pairs):
        return None
    first, second = pairs[0]
    cosine = float(scene.faces[first].normal @ scene.faces[second].normal)
    return scene.faces[first].name, scene.faces[second].name, float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


Box = tuple[FloatArray, FloatArray, NDArray[np.int64], FloatArray]


def _axis_parallel(surface: Surface) -> Box | None:
    """(P, 3) low and high corners, (P,) normal's axis and sign in a common frame; None if there is none."""
    corners = surface.vertices
    along = corners[0, 1] - corners[0, 0]
    normal = surface.normals[0]
    u = along / np.linalg.norm(along)
    frame = np.stack([u, np.cross(normal, u), normal])
    normals = surface.normals @ frame.T
    if np.abs(normals).max(axis=1).min() < NEAR_AN_AXIS:
        return None
    corners = corners @ frame.T
    low, high = corners.min(axis=1), corners.max(axis=1)
    axis = np.abs(normals).argmax(axis=1)
    patches = np.arange(len(corners))
    size = (high - low).max(axis=1)
    flat = (high - low)[patches, axis] <= ALIGNMENT_TOLERANCE * size
    off = np.minimum(np.abs(corners - low[:, None]), np.abs(corners - high[:, None])).max(axis=(1, 2))
    area = np.prod(np.where(np.arange(3) == axis[:, None], 1.0, high - low), axis=1)
    rectangle = (off <= ALIGNMENT_TOLERANCE * size) & (np.abs(area - surface.areas) <= 1e-6 * area)
    if not (flat & rectangle).all():
        return None
    # Patches of one plane must agree on it to the last bit.
    low[patches, axis] = high[patches, axis] = (low[patches, axis] + high[patches, axis]) / 2
    sign = np.sign(normals[patches, axis])
    return np.ascontiguousarray(low), np.ascontiguousarray(high), axis.astype(np.int64), np.ascontiguousarray(sign)
