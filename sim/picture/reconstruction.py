"""Smooth light from patch means: what a flat region receives between its patches' centres.

A patch's irradiance is a mean over its area, so a reconstruction has to give that mean back. It is continuous
within a region, exact for linear fields, and never below 0.

- Gridded faces: a biquadratic a patch. Its values on the lines between patches come from the cumulative sum's
  cubic interpolation along rows and columns (four patches, three at the border).
- Meshes: a fan of triangles about each patch's centroid. Corner values come from the gradients of the patches
  that meet there; the centre's value keeps the mean.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array

from sim.arrays import FloatArray, IntArray
from sim.geometry.rays import plane_axes
from sim.geometry.scene import Face, Scene
from sim.geometry.surface import Surface
from sim.geometry.topology import WELD


def line_values(means: FloatArray) -> FloatArray:
    """Return (n + 1, ...) values on the lines between and around n equal cells of these means, along the first axis."""
    n = len(means)
    if n == 1:
        return np.concatenate([means, means])
    lines = np.empty((n + 1, *means.shape[1:]))
    lines[1:-1] = (means[:-1] + means[1:]) / 2
    if n == 2:
        lines[0], lines[2] = 2 * means[0] - lines[1], 2 * means[1] - lines[1]
        return lines
    lines[2:-2] = (7 * (means[1:-2] + means[2:-1]) - means[:-3] - means[3:]) / 12
    for line, (a, b, c) in ((lines, means[:3]), (lines[::-1], means[:-4:-1])):
        line[0], line[1] = (11 * a - 7 * b + 2 * c) / 6, (2 * a + 5 * b - c) / 6
    return lines


def quadratics(scene: Scene, means: FloatArray) -> FloatArray:
    """Return (P, 3, 3) Bernstein coefficients of each patch's biquadratic, rows along v, columns along u.

    A patch whose coefficients would go below 0 is drawn towards its mean until they do not.

    Parameters
    ----------
    means : (P,) array
        Mean of each patch, 0 or more.
    """
    coefficients = np.concatenate([_face_quadratics(face, means[face.patches]) for face in scene.faces])
    return _without_negatives(coefficients.reshape(-1, 9), means).reshape(-1, 3, 3)


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the cross product of vectors (..., 2) of one plane."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _without_negatives(values: FloatArray, means: FloatArray) -> FloatArray:
    """Rows of values, each drawn towards its mean until its lowest is 0."""
    lowest = values.min(axis=1)
    below = np.flatnonzero(lowest < 0)
    if below.size:
        mean = means[below, None]
        share = mean / (mean - lowest[below, None])
        # The share leaves a rounding error below 0.
        values[below] = np.maximum(mean + share * (values[below] - mean), 0.0)
    return values


def _face_quadratics(face: Face, means: FloatArray) -> FloatArray:
    grid = means.reshape(face.rows, face.columns)
    along_v = _bernstein(grid)
    both = _bernstein(np.moveaxis(along_v, 2, 0))
    # (columns, 3 along u, rows, 3 along v) to (rows, columns, v, u)
    return both.transpose(2, 0, 3, 1).reshape(-1, 3, 3)


def _bernstein(means: FloatArray) -> FloatArray:
    """(n, 3, ...) coefficients along the first axis: the two lines, and between them what keeps the mean."""
    lines = line_values(means)
    return np.stack([lines[:-1], 3 * means - lines[:-1] - lines[1:], lines[1:]], axis=1)


def fans(surface: Surface, means: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the fan of triangles about each patch's centroid.

    Parameters
    ----------
    means : (P,) array
        Mean of each patch, 0 or more.

    Returns
    -------
    corners : (P, 4, 2) array
        In the patch's plane, about its centroid. [m]
    values : (P, 5) array
        At the four corners and, last, at the centroid.
    """
    from_centre = surface.vertices - surface.centres[:, None]
    corners = np.einsum("pck,pak->pca", from_centre, plane_axes(surface))
    at_corners = np.maximum(_corner_values(surface, means, from_centre), 0.0)
    following = np.roll(corners, -1, axis=1)
    sectors = cross(corners, following)
    sectors /= sectors.sum(axis=1, keepdims=True)
    rim = (sectors * (at_corners + np.roll(at_corners, -1, axis=1))).sum(axis=1)
    centre = 3 * means - rim
    values = _without_negatives(np.column_stack([at_corners, centre]), means)
    return np.ascontiguousarray(corners), values


def _corner_values(surface: Surface, means: FloatArray, from_centre: FloatArray) -> FloatArray:
    """(P, 4) mean of what the patches that meet at a corner of a region expect there."""
    vertex = _welded(surface)
    gradient = _gradients(surface, means, vertex)
    expected = means[:, None] + np.einsum("pck,pk->pc", from_centre, gradient)
    count = np.bincount(vertex.ravel())
    total = np.bincount(vertex.ravel(), expected.ravel())
    return np.asarray((total / np.maximum(count, 1))[vertex])


def _welded(surface: Surface) -> IntArray:
    """(P, 4) number of each corner; corners of different regions are different."""
    corners = surface.vertices.reshape(-1, 3)
    size = float(np.ptp(corners, axis=0).max())
    key = np.column_stack([np.repeat(surface.region, 4), np.round(corners / (WELD * size)).astype(np.intp)])
    order = np.lexsort(key.T)
    fresh = np.concatenate([[0], (np.diff(key[order], axis=0) != 0).any(axis=1)])
    vertex = np.empty(len(corners), dtype=np.intp)
    vertex[order] = np.cumsum(fresh)
    return vertex.reshape(-1, 4)


def _gradients(surface: Surface, means: FloatArray, vertex: IntArray) -> FloatArray:
    """(P, 3) least-squares gradient from the patches that share a corner; 0 across what they do not span."""
    n = surface.n_patches
    incidence = coo_array((np.ones(4 * n), (vertex.ravel(), np.repeat(np.arange(n), 4)))).tocsr()
    pairs = (incidence.T @ incidence).tocoo()
    i, j = pairs.coords
    step = surface.centres[j] - surface.centres[i]
    moments = _summed(i, step[:, :, None] * step[:, None, :], n)
    right = _summed(i, step * (means[j] - means[i])[:, None], n)
    return np.asarray(np.einsum("pkl,pl->pk", np.linalg.pinv(moments, rcond=1e-6, hermitian=True), right))


def _summed(index: IntArray, values: FloatArray, n: int) -> FloatArray:
    """Sum of the values of each index, over the first axis."""
    columns = values.reshape(len(values), -1)
    sums = np.stack([np.bincount(index, column, minlength=n) for column in columns.T], axis=1)
    return np.asarray(sums.reshape(n, *values.shape[1:]), dtype=np.float64)
