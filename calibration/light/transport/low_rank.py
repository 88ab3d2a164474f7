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
    most = min(most, len(gram))
    values, vectors = eigh(gram, subset_by_index=(len(gram) - most, len(gram) - 1))
    values, vectors = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
    left_out = 1 - np.cumsum(values) / max(float(np.trace(gram)), np.finfo(float).tiny)
    count = min(int((left_out > _LOST).sum()) + 1, most)
    V = vectors[:, :count]
    by_patch = solve_triangular(root, V, lower=True, trans="T").T
    return LowRank(by_place=np.asarray(seen @ V), by_patch=np.asarray(by_patch))
