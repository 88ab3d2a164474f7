"""Light transport T: projector image to camera image, never formed densely.

T = D + V (B - E) with E = S p and (I - G) B = E: D direct light, pixel to pixel; S projector pixels to
emission of patches; V interreflection of patches to camera pixels.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.linalg import LinearOperator

from sim.arrays import FloatArray, IntArray
from sim.errors import SimulationError
from sim.light.interreflection_operator import InterreflectionOperator, interreflection_of
from sim.light.picture_blur import PictureBlur
from sim.light.radiosity import Radiosity


class LightTransport(LinearOperator):  # type: ignore[misc]
    """The linear operator from a projector image p (n_projector,) to a camera image c (n_camera,).

    Parameters
    ----------
    direct : (n_camera, n_projector) csr
        D: once-reflected light.
    emission : (P, n_projector) csr
        S: emission E = S p of the patches, reflectance included.
    radiosity : Radiosity
        The scene's (I - G) B = E.
    view : (n_camera, P) csr
        V: what the camera's pixels see of the patches' interreflection B - E.
    pixel_patch : (n_projector,) int array
        Patch that each projector pixel meets, -1 for none.
    pixel_xy_px : (n_projector, 2) array, optional
        Where each projector pixel stands in its picture, for what needs to know its neighbours.
    blur : PictureBlur, optional
        Of the picture before it lands: direct light is D of the blurred picture. Interreflection is too smooth for it.

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
        pixel_patch: NDArray[np.integer],
        pixel_xy_px: FloatArray | None = None,
        blur: PictureBlur | None = None,
    ) -> None:
        direct, emission, view = (csr_array(matrix) for matrix in (direct, emission, view))
        n_camera, n_projector = direct.shape
        n_patches = radiosity.n_patches
        if (
            emission.shape != (n_patches, n_projector)
            or view.shape != (n_camera, n_patches)
            or np.shape(pixel_patch) != (n_projector,)
        ):
            raise SimulationError(
                f"light transport: direct {direct.shape}, emission {emission.shape}, view {view.shape}, "
                f"pixel_patch {np.shape(pixel_patch)} do not fit together for {n_patches} patches; "
                "make all of them of one surface, camera and projector"
            )
        if pixel_xy_px is not None and np.shape(pixel_xy_px) != (n_projector, 2):
            raise SimulationError(
                f"light transport: positions {np.shape(pixel_xy_px)} of {n_projector} pixels; one row each"
            )
        super().__init__(np.dtype(np.float64), (n_camera, n_projector))
        self.emission, self.radiosity, self.view = emission, radiosity, view
        self.pixel_patch: IntArray = np.asarray(pixel_patch, dtype=np.intp)
        self.direct_matrix = direct
        self.pixel_xy_px = pixel_xy_px
        self.blur = blur

    @property
    def direct(self) -> LinearOperator:
        """Once-reflected light alone: D, of the blurred picture if there is a blur."""
        return _operator(self.shape, self._direct, self._direct_adjoint)

    @property
    def global_(self) -> LinearOperator:
        """V (B - E) alone: light reflected more than once."""
        return _operator(self.shape, self._global, self._global_adjoint)

    @cached_property
    def interreflection(self) -> InterreflectionOperator:
        """The interreflection as a dense matrix between lit and viewed patches, made on first use."""
        return interreflection_of(self.radiosity, self.emission, self.view)

    def radiosity_of(self, p: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return emission and radiosity of the patches for a projector image.

        Parameters
        ----------
        p : (n_projector,) or (n_projector, K) array
            Linear light of each projector pixel.

        Returns
        -------
        E : (P,) or (P, K) array
            S p.
        B : (P,) or (P, K) array
            All light that the patches send back.
        """
        E = np.asarray(self.emission @ p)
        return E, self.radiosity.solve(E)

    def _direct(self, p: FloatArray) -> FloatArray:
        return np.asarray(self.direct_matrix @ (p if self.blur is None else self.blur.apply(p)))

    def _direct_adjoint(self, c: FloatArray) -> FloatArray:
        returned = np.asarray(self.direct_matrix.T @ c)
        return returned if self.blur is None else self.blur.adjoint(returned)

    def _global(self, p: FloatArray) -> FloatArray:
        E, B = self.radiosity_of(p)
        return np.asarray(self.view @ (B - E))

    def _global_adjoint(self, c: FloatArray) -> FloatArray:
        e = np.asarray(self.view.T @ c)
        return np.asarray(self.emission.T @ (self.radiosity.solve_adjoint(e) - e))

    def _matvec(self, p: FloatArray) -> FloatArray:
        p = np.ravel(p)
        return np.asarray(self._direct(p) + self._global(p))

    def _rmatvec(self, c: FloatArray) -> FloatArray:
        c = np.ravel(c)
        return np.asarray(self._direct_adjoint(c) + self._global_adjoint(c))

    def _matmat(self, images: FloatArray) -> FloatArray:
        return np.asarray(self._direct(images) + self._global(images))

    def _rmatmat(self, images: FloatArray) -> FloatArray:
        return np.asarray(self._direct_adjoint(images) + self._global_adjoint(images))


def _operator(shape: tuple[int, int], forward: object, adjoint: object) -> LinearOperator:
    return LinearOperator(
        shape, matvec=forward, rmatvec=adjoint, matmat=forward, rmatmat=adjoint, dtype=np.dtype(np.float64)
    )
