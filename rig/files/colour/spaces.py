"""Colour spaces: curves from a file's numbers to light, and a matrix from that light to that of sRGB."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.files.colour.srgb import linear_of_srgb

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
Curve = Callable[[FloatArray], FloatArray]
"""Linear light of a file's numbers, both 0 … 1."""
Chromaticities = tuple[float, ...]
"""CIE x and y of red, green, blue and white: eight numbers."""

SRGB_PRIMARIES: Chromaticities = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
"""ITU-R BT.709, as sRGB has them."""
P3_PRIMARIES: Chromaticities = (0.68, 0.32, 0.265, 0.69, 0.15, 0.06, 0.3127, 0.3290)
"""Display P3 (SMPTE EG 432-1 with the white of sRGB)."""
ADOBE_PRIMARIES: Chromaticities = (0.64, 0.33, 0.21, 0.71, 0.15, 0.06, 0.3127, 0.3290)
"""Adobe RGB (1998)."""
ADOBE_GAMMA = 2.19921875
"""2 51/256, as the encoding of Adobe RGB (1998) defines it."""
D50_XYZ = np.array([0.9642, 1.0, 0.8249])
"""White of the space that colour profiles connect to (ICC.1, 7.2.16)."""
_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
"""Cone responses in which whites are adapted (ICC.1, annex E)."""
_SAME_CURVE, _SAME_MATRIX = 0.003, 0.004
"""Two spaces are one below these: less than a code of 8 bits moves. Rounded profiles of sRGB differ by half of it."""
_ROUNDING = 0.5 / 255
"""By which light may leave 0 … 1 for the rounding of codes alone."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ColourSpace:
    """What the numbers of a picture mean."""

    name: str
    """As people know it."""
    curves: tuple[Curve, ...]
    """One for grey, three for red, green and blue."""
    to_srgb: FloatArray
    """(3, 3), from this space's linear light to that of sRGB, white to white; not used for grey."""

    @cached_property
    def is_linear(self) -> bool:
        """Whether numbers are light as they are."""
        return self._curves_are(np.asarray)

    @cached_property
    def has_srgb_colours(self) -> bool:
        """Whether its red, green and blue are those of sRGB."""
        return len(self.curves) == 1 or bool(np.abs(self.to_srgb - np.eye(3)).max() < _SAME_MATRIX)

    @cached_property
    def is_srgb(self) -> bool:
        """Whether it is sRGB under whatever name."""
        return self.has_srgb_colours and self._curves_are(linear_of_srgb)

    def _curves_are(self, other: Curve) -> bool:
        share = np.linspace(0.0, 1.0, 256)
        return all(bool(np.abs(curve(share) - other(share)).max() < _SAME_CURVE) for curve in self.curves)


def gamma_curve(exponent: float) -> Curve:
    """Return light as a power of the number."""
    return lambda share: np.asarray(np.maximum(share, 0.0) ** exponent)


def from_chromaticities(name: str, primaries: Chromaticities, curve: Curve) -> ColourSpace:
    """Return a space whose colours are told as CIE x and y.

    Raises
    ------
    ValueError
        The chromaticities span no colours.
    """
    curves = (curve, curve, curve)
    return ColourSpace(name=name, curves=curves, to_srgb=srgb_of_d50(d50_of_chromaticities(primaries)))


def d50_of_chromaticities(primaries: Chromaticities) -> FloatArray:
    """Return (3, 3) from linear light to XYZ whose white is adapted to D50.

    Raises
    ------
    ValueError
        The chromaticities span no colours.
    """
    x, y = np.asarray(primaries, dtype=np.float64).reshape(4, 2).T
    if not np.isfinite([x, y]).all() or (np.abs(y) < 1e-6).any():
        raise ValueError("a chromaticity is 0 or no number")
    xyz = np.stack([x / y, np.ones(4), (1 - x - y) / y])
    if abs(np.linalg.det(xyz[:, :3])) < 1e-6:
        raise ValueError("the chromaticities lie on one line")
    own = xyz[:, :3] * np.linalg.solve(xyz[:, :3], xyz[:, 3])
    scale = (_BRADFORD @ D50_XYZ) / (_BRADFORD @ xyz[:, 3])
    return np.asarray(np.linalg.inv(_BRADFORD) @ (scale[:, None] * _BRADFORD) @ own)


def srgb_of_d50(matrix: FloatArray) -> FloatArray:
    """Return (3, 3) to the linear light of sRGB, of a matrix to XYZ whose white is D50."""
    return np.asarray(np.linalg.solve(d50_of_chromaticities(SRGB_PRIMARIES), matrix))


def srgb_light(picture: NDArray[Any], space: ColourSpace) -> tuple[Float32Array, float]:
    """Return a picture's light as sRGB has it, 0 … 1, and the share of its pixels whose colours sRGB lacks.

    Colours that sRGB lacks are brought to its border, channel by channel; numbers with a point may be above 1.

    Parameters
    ----------
    picture
        (H, W, C), C = 1 or 3: codes of 8 or 16 bits, or numbers with a point.
    space
        Of the picture, with C curves.
    """
    whole = 1.0 if picture.dtype.kind == "f" else float(np.iinfo(picture.dtype).max)
    light = np.empty(picture.shape, np.float32)
    for k, curve in enumerate(space.curves):
        if picture.dtype.kind == "f":
            light[..., k] = curve(picture[..., k].astype(np.float64))
        else:
            table = curve(np.arange(int(whole) + 1) / whole).astype(np.float32)
            light[..., k] = table[picture[..., k]]
    if len(space.curves) == 3:
        light = light @ space.to_srgb.T.astype(np.float32)
    highest = np.inf if picture.dtype.kind == "f" else 1.0
    beyond = ((light < -_ROUNDING) | (light > highest + _ROUNDING)).any(axis=-1)
    return np.clip(light, 0.0, highest), float(beyond.mean())
