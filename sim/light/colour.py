"""Light transport in colour: the projector's channels mix once, then each band bounces on its own."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse.linalg import LinearOperator

from sim.arrays import FloatArray, IntArray
from sim.errors import SimulationError
from sim.light.transport import LightTransport

CONDITION_LIMIT = 1e4
"""Of the mixing matrix: beyond this, two projector channels look the same to the camera."""


class ColourTransport(LinearOperator):  # type: ignore[misc]
    """The linear operator from a colour projector image p to a colour camera image c.

    c_b = T_b Σ_q K[b, q] p_q. As an operator it takes and gives flat images (n C,), channels last;
    :meth:`forward` and :meth:`adjoint` take and give (n, C).

    Parameters
    ----------
    bands : sequence of C LightTransport
        T_b of each band of the camera, all of one geometry, so of one shape.
    mixing : (C, C) array
        K[b, q]: light that band b of the camera gets from channel q of the projector.

    Raises
    ------
    SimulationError
        If there is no band, if the bands do not fit together, or if the mixing matrix has the wrong shape, is not
        finite or can hardly be inverted.
    """

    def __init__(self, bands: Sequence[LightTransport], mixing: ArrayLike) -> None:
        self.bands = tuple(bands)
        self.mixing = _checked_mixing(mixing, len(self.bands))
        shapes = {band.shape for band in self.bands}
        if len(shapes) > 1:
            raise SimulationError(f"colour transport: bands of different shapes {sorted(shapes)}; resample to one")
        patches = self.bands[0].pixel_patch
        if any(not np.array_equal(band.pixel_patch, patches) for band in self.bands):
            raise SimulationError("colour transport: the bands' pixels meet different patches; use one geometry")
        n_camera, n_projector = self.bands[0].shape
        channels = len(self.bands)
        super().__init__(np.dtype(np.float64), (n_camera * channels, n_projector * channels))

    @property
    def channels(self) -> int:
        """C, the number of bands and of projector channels."""
        return len(self.bands)

    @property
    def pixel_patch(self) -> IntArray:
        """(n_projector,) patch that each projector pixel meets, -1 for none."""
        return self.bands[0].pixel_patch

    def forward(self, p: FloatArray) -> FloatArray:
        """Return the camera image T p of a projector image.

        Parameters
        ----------
        p : (n_projector, C) array
            Linear light of each pixel and channel.

        Returns
        -------
        (n_camera, C) array
            In the transport's unit.
        """
        light = p @ self.mixing.T
        return np.stack([np.asarray(band @ light[:, b]) for b, band in enumerate(self.bands)], axis=-1)

    def adjoint(self, c: FloatArray) -> FloatArray:
        """Return Tᵀ c of a camera image.

        Parameters
        ----------
        c : (n_camera, C) array

        Returns
        -------
        (n_projector, C) array
        """
        returned = [np.asarray(band.rmatvec(c[:, b])) for b, band in enumerate(self.bands)]
        return np.asarray(np.stack(returned, axis=-1) @ self.mixing)

    def _matvec(self, p: FloatArray) -> FloatArray:
        return self.forward(np.reshape(p, (-1, self.channels))).ravel()

    def _rmatvec(self, c: FloatArray) -> FloatArray:
        return self.adjoint(np.reshape(c, (-1, self.channels))).ravel()


def _checked_mixing(mixing: ArrayLike, channels: int) -> FloatArray:
    K = np.asarray(mixing, dtype=np.float64)
    if channels == 0:
        raise SimulationError("colour transport: no band; give one LightTransport for each band of the camera")
    if K.shape != (channels, channels):
        raise SimulationError(f"colour transport: mixing of shape {K.shape} for {channels} bands; one row a band")
    if not np.isfinite(K).all():
        raise SimulationError(
            f"colour transport: {int((~np.isfinite(K)).sum())} values of the mixing not finite; "
            "look at what it was measured from"
        )
    condition = float(np.linalg.cond(K))
    if condition > CONDITION_LIMIT:
        raise SimulationError(
            f"colour transport: condition {condition:.3g} of the mixing, the limit is {CONDITION_LIMIT:.0e}: two "
            "channels look alike to the camera; use a grey transport, or a camera with other filters"
        )
    return K
