"""One band of a frame model: its transport pixel by pixel, and the inverse of what patches send each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array, diags_array

from sim.arrays import FloatArray, IntArray
from sim.compensation.split_transport import diagonal_of
from sim.form_factors import FormFactors
from sim.frame.learned import OnPatches, on_patches
from sim.light.interreflection_operator import patch_to_patch
from sim.light.radiosity import Radiosity
from sim.light.transport import LightTransport


@dataclass(frozen=True, eq=False)
class BandOfPixels:
    """One band's transport, pixel by pixel."""

    known: OnPatches
    inverse: FloatArray
    """(n,) 1 / D."""
    view_gain: FloatArray
    """(n,) seen reflectance over D."""

    @property
    def transport(self) -> LightTransport:
        """The transport whose patches pixels see."""
        return self.known.transport

    @property
    def reflectance(self) -> FloatArray:
        """(P,) of its patches."""
        return self.transport.radiosity.reflectance


def band_of_pixels(transport: LightTransport) -> BandOfPixels:
    """Return a band's transport pixel by pixel, with what photographs taught of it put on patches."""
    diagonal, known = diagonal_of(transport), on_patches(transport)
    inverse = np.divide(1.0, diagonal, out=np.zeros_like(diagonal), where=diagonal > 0)
    seen = known.transport.view @ known.transport.radiosity.reflectance
    return BandOfPixels(known, inverse, np.asarray(seen * inverse))


def inverse_of_sums(
    band: BandOfPixels, sums: csr_array, lit: IntArray, viewed: IntArray, *, share: FloatArray, gain_ratio: float
) -> FloatArray:
    """Return (V, L) from sums over a patch's pixels to the irradiance of the viewed patches."""
    transport = band.transport
    S = csr_array(diags_array(share) @ sums)
    loop = (S @ diags_array(band.inverse) @ csr_array(transport.view)).tocsc()[:, viewed].toarray()
    H = _interreflection(transport, lit, viewed) + band.known.by_view[viewed] @ band.known.by_patch[:, lit]
    r = np.linalg.solve(np.eye(len(viewed)) + H @ loop, H)
    rho = band.reflectance[viewed]
    per_irradiance = np.divide(gain_ratio, rho, out=np.zeros_like(rho), where=rho > 0)
    return np.asarray(per_irradiance[:, None] * r * share)


def _interreflection(transport: LightTransport, lit: IntArray, viewed: IntArray) -> FloatArray:
    """(W, L) (I - G)⁻¹ G from lit to viewed patches."""
    radiosity = transport.radiosity
    if isinstance(radiosity.form_factors, FormFactors):
        # A factor pays for so many right-hand sides.
        radiosity = Radiosity(radiosity.form_factors, radiosity.reflectance, solver="direct")
    return patch_to_patch(radiosity, lit, viewed)
