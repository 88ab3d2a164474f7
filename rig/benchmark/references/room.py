"""Form factors of an empty box-shaped room in extended precision, independent of ``sim``'s kernels.

The room's patches are squares of one pitch, so a pair's exchange area depends only on a few whole numbers: the
offsets along shared axes and the heights over each other's plane. The corner function (Ehlert & Smith 1993) is
tabulated on them in ``numpy.longdouble`` (64 bits of mantissa on x86), differenced and looked up. Differences of
far pairs, nearly equal numbers, lose even these digits: those pairs take Gauss points on both patches instead.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.arrays import FloatArray, IntArray
from sim.geometry.scene import Face, Scene

LongArray = NDArray[np.longdouble]
_TAU = 8 * np.arctan(np.longdouble(1))
FAR = 8.0
"""Distance in cells from which five Gauss points along each edge leave less than 1e-12."""
GAUSS_ORDER = 5


def reference_blocks(scene: Scene, pitch_m: float) -> Iterator[tuple[slice, slice, FloatArray]]:
    """Exchange areas A_i F_ij [m²] of each pair of faces of a room of square patches, exact to 1e-11 relative.

    Yields
    ------
    (patches of one face, patches of the other, their block)
    """
    for number, face in enumerate(scene.faces):
        for other in scene.faces[number + 1 :]:
            first, second = (scene.centres[f.patches] / pitch_m for f in (face, other))
            opposite = abs(face.normal @ other.normal) > 0.5
            block = (_opposite if opposite else _adjacent)(face, other, first, second, pitch_m=pitch_m)
            yield face.patches, other.patches, block * pitch_m**2


def errors_of(matrix: FloatArray, scene: Scene, pitch_m: float) -> tuple[float, float]:
    """Largest relative error of a form factor, and the Frobenius norm of all errors over that of the matrix."""
    largest, squared, norm = 0.0, 0.0, 0.0
    for rows, columns, exchange in reference_blocks(scene, pitch_m):
        error = matrix[rows, columns] * scene.areas[rows, None] - exchange
        largest = max(largest, float(np.abs(error / exchange).max()))
        squared += float((error**2).sum())
        norm += float((exchange**2).sum())
    return largest, float(np.sqrt(squared / norm))


def _opposite(face: Face, other: Face, first: FloatArray, second: FloatArray, pitch_m: float) -> FloatArray:
    normal = _axis(face)
    u, v = (axis for axis in range(3) if axis != normal)
    gap = np.longdouble(round(abs(float((other.origin_m - face.origin_m)[normal])) / pitch_m, 9))
    offset_u, offset_v = _offsets(first, second, u), _offsets(first, second, v)
    x = np.arange(offset_u.max() + 2, dtype=np.longdouble)[:, None]
    y = np.arange(offset_v.max() + 2, dtype=np.longdouble)[None]
    cells = np.asarray(_along(_along(_opposite_corner(x, y, gap), 0), 1), dtype=np.float64)
    _replace_far(cells, (x[:-1], y[:, :-1], gap.astype(np.float64)), _opposite_gauss)
    return np.asarray(cells[offset_u, offset_v])


def _adjacent(face: Face, other: Face, first: FloatArray, second: FloatArray, pitch_m: float) -> FloatArray:
    normal, across = _axis(face), _axis(other)
    (along,) = (axis for axis in range(3) if axis not in (normal, across))
    offset = _offsets(first, second, along)
    away = _cells_from(first[:, across], other.origin_m[across] / pitch_m)
    height = _cells_from(second[:, normal], face.origin_m[normal] / pitch_m)
    y = np.arange(offset.max() + 2, dtype=np.longdouble)[:, None, None]
    lines = [np.arange(cells.max() + 2, dtype=np.longdouble) for cells in (away, height)]
    table = _adjacent_corner(y, lines[0][:, None] ** 2 + lines[1] ** 2)
    cells = np.asarray(np.diff(np.diff(_along(table, 0), axis=1), axis=2), dtype=np.float64)
    _replace_far(cells, (y[:-1], lines[0][:-1, None] + 0.5, lines[1][:-1] + 0.5), _adjacent_gauss)
    return np.asarray(cells[offset, away[:, None], height])


def _axis(face: Face) -> int:
    return int(np.argmax(np.abs(face.normal)))


def _offsets(first: FloatArray, second: FloatArray, axis: int) -> IntArray:
    return np.abs(np.rint(np.subtract.outer(first[:, axis], second[:, axis]))).astype(np.intp)


def _cells_from(centres: FloatArray, plane: float) -> IntArray:
    """Whole cells between a plane and each patch."""
    return np.rint(np.abs(centres - plane) - 0.5).astype(np.intp)


def _along(table: LongArray, axis: int) -> LongArray:
    """Alternating sum over the four line pairs of two cells, by offset; the table is even in its argument."""
    mirrored = np.concatenate([table.take([1], axis=axis), table], axis=axis)
    return np.asarray(-np.diff(mirrored, 2, axis=axis))


def _opposite_corner(x: LongArray, y: LongArray, gap: np.longdouble) -> LongArray:
    root_x, root_y = np.sqrt(x**2 + gap**2), np.sqrt(y**2 + gap**2)
    angles = y * root_x * np.arctan(y / root_x) + x * root_y * np.arctan(x / root_y)
    return np.asarray((angles - gap**2 / 2 * np.log(x**2 + y**2 + gap**2)) / _TAU)


def _adjacent_corner(y: LongArray, squared: LongArray) -> LongArray:
    root, total = np.sqrt(squared), squared + y**2
    logarithm = np.log(np.where(total > 0, total, 1))
    return np.asarray((y * root * np.arctan2(y, root) - (squared - y**2) / 4 * logarithm) / _TAU)


def _replace_far(table: FloatArray, middles: tuple[Any, Any, Any], gauss: Callable[..., FloatArray]) -> None:
    """Put Gauss sums where the patches' middles, given along three axes in cells, are far from each other."""
    along = np.broadcast_arrays(*(np.asarray(values, dtype=np.float64) for values in middles))
    far = along[0] ** 2 + along[1] ** 2 + along[2] ** 2 > FAR**2
    table[far] = gauss(*(values[far] for values in along))


def _opposite_gauss(x: FloatArray, y: FloatArray, gap: FloatArray) -> FloatArray:
    total = np.zeros_like(x)
    steps = _steps_between()
    for weight_u, u in steps:
        for weight_v, v in steps:
            total += weight_u * weight_v * gap**2 / ((x + u) ** 2 + (y + v) ** 2 + gap**2) ** 2
    return total / np.pi


def _adjacent_gauss(y: FloatArray, away: FloatArray, height: FloatArray) -> FloatArray:
    total = np.zeros_like(y)
    for weight, step in _steps_between():
        for weight_a, a in _steps():
            for weight_h, h in _steps():
                over, up = away + a, height + h
                total += weight * weight_a * weight_h * over * up / ((y + step) ** 2 + over**2 + up**2) ** 2
    return total / np.pi


def _steps() -> list[tuple[float, float]]:
    """Gauss weights and places about the middle of a cell."""
    nodes, weights = np.polynomial.legendre.leggauss(GAUSS_ORDER)
    return [(float(weight) / 2, float(node) / 2) for node, weight in zip(nodes, weights, strict=True)]


def _steps_between() -> list[tuple[float, float]]:
    """The same for the difference of two places, one in each of two cells along one axis."""
    return [(w * v, b - a) for w, a in _steps() for v, b in _steps()]
