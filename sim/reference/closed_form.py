"""The closed form in plain numpy: the readable definition, and the oracle of the native one.

A_1 F_12 of two such rectangles is a fourfold alternating sum of one corner function over their edge
coordinates (Ehlert & Smith, "View factors for perpendicular and parallel rectangular plates", J. Thermophys.
Heat Transfer 7, 1993). Faces are grids, so the corner function is evaluated once on all combinations of a
face pair's grid lines and differenced along the four axes: about one evaluation a patch pair instead of
sixteen. Along an axis that both faces share with the same pitch only the coordinate differences matter, and
there are far fewer of those.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.arrays import FloatArray, IntArray
from sim.errors import SimulationError
from sim.geometry.scene import Face, Scene

ALIGNMENT_TOLERANCE = 1e-9
"""Sine of the angle up to which faces count as parallel or perpendicular."""
TINY = 1e-300


def exchange_areas(scene: Scene) -> FloatArray:
    """Return (P, P) A_i F_ij of every pair of patches, exactly symmetric [m²].

    Raises
    ------
    SimulationError
        If two faces that can see each other are neither parallel nor perpendicular along their edges.
    """
    exchange = np.zeros((scene.n_patches, scene.n_patches))
    for a, face_a in enumerate(scene.faces):
        for face_b in scene.faces[a + 1 :]:
            block = _block(face_a, face_b)
            if block is None:
                continue
            exchange[face_a.patches, face_b.patches] = block
            exchange[face_b.patches, face_a.patches] = block.T
    return exchange


@dataclass(frozen=True)
class _SharedAxis:
    """An axis that runs along both faces: the corner function needs only coordinate differences."""

    differences: FloatArray
    """(M,) distinct differences of the grid lines of a and b [m]."""
    uniform: bool
    """True if both grids have the same pitch, so that M = lines a + lines b - 1."""
    index: IntArray
    """(cells a, cells b) place of each pair of cells after :meth:`difference`."""

    def difference(self, table: FloatArray, axis: int) -> FloatArray:
        """Alternating sum over the four line pairs of each cell pair, along one axis of a table."""
        if self.uniform:
            return np.asarray(-np.diff(table, 2, axis=axis))
        cells_a, cells_b = self.index.shape
        lines = np.moveaxis(table, axis, 0).reshape(cells_a + 1, cells_b + 1, -1)
        cells = np.diff(np.diff(lines, axis=0), axis=1)
        rest = np.delete(table.shape, axis)
        return np.moveaxis(cells.reshape(cells_a * cells_b, *rest), 0, axis)


def _shared_axis(lines_a: FloatArray, lines_b: FloatArray) -> _SharedAxis:
    cells_a, cells_b = len(lines_a) - 1, len(lines_b) - 1
    # The last index of a uniform table counts a's cells up and b's (ascending) cells down.
    pitch_a, pitch_b = (float(lines[-1] - lines[0]) / (len(lines) - 1) for lines in (lines_a, lines_b))
    if abs(pitch_a - pitch_b) <= 1e-12 * abs(pitch_a):
        steps = np.arange(-cells_b, cells_a + 1)
        index = np.subtract.outer(np.arange(cells_a), np.arange(cells_b)) + cells_b - 1
        return _SharedAxis(lines_a[0] - lines_b[0] + pitch_a * steps, True, index)
    index = np.arange(cells_a * cells_b).reshape(cells_a, cells_b)
    return _SharedAxis(np.subtract.outer(lines_a, lines_b).ravel(), False, index)


def _lines(face: Face, axis: int, direction: FloatArray) -> tuple[FloatArray, bool]:
    """Ascending grid lines of an axis (0 = u, 1 = v) along a parallel direction; whether reversed."""
    count = (face.columns, face.rows)[axis]
    edge = (face.edge_u_m, face.edge_v_m)[axis]
    start, length = float(face.origin_m @ direction), float(edge @ direction)
    lines = start + length * np.arange(count + 1) / count
    return (lines[::-1], True) if length < 0 else (lines, False)


def _block(face_a: Face, face_b: Face) -> FloatArray | None:
    """(patches a, patches b) exchange areas; None where the faces cannot see each other."""
    if not (_in_front(face_a, face_b) and _in_front(face_b, face_a)):
        return None
    cosines = face_a.axes @ face_b.axes.T
    aligned = np.abs(np.abs(cosines) - np.round(np.abs(cosines))).max() < ALIGNMENT_TOLERANCE
    if not aligned:
        degrees = np.degrees(np.arccos(np.clip(cosines[2, 2], -1, 1)))
        raise SimulationError(
            f"faces {face_a.name} and {face_b.name} are neither parallel nor perpendicular along their edges "
            f"(normals at {degrees:.3f} degrees): no closed form; align them, or use method 'paper'"
        )
    cells = _parallel(face_a, face_b) if abs(cosines[2, 2]) > 0.5 else _perpendicular(face_a, face_b)
    # cells: (rows a, columns a, rows b, columns b); differences of large numbers leave roundoff below 0.
    return np.maximum(cells, 0.0).reshape(face_a.n_patches, face_b.n_patches)


def _in_front(face: Face, other: Face) -> bool:
    """Tell if some of ``other`` lies on the lit side of ``face``."""
    corners = other.points([0, 1, 1, 0], [0, 0, 1, 1])
    size = max(*face.size_m, *other.size_m)
    return bool(((corners - face.origin_m) @ face.normal).max() > 1e-9 * size)


def _parallel(face_a: Face, face_b: Face) -> FloatArray:
    gap = float(abs((face_b.origin_m - face_a.origin_m) @ face_a.normal))
    axis_b = _matching_axis(face_a.axes[0], face_b)
    shared, flips = [], []
    for axis_a, other in ((0, axis_b), (1, 1 - axis_b)):
        lines_a, _ = _lines(face_a, axis_a, face_a.axes[axis_a])
        lines_b, reverse = _lines(face_b, other, face_a.axes[axis_a])
        shared.append(_shared_axis(lines_a, lines_b))
        flips.append(reverse)
    along_u, along_v = shared
    table = _parallel_corner(along_u.differences[:, None], along_v.differences[None, :], gap)
    table = along_v.difference(along_u.difference(table, 0), 1)
    # (columns a, cells of b along u_a, rows a, cells of b along v_a)
    cells = table[along_u.index[:, :, None, None], along_v.index[None, None]]
    cells = np.flip(cells, axis=tuple(axis for axis, reverse in zip((1, 3), flips, strict=True) if reverse))
    order = (2, 0, 3, 1) if axis_b == 0 else (2, 0, 1, 3)
    return np.transpose(cells, order)


def _perpendicular(face_a: Face, face_b: Face) -> FloatArray:
    across_a = _matching_axis(face_b.normal, face_a)
    across_b = _matching_axis(face_a.normal, face_b)
    direction = face_a.axes[1 - across_a]
    lines_a, _ = _lines(face_a, 1 - across_a, direction)
    lines_b, reverse = _lines(face_b, 1 - across_b, direction)
    shared = _shared_axis(lines_a, lines_b)
    height_a, reverse_a = _heights(face_a, across_a, face_b)
    height_b, reverse_b = _heights(face_b, across_b, face_a)
    squared = np.add.outer(height_a**2, height_b**2)
    table = _perpendicular_corner(shared.differences[:, None, None], squared[None])
    table = np.diff(np.diff(shared.difference(table, 0), axis=1), axis=2)
    # (cells a along, cells b along, cells a across, cells b across)
    cells = table[shared.index]
    reversed_axes = ((1, reverse), (2, reverse_a), (3, reverse_b))
    cells = np.flip(cells, axis=tuple(axis for axis, flip in reversed_axes if flip))
    order_a = (2, 0) if across_a == 1 else (0, 2)
    order_b = (3, 1) if across_b == 1 else (1, 3)
    return np.transpose(cells, order_a + order_b)


def _matching_axis(direction: FloatArray, face: Face) -> int:
    """Which of a face's axes, 0 = u or 1 = v, runs along a direction."""
    return int(np.argmax(np.abs(face.axes[:2] @ direction)))


