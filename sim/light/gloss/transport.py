"""Light transport with gloss, still linear: T = D + D_s + V (B - S p) + V_s (B - S p) + M p.

(I - ρ (F + F_s)) B = (S + S_s) p are the matte parts of the patches' light: S what the projector sends them, S_s what
reaches them by way of gloss, F_s what gloss passes on between them. A camera pixel sees direct light, matte and as a
highlight (D with D_s), what its own patch sends back matte of all other light (V), and in the lobe of its patch
the other patches: their light of more reflections (V_s), and the projector's picture on them, M p.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_array, csr_array

from sim.arrays import FloatArray, IntArray
from sim.errors import SimulationError
from sim.light.interreflection_operator import InterreflectionOperator, patch_to_patch
from sim.light.radiosity import Radiosity
from sim.light.transport import LightTransport


class GlossyTransport(LightTransport):
    """The linear operator from a projector image p (n_projector,) to a camera image c (n_camera,) among glossy patches.

    Parameters
    ----------
    direct : (n_camera, n_projector) csr
        D + D_s: once-reflected light.
    emission : (P, n_projector) csr
        S: matte emission of the patches by light that comes straight from the projector.
    by_gloss : (P, n_projector) csr
        S_s: matte emission by light that comes by way of glossy patches.
    radiosity : Radiosity
        Of extended form factors (:func:`sim.light.gloss.exchange.glossy_form_factors`).
    view : (n_camera, P) csr
        V: what pixels see of B - S p on their own patch.
    lobe_view : (n_camera, P) csr
        V_s: what they see of it in the lobe of their patch.
    mirrored : (n_camera, n_projector) csr, optional
        M: what they see there of light reflected once before. None: V_s S, the picture constant a patch.
    pixel_patch : (n_projector,) int array
        Patch that each projector pixel meets, -1 for none.
    pixel_xy_px : (n_projector, 2) array, optional
        Where each projector pixel stands in its picture.

    Raises
    ------
    SimulationError
        For parts that do not fit together.
    """

    def __init__(
        self,
        direct: csr_array,
        emission: csr_array,
        radiosity: Radiosity,
        view: csr_array,
        *,
        by_gloss: csr_array,
        lobe_view: csr_array,
        mirrored: csr_array | None = None,
        pixel_patch: NDArray[np.integer],
        pixel_xy_px: FloatArray | None = None,
    ) -> None:
        by_gloss, lobe_view = csr_array(by_gloss), csr_array(lobe_view)
        super().__init__(
            direct,
            emission,
            radiosity,
            csr_array(view + lobe_view),
            pixel_patch=pixel_patch,
            pixel_xy_px=pixel_xy_px,
        )
        shapes = (by_gloss.shape, None if mirrored is None else mirrored.shape)
        if by_gloss.shape != emission.shape or (mirrored is not None and mirrored.shape != self.shape):
            raise SimulationError(
                f"light transport: light by way of gloss {shapes[0]} and mirrored {shapes[1]} do not fit an emission "
                f"{emission.shape} and {self.shape[0]} camera pixels; make all of them of one transport"
            )
        self.by_gloss, self.lobe_view, self.mirrored = by_gloss, lobe_view, mirrored

    def radiosity_of(self, p: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return matte emission and radiosity of the patches for a projector image.

        Parameters
        ----------
        p : (n_projector,) or (n_projector, K) array
            Linear light of each projector pixel.

        Returns
        -------
        E : (P,) or (P, K) array
            S p: by light that comes straight from the projector.
        B : (P,) or (P, K) array
            All light that the patches send back matte.
        """
        E = np.asarray(self.emission @ p)
        return E, self.radiosity.solve(E + np.asarray(self.by_gloss @ p))

    @cached_property
    def interreflection(self) -> InterreflectionOperator:
        """Everything but direct light as a dense matrix between lit and viewed patches, made on first use.

        Of [B - S p, S p] the pixels see [V + V_s, V_s]; it is [[H, H + I], [I, 0]] [S p, S_s p], H = (I - G)⁻¹ G.

        Raises
        ------
        SimulationError
            If the picture on other patches is mirrored pixel by pixel: that is no matrix between patches.
        """
        if self.mirrored is not None:
            raise SimulationError(
                "the projector's picture is mirrored pixel by pixel in glossy patches, compensation needs it by patch: "
                "make the transport with mirrored='patch'"
            )
        lit = [np.flatnonzero(np.diff(matrix.indptr)) for matrix in (self.emission, self.by_gloss)]
        viewed = [np.unique(matrix.indices) for matrix in (self.view, self.lobe_view)]
        H = self._between(lit, viewed)
        S = csr_array(block_array([[self.emission[lit[0]]], [self.by_gloss[lit[1]]]], format="csr"))
        V = csr_array(block_array([[self.view[:, viewed[0]], self.lobe_view[:, viewed[1]]]], format="csr"))
        return InterreflectionOperator(
            emission=S, patch_to_patch=H, view=V, emission_adjoint=csr_array(S.T), view_adjoint=csr_array(V.T)
        )

    def _between(self, lit: list[IntArray], viewed: list[IntArray]) -> FloatArray:
        """[[H, H + I], [I, 0]] cut to its columns and rows, C-contiguous."""
        eye = np.eye(self.radiosity.n_patches)
        first = patch_to_patch(self.radiosity, lit[0], viewed[0])
        second = patch_to_patch(self.radiosity, lit[1], viewed[0]) + eye[np.ix_(viewed[0], lit[1])]
        straight = eye[np.ix_(viewed[1], lit[0])]
        return np.ascontiguousarray(np.block([[first, second], [straight, np.zeros((len(viewed[1]), len(lit[1])))]]))

    def _global(self, p: FloatArray) -> FloatArray:
        E, B = self.radiosity_of(p)
        picture = self.lobe_view @ E if self.mirrored is None else self.mirrored @ p
        return np.asarray(self.view @ (B - E) + picture)

    def _global_adjoint(self, c: FloatArray) -> FloatArray:
        e = np.asarray(self.view.T @ c)
        x = self.radiosity.solve_adjoint(e)
        seen = np.asarray(self.lobe_view.T @ c) if self.mirrored is None else None
        returned = self.emission.T @ (x - e if seen is None else x - e + seen) + self.by_gloss.T @ x
        return np.asarray(returned if self.mirrored is None else returned + self.mirrored.T @ c)
