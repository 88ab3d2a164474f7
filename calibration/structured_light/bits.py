"""Words read from pairs of frames: which is the brighter one, and where noise leaves that open."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.arrays import BoolArray, Frame
from calibration.structured_light.frames import WHOLE, Clipping, part
from calibration.structured_light.gray import Words

_BYTE = 8


def read_positions(
    pairs: Sequence[tuple[Frame, Frame]],
    limit: NDArray[Any],
    table: Words,
    *,
    rows: slice,
    clipping: Clipping | None = None,
) -> tuple[NDArray[np.uint16], BoolArray]:
    """Twice the positions that some rows show, and the pixels that some bit leaves open.

    One open bit is no harm if both its values give neighbouring positions: the pixel lies on the border
    between them, and that border is its position.

    Parameters
    ----------
    pairs : sequence of two (H, W)
        Of each bit, the most significant first: its frame, and the one that it has to be brighter than. [dn]
    limit : () or (H, W)
        A bit of which the two differ by less is open; a number of the frames' kind. [dn]
    table : (words,)
        The position of each word.
    rows : slice
    clipping : Clipping, optional
        In which the clipped pixels of these rows are noted.
    """
    word, open_bits = _words(pairs, limit, rows, clipping)
    twice = (table + table).take(word, mode="clip")
    weak = open_bits != 0
    borders = np.flatnonzero(weak & ((open_bits & (open_bits - np.uint16(1))) == 0))
    words = word.ravel()[borders]
    here, there = table[words], table[words ^ open_bits.ravel()[borders]]
    twice.ravel()[borders] = here + there
    weak.ravel()[borders] = np.abs(here.astype(np.int32) - there) > 1
    return twice, np.asarray(weak)


def _words(
    pairs: Sequence[tuple[Frame, Frame]], limit: NDArray[Any], rows: slice, clipping: Clipping | None
) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """Words whose bits say which pictures are brighter than their others, and words of the bits that are open.

    Bits are gathered in bytes, of which more fit into the cache than of words. On the way clipped pixels are noted:
    later, their frames would have to come from the memory again.
    """
    shape = pairs[0][0][rows].shape
    gathered = np.zeros((2, 2, *shape), dtype=np.uint8)  # high and low byte: bits, and bits that are open
    flags, limit_here = np.empty((2, *shape), dtype=bool), part(limit, rows)
    brighter, open_ = flags
    apart = np.empty(shape, dtype=pairs[0][0].dtype)
    for nth, (lit, other) in enumerate(pairs):
        a, b = lit[rows], other[rows]
        np.greater(a, b, out=brighter)
        np.less(difference(a, b, apart), limit_here, out=open_)
        byte = gathered[int(nth >= len(pairs) - _BYTE)]
        np.add(byte, byte, out=byte)  # several times quicker than a shift
        np.bitwise_or(byte, flags.view(np.uint8), out=byte)
        if clipping is not None:
            clipping.note(a, rows)
            clipping.note(b, rows)
    high, low = gathered
    return _joined(high[0], low[0]), _joined(high[1], low[1])


def _joined(high: NDArray[np.uint8], low: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """(H, W) words of two bytes."""
    return np.asarray(cv2.merge([low, high]).reshape(*low.shape, 2).view("<u2")[..., 0], dtype=np.uint16)


def difference(lit: Frame, other: Frame, out: Frame | None = None) -> Frame:
    """Return by how much two frames differ, in the frames' own kind where they are whole numbers: then in `out`."""
    if lit.dtype.char in WHOLE and other.dtype.char == lit.dtype.char:
        return cv2.absdiff(lit, other, out)
    return np.asarray(np.abs(lit.astype(np.float32) - other))


def middle(bright: Frame, dark: Frame) -> Frame:
    """(H, W) mean of white and black; whole for whole numbers, which are above it or not as they are above the mean."""
    if bright.dtype.kind == "u" and bright.dtype == dark.dtype:
        return np.asarray(dark + (bright - np.minimum(bright, dark)) // 2, dtype=bright.dtype)
    return (bright.astype(np.float32) + dark.astype(np.float32)) * np.float32(0.5)
