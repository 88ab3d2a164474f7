"""Positive numbers in 16 bits, as the frame kernel reads them: 8 octaves of 13 bits, and a linear toe.

A number v in units of the largest is stored as the upper bits of the single-precision number v + TOE. The kernel
gets it back with a shift, an addition and a subtraction. Rounding: at most 2⁻¹⁴ of v + TOE.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.scene import FloatArray

SHIFT = 10
"""Bits of a single-precision number that are dropped."""
TOE = 2.0**-8
_FIRST = int(np.float32(TOE).view(np.uint32))
_LARGEST = 65535
"""Its value is a little below 2⁸ TOE - TOE, that of the unit."""


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
        single = ((self.bits.astype(np.uint32) << SHIFT) + np.uint32(_FIRST)).view(np.float32)
        return np.asarray((single.astype(np.float64) - TOE) * self.unit[:, None, None])


def packed(values: FloatArray) -> Packed:
    """Round numbers of 0 and more, (layers, H, W), each layer to its own unit."""
    largest = values.reshape(len(values), -1).max(axis=1)
    unit = largest / (1 - 2 * TOE)
    bits = np.empty(values.shape, dtype=np.uint16)
    for layer, per, out in zip(values, unit, bits, strict=True):
        single = (layer / (per or 1.0) + TOE).astype(np.float32).view(np.uint32)
        out[:] = np.minimum((single - np.uint32(_FIRST) + np.uint32(1 << (SHIFT - 1))) >> SHIFT, _LARGEST)
    return Packed(bits, unit)


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
    """Round matrices (layers, W, L) to at most a 65,534th of the largest magnitude of the row."""
    unit = (np.abs(matrices).max(axis=2, initial=0.0) / _LARGEST_ENTRY).astype(np.float32)
    per = np.where(unit > 0, unit, 1).astype(np.float64)
    entries = np.clip(np.rint(matrices / per[..., None]), -_LARGEST_ENTRY, _LARGEST_ENTRY)
    return PackedRows(entries.astype(np.int16), unit)
