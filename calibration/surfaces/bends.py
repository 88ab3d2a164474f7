"""How well a mesh of measured points knows the slant of its patches to light: by how its neighbours slant."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array

from calibration.arrays import FloatArray

_ONE_SURFACE = 0.3
"""Cosine between normals of neighbours above which they are of one surface that bends: below lies an edge."""
_OF_SPREAD = 1.2
"""Relative error of the cosine over the square of its relative spread among neighbours. On cones, balls, tori and
people of five simulated rooms, direct light was off by 0.034, 0.058, 0.25 and 0.9 (rms) where the spread was 0.1, 0.2,
0.45 and 0.9: what a patch's middle says of the whole of it is off by the second order."""
_LEAST_COSINE = 1e-3


def slant_errors(
    corner: NDArray[np.integer], normals: FloatArray, towards_m: FloatArray, surface: NDArray[np.integer]
) -> FloatArray:
    """Return by how much the cosine of light's incidence on each patch may be off, relative.

    A patch of a bent surface stands for many slants, which shows in how differently the patches about it slant. Where
    light grazes, a small tilt changes much.

    Parameters
    ----------
    corner : (P, 4) int
        Numbers of each patch's corners; a triangle repeats its last.
    normals : (P, 3)
        Of unit length.
    towards_m : (P, 3)
        From each patch's middle to where light comes from.
    surface : (P,) int
        Only patches of one surface are neighbours.

    Returns
    -------
    (P,) ndarray
        Standard deviation; 0 of patches in one plane with all that they touch, and of those turned away from the light.
    """
    n = len(corner)
    touches = coo_array((np.ones(4 * n), (np.repeat(np.arange(n), 4), corner.ravel()))).tocsr()
    pairs = (touches @ touches.T).tocoo()
    one, other = pairs.row, pairs.col
    alike = (surface[one] == surface[other]) & (np.einsum("ek,ek->e", normals[one], normals[other]) > _ONE_SURFACE)
    one, other = one[alike], other[alike]
    light = towards_m / np.linalg.norm(towards_m, axis=1, keepdims=True)
    cosine = np.einsum("pk,pk->p", normals, light)
    off = np.einsum("ek,ek->e", normals[other], light[one]) - cosine[one]
    spread = np.sqrt(np.bincount(one, off**2, minlength=n) / np.bincount(one, minlength=n))
    return np.where(cosine > 0, _OF_SPREAD * (spread / np.maximum(cosine, _LEAST_COSINE)) ** 2, 0.0)
