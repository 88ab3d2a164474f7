"""The paper's quadrature (Dehos et al. 2014): 3x3 midpoint samples on both patches, kept for replication."""

from __future__ import annotations

import numpy as np

from sim import _kernel
from sim.arrays import FloatArray
from sim.errors import SimulationError
from sim.geometry.surface import Surface

SAMPLES = 3
"""Points along each side of a patch, as published."""


def fill(surface: Surface, matrix: FloatArray, row_sums: FloatArray) -> None:
    """Fill (P, P) form factors and their (P,) row sums, occluders left out.

    A_i F_ij = A_i A_j / 81 sum of cos cos' / (pi r²) over the 81 pairs of samples.

    Raises
    ------
    SimulationError
        If the surface has triangles: 3x3 midpoints are for quads.
    """
    points = sample_points(surface)
    normals = np.ascontiguousarray(surface.normals.T)
    offsets = np.einsum("pk,pk->p", surface.normals, surface.centres)
    _kernel.paper_exchange_areas(points, normals, offsets=offsets, areas=surface.areas, exchange=matrix)
    _kernel.divide_rows(matrix, surface.areas, row_sums)


def sample_points(surface: Surface) -> FloatArray:
    """Return (3, 9, P) midpoints of a 3x3 division of each patch [m]."""
    a, b, c, d = np.moveaxis(surface.vertices, 1, 0)
    triangles = np.flatnonzero((c == d).all(axis=1))
    if len(triangles):
        raise SimulationError(
            f"{surface.name}: patch {triangles[0]} is a triangle (and {len(triangles) - 1} more); "
            "the paper's 3x3 samples are for quads: use method 'polygon'"
        )
    offsets = (np.arange(SAMPLES) + 0.5) / SAMPLES
    points = [(1 - u) * (1 - v) * a + u * (1 - v) * b + u * v * c + (1 - u) * v * d for v in offsets for u in offsets]
    return np.ascontiguousarray(np.moveaxis(np.stack(points), 2, 0))
