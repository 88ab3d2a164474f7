"""Final gather: what surface points receive from all patches, with the exact point-to-polygon factor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim import _kernel
from sim.arrays import FloatArray, IntArray
from sim.geometry.optics import Lens, Pose, rays_at
from sim.geometry.rays import trace, tracer_of
from sim.geometry.surface import Surface

COARSEST_PX = 16
"""Spacing of the first points that are final_gather."""
ROW_BELOW, COLUMN_BESIDE = np.array([0, 0, 1, 0], dtype=np.intp), np.array([0, 0, 0, 1], dtype=np.intp)
"""Added to (top, left, bottom, right), they take in the last row, or column, of a cell."""
NUDGE = 1e-6
"""Share of the way to its patch's centroid that a point is moved, off the edges where the factor has no value."""


def irradiance(surface: Surface, radiosity: FloatArray, points_m: FloatArray, normals: FloatArray) -> FloatArray:
    """Return the irradiance at surface points from patches of constant radiosity.

    Each patch's factor is Lambert's formula, cut at the point's horizon. Where something may stand between, it is
    multiplied by the share of the patch that rays see: 5 rays, and 36 where these disagree.

    Parameters
    ----------
    surface : Surface
    radiosity : (P,) array
        B of each patch.
    points_m, normals : (N, 3) array
        Places [m] and unit normals.

    Returns
    -------
    (N,) array
        In the unit of the radiosity.
    """
    received = np.empty(len(points_m))
    _kernel.gather(
        tracer_of(surface),
        points=np.ascontiguousarray(points_m, dtype=np.float64),
        normals=np.ascontiguousarray(normals, dtype=np.float64),
        vertices=np.ascontiguousarray(surface.vertices, dtype=np.float64),
        patch_normals=np.ascontiguousarray(surface.normals, dtype=np.float64),
        radiosity=np.ascontiguousarray(radiosity, dtype=np.float64),
        shadows=not surface.convex,
        received=received,
    )
    return received


def final_gather(
    surface: Surface,
    radiosity: FloatArray,
    lens: Lens,
    pose: Pose,
    *,
    patch: NDArray[np.int32],
    tolerance: float,
) -> FloatArray:
    """Return the irradiance of the surface points that the pixels see.

    Points are final_gather on a coarse grid of pixels. A cell that shows one flat region, and whose middle
    and sides are what its corners predict, is filled bilinearly; any other is split, down to single pixels along
    edges.

    Parameters
    ----------
    surface : Surface
    radiosity : (P,) array
        B of each patch.
    lens, pose
        Of the camera.
    patch : (H, W) int array
        The patch that each pixel sees, -1 for none.
    tolerance : float
        Largest deviation of a cell's middle and sides from its corners' prediction, as a share of it.

    Returns
    -------
    (H, W) array
        In the unit of the radiosity.
    """
    height, width = patch.shape
    region = np.where(patch >= 0, surface.region[patch], -1)
    changes_x, changes_y = _running_changes(region, axis=1), _running_changes(region, axis=0)
    values = np.full(patch.shape, np.nan)
    cells = _first_cells(height, width)
    while len(cells):
        top, left, bottom, right = cells.T
        middle_y, middle_x = (top + bottom) // 2, (left + right) // 2
        whole = _count(changes_x, cells + ROW_BELOW) + _count(changes_y, cells + COLUMN_BESIDE) == 0
        whole &= (bottom - top > 1) | (right - left > 1)
        wanted = np.zeros(patch.shape, dtype=bool)
        for y in (top, bottom):
            for x in (left, right):
                wanted[y, x] = True
        probes = [(middle_y, middle_x), (top, middle_x), (bottom, middle_x), (middle_y, left), (middle_y, right)]
        for y, x in probes:
            wanted[y[whole], x[whole]] = True
        missing = wanted & np.isnan(values)
        values[missing & (patch < 0)] = 0.0
        places = np.nonzero(missing & (patch >= 0))
        points = _points_seen(surface, lens, pose, places)
        values[places] = _gathered(surface, radiosity, points, patch[places])
        accepted = whole
        for y, x in probes:
            predicted = _bilinear(values, cells, y, x)
            accepted = accepted & (np.abs(values[y, x] - predicted) <= tolerance * predicted)
        _interpolate(values, cells[accepted])
        cells = _split(cells[~accepted])
    return values


