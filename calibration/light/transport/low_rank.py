"""A change of light transport as few pictures: by the places that see it, and the patches that make it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

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


def low_rank(change: FloatArray, most: int) -> LowRank:
    """Return the matrix of least rank that is near a change of transport, by its singular values.

    Parameters
    ----------
    change : (N, L)
    most : int
        Columns, at most.

    Returns
    -------
    LowRank
    """
    # The smaller Gram matrix has the same directions, and is quicker than the whole decomposition.
    values, vectors = np.linalg.eigh(change.T @ change)
    values, vectors = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
    left_out = 1 - np.cumsum(values) / max(float(values.sum()), np.finfo(float).tiny)
    count = min(int((left_out > _LOST).sum()) + 1, most, len(values))
    V = vectors[:, :count]
    return LowRank(by_place=np.asarray(change @ V), by_patch=np.asarray(V.T))
