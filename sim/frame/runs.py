"""Pixels of a row with something in common, as runs: what lets a loop over pixels be one over plain arrays."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from sim.arrays import CodeArray, FloatArray, IntArray
from sim.errors import SimulationError

AT_ONCE = 1 << 19
"""Pixels whose view is taken apart at a time."""
ALONG_X = 5
"""Row of ``CORNERS`` for two patches that lie along x."""
CORNERS = np.array([[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 1, 1], [0, 1, 2, 2], [0, 1, 2, 3], [0, 1, 0, 1]])
"""Which of a pixel's patches stand at the cell's corners, by their number; last: two along x."""


@dataclass(frozen=True, eq=False)
class Runs:
    """Runs of pixels, row by row."""

    row: NDArray[np.int32]
    """(H + 1,) first run of each row, and the number of runs."""
    start: NDArray[np.int32]
    """(R + 1,) column where each run begins; it ends where the next begins, or with the row."""
    value: NDArray[np.int32]
    """(R, K) what its pixels have in common."""

    def of_pixels(self, shape: tuple[int, int]) -> IntArray:
        """(H, W) run of each pixel."""
        rows = np.repeat(np.arange(shape[0]), np.diff(self.row))
        first = np.zeros(shape[0] * shape[1], dtype=np.intp)
        first[rows * shape[1] + self.start[:-1]] = 1
        return (np.cumsum(first) - 1).reshape(shape)


@dataclass(frozen=True, eq=False)
class BilinearCells:
    """Between which patches' centres each pixel looks."""

    corners: NDArray[np.int32]
    """(C, 4) nodes at the corners (x, y) = (0, 0), (1, 0), (0, 1), (1, 1) of each cell."""
    runs: Runs
    """Values: cells."""
    place: CodeArray
    """(2, H, W) x and y within the cell, in 255ths."""


@dataclass(frozen=True, eq=False)
class NodeMeans:
    """What stands at the corners of cells: means of viewed patches; on gridded walls one patch each."""

    start: NDArray[np.int32]
    """(W + 1,) first entry of each node, and the number of entries."""
    patch: NDArray[np.int32]
    """(E,) viewed patch of each entry."""
    weight: NDArray[np.float32]
    """(E,) its share of the mean."""
    n_patches: int
    """Viewed patches, V."""

    @classmethod
    def of_matrix(cls, weights: csr_array) -> NodeMeans:
        """Return means with the rows (W, V) of a matrix as weights."""
        rows = csr_array(weights)
        rows.sort_indices()
        start, patch = rows.indptr.astype(np.int32), rows.indices.astype(np.int32)
        return cls(start, patch, rows.data.astype(np.float32), rows.shape[1])

    @property
    def matrix(self) -> csr_array:
        """(W, V) the weights as a matrix."""
        entries = (self.weight.astype(np.float64), self.patch, self.start)
        return csr_array(entries, shape=(len(self.start) - 1, self.n_patches))


@dataclass(frozen=True, eq=False)
class CellView:
    """A view taken apart."""

    cells: BilinearCells
    viewed: IntArray
    """(W,) what the nodes at the cells' corners are: columns of the view."""
    misfit: float
    """Largest share of a pixel's view that a product of two linear shares leaves out."""


def runs_of(values: IntArray, places: IntArray, shape: tuple[int, int]) -> Runs:
    """Return the runs of equal values, (n,) or (n, K); pixels that have none belong to the run before them.

    Parameters
    ----------
    places : (n,) int
        Flat index of each value's pixel, rising.
    """
    table = values.reshape(len(places), -1)
    owner = np.zeros(shape[0] * shape[1], dtype=np.intp)
    owner[places] = np.arange(len(places))
    owner = np.maximum.accumulate(owner)
    changed = np.concatenate([[True], (table[1:] != table[:-1]).any(axis=1)])
    number = np.cumsum(changed)[owner]
    begins = np.concatenate([[True], number[1:] != number[:-1]])
    begins[:: shape[1]] = True
    first = np.flatnonzero(begins)
    row = np.searchsorted(first, np.arange(shape[0] + 1) * shape[1])
    start = np.append(first % shape[1], 0)
    return Runs(row.astype(np.int32), start.astype(np.int32), np.ascontiguousarray(table[owner[first]], dtype=np.int32))


def cells_of(view: csr_array, reflectance: FloatArray, places: IntArray, shape: tuple[int, int]) -> CellView:
    """Return a smooth view taken apart: gain times a bilinear mean of the irradiance of four patches.

    Raises
    ------
    SimulationError
        For a pixel that sees more than four patches.
    """
    n = view.shape[0]
    view = csr_array(view)
    view.sort_indices()
    most = int(np.diff(view.indptr).max(initial=0))
    if most > 4:
        raise SimulationError(f"frame model: a pixel sees {most} patches; at most 4 (bilinear between patch centres)")
    corners, place, misfit = np.zeros((n, 4), dtype=np.int32), np.zeros((n, 2), dtype=np.uint8), 0.0
    for first in range(0, n, AT_ONCE):
        chunk = slice(first, first + AT_ONCE)
        misfit = max(misfit, _take_apart(view[chunk], reflectance, corners[chunk], place[chunk]))
    viewed, index = np.unique(corners, return_inverse=True)
    of_pixel = np.zeros((2, shape[0] * shape[1]), dtype=np.uint8)
    of_pixel[:, places] = place.T
    runs = runs_of(index.reshape(n, 4), places, shape)
    cells, number = np.unique(runs.value, axis=0, return_inverse=True)
    runs = replace(runs, value=number.reshape(-1, 1).astype(np.int32))
    return CellView(BilinearCells(cells, runs, of_pixel.reshape(2, *shape)), viewed, misfit)


def _take_apart(view: csr_array, reflectance: FloatArray, corners: NDArray[np.int32], place: CodeArray) -> float:
    """Fill the corners and the place between them of each pixel; returns the largest misfit."""
    count = np.diff(view.indptr)
    share, patch = np.zeros((len(count), 4)), np.zeros((len(count), 4), dtype=np.int32)
    rows = np.repeat(np.arange(len(count)), count)
    columns = np.arange(len(rows)) - np.repeat(view.indptr[:-1], count)
    share[rows, columns] = view.data * reflectance[view.indices]
    patch[rows, columns] = view.indices
    share /= np.maximum(share.sum(axis=1, keepdims=True), np.finfo(float).tiny)
    x, y = share[:, 1] + share[:, 3], share[:, 2] + share[:, 3]
    # Fewer than four: beside a border, where patches one apart lie along x, or beside a black patch.
    kind = np.where((count == 2) & (patch[:, 1] - patch[:, 0] == 1), ALONG_X, count)
    x = np.where(kind == 2, 0.0, np.where(kind == 3, share[:, 1] / np.maximum(1 - share[:, 2], 1e-12), x))
    y = np.where(kind == 2, share[:, 1], y)
    corners[:] = np.take_along_axis(patch, CORNERS[kind], axis=1)
    place[:] = np.rint(255 * np.clip(np.stack([x, y], axis=1), 0, 1))
    return float(np.abs(share[:, 3] - x * y)[kind == 4].max(initial=0.0))
