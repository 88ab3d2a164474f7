"""A light transport with a change of low rank that was learned from photographs: T + U V S, S the emission.

What is learned is put beside the patches as r more of them, which emit nothing: patch P + k sends back V_k E, and the
camera sees U_k of it. So all that solves a transport, or takes it apart, takes a learned one, too.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array, hstack, vstack

from sim.arrays import FloatArray
from sim.errors import SimulationError
from sim.light.radiosity import Radiosity
from sim.light.transport import LightTransport


class LearnedRadiosity(Radiosity):
    """The radiosity system of a scene, with r patches more that send back what was learned.

    With H = (I - G)⁻¹ the solution is [H, 0; V, I], so that its G is [G, 0; V (I - G), 0].

    Parameters
    ----------
    scene : Radiosity
        Of P patches.
    by_patch : (r, P) array
        V: what each emission adds.
    """

    def __init__(self, scene: Radiosity, by_patch: FloatArray) -> None:
        super().__init__(scene.form_factors, scene.reflectance, tolerance=scene.tolerance)
        self.scene, self.by_patch = scene, by_patch

    @property
    def n_patches(self) -> int:
        """P + r."""
        return self.scene.n_patches + len(self.by_patch)

    def solve(self, E: ArrayLike) -> FloatArray:
        """Return the radiosity of an emission, (P + r,) or (P + r, K)."""
        emitted, more = self._split(E)
        return np.concatenate([self.scene.solve(emitted), self.by_patch @ emitted + more])

    def solve_adjoint(self, e: ArrayLike) -> FloatArray:
        """Return the solution of the transposed system, (P + r,) or (P + r, K)."""
        seen, more = self._split(e)
        return np.concatenate([self.scene.solve_adjoint(seen) + self.by_patch.T @ more, more])

    def gather(self, B: FloatArray) -> FloatArray:
        """Return G B: what a radiosity sends to every patch and that is reflected there, (P + r,) or (P + r, K)."""
        sent = self._split(B)[0]
        reflected = self.scene.gather(sent)
        return np.concatenate([reflected, self.by_patch @ (sent - reflected)])

    def _split(self, values: ArrayLike) -> tuple[FloatArray, FloatArray]:
        checked = self._checked(values)
        return checked[: self.scene.n_patches], checked[self.scene.n_patches :]


def with_learned(transport: LightTransport, by_pixel: FloatArray, by_patch: FloatArray) -> LightTransport:
    """Return a transport with what photographs have taught of it.

    Parameters
    ----------
    transport : LightTransport
        Of P patches.
    by_pixel : (n_camera, r) array
        U.
    by_patch : (r, P) array
        V, of the patches' emission.

    Returns
    -------
    LightTransport
        T + U V S.

    Raises
    ------
    SimulationError
        For parts that do not fit together.
    """
    n_camera, rank, n_patches = transport.shape[0], by_pixel.shape[1], transport.radiosity.n_patches
    if by_pixel.shape != (n_camera, rank) or by_patch.shape != (rank, n_patches):
        raise SimulationError(
            f"learned transport: by pixel {by_pixel.shape}, by patch {by_patch.shape} do not fit a camera of "
            f"{n_camera} pixels and {n_patches} patches; learn it in the transport that it is used with"
        )
    return LightTransport(
        transport.direct_matrix,
        csr_array(vstack([transport.emission, csr_array((rank, transport.shape[1]))])),
        LearnedRadiosity(transport.radiosity, by_patch),
        csr_array(hstack([transport.view, csr_array(by_pixel)])),
        pixel_patch=transport.pixel_patch,
        pixel_xy_px=transport.pixel_xy_px,
        blur=transport.blur,
    )
