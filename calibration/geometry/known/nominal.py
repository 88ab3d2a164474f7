"""What is known of both lenses before anything was measured."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from calibration.arrays import FloatArray
from calibration.geometry.known.lenses import KnownLenses, idealised, real_device
from calibration.geometry.pinhole import PinholeModel


@dataclass(frozen=True, eq=False, kw_only=True)
class NominalIntrinsics:
    """What the data sheets say of both lenses, or boards that measured them."""

    camera_focal_px: float
    projector_focal_px: float
    camera_shape: tuple[int, int]
    projector_shape: tuple[int, int]
    known: KnownLenses = field(default_factory=KnownLenses)
    """Lenses that boards measured; of these the focal lengths above are theirs."""
    sheets: NominalIntrinsics | None = None
    """What the data sheets say of them."""

    @classmethod
    def of(
        cls,
        *,
        camera_shape: tuple[int, int],
        projector_shape: tuple[int, int],
        camera_hfov_deg: float,
        projector_hfov_deg: float,
    ) -> NominalIntrinsics:
        """Make them from what data sheets say.

        Parameters
        ----------
        camera_shape, projector_shape : (height, width)
            Of the pictures. [px]
        camera_hfov_deg, projector_hfov_deg : float
            Horizontal fields of view, to some ten percent. [degrees]

        Returns
        -------
        NominalIntrinsics
            Focal lengths in pixels.
        """
        focal = [
            float(shape[1] / 2 / np.tan(np.radians(hfov) / 2))
            for shape, hfov in ((camera_shape, camera_hfov_deg), (projector_shape, projector_hfov_deg))
        ]
        return cls(
            camera_focal_px=focal[0],
            projector_focal_px=focal[1],
            camera_shape=camera_shape,
            projector_shape=projector_shape,
        )

    def with_lenses(self, known: KnownLenses) -> NominalIntrinsics:
        """Return the same devices with lenses that boards measured.

        Parameters
        ----------
        known : KnownLenses
            Of one of them, or of both.

        Returns
        -------
        NominalIntrinsics
        """
        camera_px, projector_px = (
            focal if lens is None else float(lens.at_aspect[0][0])
            for lens, focal in zip(known.both, (self.camera_focal_px, self.projector_focal_px), strict=True)
        )
        return replace(self, camera_focal_px=camera_px, projector_focal_px=projector_px, known=known, sheets=self)

    def idealised(self, x1: FloatArray, x2: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return pixels as lenses would see them that are as expected before anything was measured.

        What follows from them needs no search for what boards have told. Unknown lenses leave them as they are.

        Parameters
        ----------
        x1, x2 : (N, 2)
            Of the camera and the projector. [px]

        Returns
        -------
        (N, 2), (N, 2)
            The same points. [px]
        """
        (h1, w1), (h2, w2) = self.camera_shape, self.projector_shape
        return (
            idealised(self.known.camera, x1, ((w1 - 1) / 2, (h1 - 1) / 2)),
            idealised(self.known.projector, x2, (0.5 * w2, 0.5 * h2)),
        )

    def real(self, devices: tuple[PinholeModel, PinholeModel]) -> tuple[PinholeModel, PinholeModel]:
        """Give devices that were found in idealised pixels the lenses that are known.

        Parameters
        ----------
        devices : (PinholeModel, PinholeModel)
            Camera and projector.

        Returns
        -------
        (PinholeModel, PinholeModel)
            In the same poses.
        """
        camera, projector = (real_device(lens, one) for lens, one in zip(self.known.both, devices, strict=True))
        return camera, projector