def _heights(face: Face, axis: int, plane: Face) -> tuple[FloatArray, bool]:
    """Heights of a face's grid lines over another's plane; what lies behind it is cut off there."""
    lines, reverse = _lines(face, axis, plane.normal)
    return np.maximum(lines - float(plane.origin_m @ plane.normal), 0.0), reverse


def _parallel_corner(x: FloatArray, y: FloatArray, gap: float) -> FloatArray:
    """Corner function [m²] of parallel rectangles from coordinate differences x, y."""
    root_x, root_y = np.sqrt(x**2 + gap**2), np.sqrt(y**2 + gap**2)
    angles = y * root_x * np.arctan(y / root_x) + x * root_y * np.arctan(x / root_y)
    # log(x² + y² + gap²) less log(gap²), which the differences drop: exact for small patches far apart.
    logarithm = np.log1p((x**2 + y**2) / gap**2)
    return np.asarray((angles - gap**2 / 2 * logarithm) / (2 * np.pi))


def _perpendicular_corner(y: FloatArray, squared: FloatArray) -> FloatArray:
    """Corner function [m²] of perpendicular rectangles.

    From the difference y along the common edge and the sum of the squared distances to the line in which the
    planes meet.
    """
    root = np.sqrt(squared)
    logarithm = np.log(np.maximum(squared + y**2, TINY))
    return np.asarray((y * root * np.arctan2(y, root) - (squared - y**2) / 4 * logarithm) / (2 * np.pi))
