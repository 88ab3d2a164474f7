"""Positive numbers in 16 bits, as the frame kernel reads them: 15 octaves of 12 bits, and 0.

A number in units of the largest is stored as the 16 bits behind the sign of a single-precision number of least
exponents: the kernel gets it back, times a power of two, by one shift. Rounding: at most 2⁻¹³ of the number itself.
What is above 0 stays so: it is no smaller than 2⁻¹⁵. What is beyond 4096 times the median is as large as that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.arrays import FloatArray

SHIFT = 11
"""Bits of a single-precision number that are dropped."""
ONE = 2.0**111
"""What the largest number is, over the one whose bits it has."""
LEAST = 2.0**-15
"""Share of the largest that the least number above 0 is."""
MOST = 4096
"""Times the median, what the largest is at most."""
_LINE_BYTES = 64
_LARGEST = 65535
"""Its value is a little below 1, that of the unit."""


@dataclass(frozen=True, eq=False)
class Packed:
    """Numbers 0 ... largest in 16 bits: one layer for all bands, or one each."""

    bits: NDArray[np.uint16]
    """(layers, H, W)."""
    unit: FloatArray
    """(layers,) value of 1 in each layer; 0 for a layer of zeros."""

    @property
    def values(self) -> FloatArray:
        """(layers, H, W) the numbers again."""
        single = (self.bits.astype(np.uint32) << SHIFT).view(np.float32)
        return np.asarray(single.astype(np.float64) * ONE * self.unit[:, None, None])


def packed(values: FloatArray) -> Packed:
    """Return numbers of 0 and more, (layers, H, W), each layer rounded to its own unit."""
    unit = np.array([_largest(layer) / (1 - 2.0**-13) for layer in values])
    bits = _aligned(values.shape)
    for layer, per, out in zip(values, unit, bits, strict=True):
        share = np.where(layer > 0, np.clip(layer / (per or 1.0), LEAST, 1.0), 0.0)
        single = (share / ONE).astype(np.float32).view(np.uint32)
        out[:] = np.minimum((single + np.uint32(1 << (SHIFT - 1))) >> SHIFT, _LARGEST)
    return Packed(bits, unit)


def _aligned(shape: tuple[int, ...]) -> NDArray[np.uint16]:
    """An empty array that begins with a cache line, so that few loads of the kernel reach into two."""
    size, per_line = int(np.prod(shape)), _LINE_BYTES // 2
    room = np.empty(size + per_line, dtype=np.uint16)
    first = -room.ctypes.data % _LINE_BYTES // 2
    return room[first : first + size].reshape(shape)


def _largest(layer: FloatArray) -> float:
    some = layer[layer > 0]
    return float(min(some.max(), MOST * np.median(some))) if some.size else 0.0


_LARGEST_ENTRY = 32767


@dataclass(frozen=True, eq=False)
class PackedRows:
    """A stack of dense matrices in 16 bits: each row in units of its own."""

    entries: NDArray[np.int16]
    """(layers, W, L)."""
    unit: NDArray[np.float32]
    """(layers, W) value of 1 in each row."""

    @property
    def values(self) -> FloatArray:
        """(layers, W, L) the numbers again."""
        return np.asarray(self.entries * self.unit[..., None].astype(np.float64))


def packed_rows(matrices: FloatArray) -> PackedRows:
    """Return matrices (layers, W, L) rounded to at most a 65,534th of the largest magnitude of the row."""
    unit = (np.abs(matrices).max(axis=2, initial=0.0) / _LARGEST_ENTRY).astype(np.float32)
    per = np.where(unit > 0, unit, 1).astype(np.float64)
    entries = np.clip(np.rint(matrices / per[..., None]), -_LARGEST_ENTRY, _LARGEST_ENTRY)
    return PackedRows(entries.astype(np.int16), unit)