def _points_seen(surface: Surface, lens: Lens, pose: Pose, places: tuple[IntArray, ...]) -> FloatArray:
    """(N, 3) surface points that pixels at places (y, x) see [m]."""
    y, x = places
    rays = rays_at(lens, pose, np.stack([x, y], axis=1).astype(np.float64))
    return np.asarray(pose.position_m + trace(surface, pose.position_m, rays).distance[:, None] * rays)


def _gathered(surface: Surface, radiosity: FloatArray, points_m: FloatArray, patch: NDArray[np.int32]) -> FloatArray:
    """(N,) irradiance at points of patches."""
    points_m = points_m + NUDGE * (surface.centres[patch] - points_m)
    return irradiance(surface, radiosity, points_m, surface.normals[patch])


def _first_cells(height: int, width: int) -> IntArray:
    """(N, 4) top, left, bottom, right of cells that share their corners and cover the picture."""
    y = np.unique(np.append(np.arange(0, height, COARSEST_PX), height - 1))
    x = np.unique(np.append(np.arange(0, width, COARSEST_PX), width - 1))
    top, left = (grid.ravel() for grid in np.meshgrid(_starts(y), _starts(x), indexing="ij"))
    bottom, right = (grid.ravel() for grid in np.meshgrid(y[-len(y) + 1 :], x[-len(x) + 1 :], indexing="ij"))
    return np.stack([top, left, bottom, right], axis=1)


def _starts(edges: IntArray) -> IntArray:
    return edges[:-1] if len(edges) > 1 else edges


def _split(cells: IntArray) -> IntArray:
    """Children of the cells that are wider than a pixel, sharing the middle."""
    top, left, bottom, right = cells.T
    cells = cells[(bottom - top > 1) | (right - left > 1)]
    top, left, bottom, right = cells.T
    y, x = (top + bottom) // 2, (left + right) // 2
    children = [(top, left, y, x), (top, x, y, right), (y, left, bottom, x), (y, x, bottom, right)]
    every = np.concatenate([np.stack(child, axis=1) for child in children])
    # A side of one pixel has its middle at its start: that child has no height (or width) unless the cell had none.
    flat_y, flat_x = np.tile(bottom == top, 4), np.tile(right == left, 4)
    return np.asarray(every[((every[:, 2] > every[:, 0]) | flat_y) & ((every[:, 3] > every[:, 1]) | flat_x)])


def _bilinear(values: FloatArray, cells: IntArray, y: IntArray, x: IntArray) -> FloatArray:
    """Value at (y, x) from each cell's corners; y and x may carry more axes in front."""
    top, left, bottom, right = cells.T
    down = (y - top) / np.maximum(bottom - top, 1)
    across = (x - left) / np.maximum(right - left, 1)
    upper = (1 - across) * values[top, left] + across * values[top, right]
    lower = (1 - across) * values[bottom, left] + across * values[bottom, right]
    return np.asarray((1 - down) * upper + down * lower)


def _interpolate(values: FloatArray, cells: IntArray) -> None:
    """Fill accepted cells from their corners, all cells of one size together."""
    size = cells[:, 2:] - cells[:, :2]
    for height, width in np.unique(size, axis=0):
        these = cells[(size == (height, width)).all(axis=1)]
        dy, dx = (grid.reshape(-1, 1) for grid in np.mgrid[: height + 1, : width + 1])
        y, x = these[:, 0] + dy, these[:, 1] + dx
        values[y, x] = _bilinear(values, these, y, x)


def _running_changes(region: IntArray, axis: int) -> IntArray:
    """Sums over [0, y) x [0, x) of where the region differs from its next neighbour along the axis."""
    changes = np.diff(region, axis=axis) != 0
    sums = np.zeros((changes.shape[0] + 1, changes.shape[1] + 1), dtype=np.intp)
    sums[1:, 1:] = changes.cumsum(axis=0).cumsum(axis=1)
    return sums


def _count(sums: IntArray, boxes: IntArray) -> IntArray:
    """(N,) sums over [top, bottom) x [left, right) of boxes (N, 4)."""
    top, left, bottom, right = boxes.T
    return np.asarray(sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left])
