"""A grey or colour transport as the strategies use it: images (n, C), direct light by pixel, the rest by patch.

A projector's own blur comes before direct light, which is then D of the blurred picture.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from sim.arrays import FloatArray
from sim.errors import SimulationError
from sim.light.colour import ColourTransport
from sim.light.interreflection_operator import InterreflectionOperator
from sim.light.picture_blur import PictureBlur
from sim.light.transport import LightTransport

Transport = LightTransport | ColourTransport
"""What every strategy takes; its bands are square with diagonal direct light (the projector's view)."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SplitTransport:
    """T p = D W K p + V H S K p, band by band; a grey transport has one band and K = 1, a sharp one W = 1.

    Images (n, C) are kept band after band in memory, for the sparse products take one band at a time.
    """

    bands: tuple[LightTransport, ...]
    mixing: FloatArray
    """(C, C) K."""
    diagonal: FloatArray
    """(n, C) D."""
    interreflections: tuple[InterreflectionOperator, ...]
    """The interreflection of each band."""
    blur: PictureBlur | None = None
    """W: of the projector's picture, in every band; None: it is sharp."""

    @cached_property
    def unmixing(self) -> FloatArray:
        """(C, C) inverse of K."""
        return np.asarray(np.linalg.inv(self.mixing))

    def mixed(self, p: FloatArray) -> FloatArray:
        """K p: the light of each band, (n, C), of a projector image."""
        return np.asarray((self.mixing @ p.T).T)

    def unmixed(self, light: FloatArray) -> FloatArray:
        """Inverse of :meth:`mixed`."""
        return np.asarray((self.unmixing @ light.T).T)

    def blurred(self, light: FloatArray) -> FloatArray:
        """W of each band's light, (n, C)."""
        return light if self.blur is None else self.blur.apply(light)

    def indirect(self, light: FloatArray) -> FloatArray:
        """V H S of each band's light: what comes back from the patches, (n, C)."""
        return self._by_band(
            [interreflection.apply(light[:, b]) for b, interreflection in enumerate(self.interreflections)]
        )

    def indirect_adjoint(self, c: FloatArray) -> FloatArray:
        """Sᵀ Hᵀ Vᵀ c of each band, (n, C)."""
        return self._by_band(
            [interreflection.adjoint(c[:, b]) for b, interreflection in enumerate(self.interreflections)]
        )

    def forward(self, p: FloatArray) -> FloatArray:
        """Camera image T p, (n, C)."""
        light = self.mixed(p)
        return np.asarray(self.diagonal * self.blurred(light) + self.indirect(light))

    def adjoint(self, c: FloatArray) -> FloatArray:
        """Tᵀ c, (n, C)."""
        direct = self.diagonal * c if self.blur is None else self.blur.adjoint(self.diagonal * c)
        return np.asarray((self.mixing.T @ (direct + self.indirect_adjoint(c)).T).T)

    def divide_by_direct(self, c: FloatArray) -> FloatArray:
        """K⁻¹ c / D: the projector image whose direct light is c, were it sharp; 0 where no direct light goes."""
        return self.unmixed(divide_where_lit(c, self.diagonal))

    def sharpened(self, p: FloatArray, steps: int) -> FloatArray:
        """Return an image (n, C) whose blurred picture is nearer p: p + Σ (1 - W)ᵏ p, k = 1 ... steps.

        What blur leaves little of is raised by no more than steps + 1: so noise is, too.

        References
        ----------
        P. H. van Cittert, Zum Einfluß der Spaltbreite auf die Intensitätsverteilung in Spektrallinien II,
        Zeitschrift für Physik 69, 1931.
        """
        sharp = p
        for _ in range(0 if self.blur is None else steps):
            sharp = sharp + (p - self.blurred(sharp))
        return sharp

    @staticmethod
    def _by_band(columns: list[FloatArray]) -> FloatArray:
        return np.stack(columns).T


def split_transport_of(transport: Transport) -> SplitTransport:
    """Take a transport apart, its projector taken for sharp; :func:`as_shown` adds the blur.

    Raises
    ------
    SimulationError
        If a band is not square with a diagonal D.
    """
    colour = isinstance(transport, ColourTransport)
    bands = transport.bands if isinstance(transport, ColourTransport) else (transport,)
    mixing = transport.mixing if colour else np.eye(1)
    diagonal = np.stack([diagonal_of(band) for band in bands]).T
    interreflections = tuple(band.interreflection for band in bands)
    return SplitTransport(bands=bands, mixing=mixing, diagonal=diagonal, interreflections=interreflections)


def as_shown(transport: SplitTransport) -> SplitTransport:
    """Return the transport with the projector's blur, if it has one: that of the bands, which share the projector."""
    blur = transport.bands[0].blur
    return transport if blur is None else replace(transport, blur=blur)


def direct_blocks(transport: SplitTransport, metric: FloatArray | None = None) -> FloatArray:
    """(n, C, C) Kᵀ D Ω D K, direct light's part of TᵀΩT; the metric Ω (n, C, C) is the identity unless given."""
    scaled = transport.diagonal[:, :, None] * transport.mixing
    return np.asarray(scaled.transpose(0, 2, 1) @ (scaled if metric is None else metric @ scaled))


def diagonal_of(transport: LightTransport) -> FloatArray:
    """(n,) diagonal of D.

    Raises
    ------
    SimulationError
        If the transport is not square with a diagonal D (the projector's view).
    """
    matrix: csr_array = transport.direct_matrix
    diagonal = np.asarray(matrix.diagonal())
    off_diagonal = matrix.shape[0] != matrix.shape[1] or matrix.count_nonzero() != np.count_nonzero(diagonal)
    if off_diagonal:
        raise SimulationError(
            f"compensation needs one camera value a projector pixel; this transport is {matrix.shape[0]} x "
            f"{matrix.shape[1]} with direct light off the diagonal: "
            "resample the camera to the projector's view first"
        )
    return diagonal


def divide_where_lit(numerator: FloatArray, diagonal: FloatArray) -> FloatArray:
    """Numerator / diagonal; 0 where no direct light goes."""
    return np.divide(numerator, diagonal, out=np.zeros_like(numerator), where=diagonal > 0)
