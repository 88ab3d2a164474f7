"""The interreflection of a square transport as a small dense matrix between the patches that matter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from sim.geometry.scene import FloatArray
from sim.light.radiosity import Radiosity


@dataclass(frozen=True, eq=False)
class InterreflectionOperator:
    """V H S with H = (I - G)⁻¹ G cut to the lit columns and the viewed rows."""

    emission: csr_array
    """(L, n_projector) S of the lit patches."""
    interreflection: FloatArray
    """(W, L) H from lit to viewed patches."""
    view: csr_array
    """(n_camera, W) V of the viewed patches."""
    emission_adjoint: csr_array
    """(n_projector, L) Sᵀ, stored by rows."""
    view_adjoint: csr_array
    """(W, n_camera) Vᵀ, stored by rows."""

    def apply(self, p: FloatArray) -> FloatArray:
        """Give the camera image V H S p."""
        return np.asarray(self.view @ (self.interreflection @ (self.emission @ p)))

    def adjoint(self, c: FloatArray) -> FloatArray:
        """Give Sᵀ Hᵀ Vᵀ c."""
        return np.asarray(self.emission_adjoint @ (self.interreflection.T @ (self.view_adjoint @ c)))


def coupling_of(radiosity: Radiosity, emission: csr_array, view: csr_array) -> InterreflectionOperator:
    """Cut a transport's interreflection to the patches that it lights and views."""
    lit = np.flatnonzero(np.diff(emission.indptr))
    viewed = np.unique(view.indices)
    unit = np.zeros((radiosity.n_patches, len(lit)))
    unit[lit, np.arange(len(lit))] = 1.0
    H = np.ascontiguousarray((radiosity.solve(unit) - unit)[viewed])
    S, V = csr_array(emission[lit]), csr_array(view[:, viewed])
    return InterreflectionOperator(S, H, V, csr_array(S.T), csr_array(V.T))
