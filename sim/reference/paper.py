"""The paper's quadrature in plain numpy, sample by sample."""

from __future__ import annotations

import numpy as np

from sim.arrays import FloatArray
from sim.form_factors.paper import SAMPLES, sample_points
from sim.geometry.surface import Surface


def exchange_areas(surface: Surface) -> FloatArray:
    """Return (P, P) A_i F_ij of every pair of patches, occluders left out [m²]."""
    points = np.moveaxis(sample_points(surface), 0, 2)
    normals, centres = surface.normals, surface.centres
    total = np.zeros((surface.n_patches, surface.n_patches))
    # Patches are flat, so r cos is the height of one sample over the other patch's plane: over[k, i, j] of
    # sample k of patch j over patch i.
    over = np.einsum("kjx,ix->kij", points, normals) - np.einsum("ix,ix->i", centres, normals)[:, None]
    over = np.where(over > 1e-9, over, 0.0)
    for of_first, first in enumerate(points):
        for of_second, second in enumerate(points):
            squared = ((first[:, None] - second[None]) ** 2).sum(axis=2)
            np.fill_diagonal(squared, 1.0)
            squared[squared == 0] = 1.0
            total += over[of_second] * over[of_first].T / squared**2
    areas = surface.areas
    return np.asarray(total * np.outer(areas, areas) / (np.pi * SAMPLES**4))
