"""Products with a sparse matrix on all threads, and its scaling where it lies: scipy does both on one, with copies."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from sim import _kernel
from sim.arrays import FloatArray


def product(K: csr_array, x: FloatArray) -> FloatArray:
    """Return K x, the same to the last bit on any number of threads.

    Parameters
    ----------
    K : (P, Q) csr_array
        Of float64.
    x : (Q,) or (Q, K) array

    Returns
    -------
    (P,) or (P, K) array
    """
    if K.indptr.dtype != np.int32:  # more than 2^31 entries, of 12 bytes each
        return np.asarray(K @ x)
    columns = np.ascontiguousarray(x, dtype=np.float64).reshape(len(x), -1)
    out = np.empty((K.shape[0], columns.shape[1]))
    _kernel.sparse_product(K.indptr, K.indices, K.data, x=columns, out=out)
    return out.reshape(K.shape[0], *np.shape(x)[1:])


def scale_both_sides(K: csr_array, scale: FloatArray) -> None:
    """Make scale_i K_ij scale_j of a square matrix K, in place.

    Parameters
    ----------
    K : (P, P) csr_array
        Of float64.
    scale : (P,) array
    """
    if K.indptr.dtype != np.int32:
        K.data *= np.repeat(scale, np.diff(K.indptr)) * scale[K.indices]
        return
    _kernel.scale_both_sides(K.indptr, K.indices, K.data, np.ascontiguousarray(scale))
