"""The interreflection of a square transport as a small dense matrix between the patches that matter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from sim.arrays import FloatArray, IntArray
from sim.light.radiosity import Radiosity


@dataclass(frozen=True, eq=False, kw_only=True)
class InterreflectionOperator:
    """V H S with H = (I - G)⁻¹ G cut to the lit columns and the viewed rows."""

    emission: csr_array
    """(L, n_projector) S of the lit patches."""
    patch_to_patch: FloatArray
    """(W, L) H from lit to viewed patches."""
    view: csr_array
    """(n_camera, W) V of the viewed patches."""
    emission_adjoint: csr_array
    """(n_projector, L) Sᵀ, stored by rows."""
    view_adjoint: csr_array
    """(W, n_camera) Vᵀ, stored by rows."""

    def apply(self, p: FloatArray) -> FloatArray:
        """Return the camera image V H S p, (n_camera,), of a projector image (n_projector,)."""
        return np.asarray(self.view @ (self.patch_to_patch @ (self.emission @ p)))

    def adjoint(self, c: FloatArray) -> FloatArray:
        """Return Sᵀ Hᵀ Vᵀ c, (n_projector,), of a camera image (n_camera,)."""
        return np.asarray(self.emission_adjoint @ (self.patch_to_patch.T @ (self.view_adjoint @ c)))


def interreflection_of(radiosity: Radiosity, emission: csr_array, view: csr_array) -> InterreflectionOperator:
    """Return a transport's interreflection, cut to the patches that it lights and views.

    Parameters
    ----------
    radiosity : Radiosity
    emission : (P, n_projector) csr
        S of all patches.
    view : (n_camera, P) csr
        V of all patches.

    Returns
    -------
    InterreflectionOperator
    """
    lit = np.flatnonzero(np.diff(emission.indptr))
    viewed = np.unique(view.indices)
    H = np.ascontiguousarray(patch_to_patch(radiosity, lit, viewed))
    S, V = csr_array(emission[lit]), csr_array(view[:, viewed])
    return InterreflectionOperator(
        emission=S, patch_to_patch=H, view=V, emission_adjoint=csr_array(S.T), view_adjoint=csr_array(V.T)
    )


def patch_to_patch(radiosity: Radiosity, lit: IntArray, viewed: IntArray) -> FloatArray:
    """Return (W, L) entries of H = (I - G)⁻¹ G = (I - G)⁻¹ - I, from lit patches (L,) to viewed ones (W,)."""
    unit = np.zeros((radiosity.n_patches, len(lit)))
    unit[lit, np.arange(len(lit))] = 1.0
    return np.asarray((radiosity.solve(unit) - unit)[viewed])
