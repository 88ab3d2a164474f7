"""Bilinear interpolation on a grid of cells: its one definition."""

from __future__ import annotations

import numpy as np

from sim.arrays import FloatArray, IntArray


def bilinear(xy: FloatArray, width: int, height: int) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the four cells about each point and their weights; constant beyond the border.

    Parameters
    ----------
    xy : (N, 2) array
        Points; cell (row, column) has its centre at (x, y) = (column, row).
    width, height : int
        Columns and rows of the grid.

    Returns
    -------
    rows, columns : (N, 4) int array
    weights : (N, 4) array
        They sum to 1.
    """
    limits = np.array([width - 1, height - 1], dtype=np.float64)
    clipped = np.clip(xy, 0, limits)
    corner = np.minimum(np.floor(clipped), np.maximum(limits - 1, 0)).astype(np.intp)
    fx, fy = (clipped - corner).T
    left, top = corner.T
    right, bottom = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
    rows = np.stack([top, top, bottom, bottom], axis=1)
    columns = np.stack([left, right, left, right], axis=1)
    weights = np.stack([(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy], axis=1)
    return rows, columns, weights
