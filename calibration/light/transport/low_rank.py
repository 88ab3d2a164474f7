"""A change of light transport as few pictures: by the places that see it, and the patches that make it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh, solve_triangular

from calibration.arrays import FloatArray

_LOST = 1e-3
"""Share of the change's mean square that is left out: far below what stays open after any number of photographs."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LowRank:
    """A matrix U V of few columns."""

    by_place: FloatArray
    """(N, r) U."""
    by_patch: FloatArray
    """(r, L) V."""


def largest_eigenpairs(matrix: FloatArray, most: int) -> tuple[FloatArray, FloatArray]:
    """Return the largest eigenvalues (r,) of a symmetric matrix (L, L), largest first, and their vectors (L, r)."""
    size = len(matrix)
    values, vectors = eigh(matrix, subset_by_index=(size - min(most, size), size - 1))
    return np.asarray(values[::-1]), np.asarray(vectors[:, ::-1])


def low_rank(change: FloatArray, pictures: FloatArray, most: int) -> LowRank:
    """Return the matrix of least rank that does to usual pictures what a change of transport does.

    Parameters
    ----------
    change : (N, L)
    pictures : (L, L)
        Second moments of usual pictures' light on the patches.
    most : int
        Columns, at most.

    Returns
    -------
    LowRank
        Nearest in the mean square of the light of such pictures.
    """
    root = np.linalg.cholesky(pictures)
    seen = change @ root
    # The smaller Gram matrix has the same directions, and is quicker than the whole decomposition.
    gram = seen.T @ seen
    values, vectors = largest_eigenpairs(gram, most)
    left_out = 1 - np.cumsum(np.maximum(values, 0.0)) / max(float(np.trace(gram)), np.finfo(float).tiny)
    count = min(int((left_out > _LOST).sum()) + 1, len(values))
    V = vectors[:, :count]
    by_patch = solve_triangular(root, V, lower=True, trans="T").T
    return LowRank(by_place=np.asarray(seen @ V), by_patch=np.asarray(by_patch))
