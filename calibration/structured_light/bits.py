"""Words read from pairs of frames: which is the brighter one, and where noise leaves that open."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.arrays import BoolArray, Frame
from calibration.structured_light.frames import part
from calibration.structured_light.gray import Words

_BYTE = 8

Limit = float | NDArray[np.floating]


def read_positions(
    pairs: Sequence[tuple[Frame, Frame]],
    limit: NDArray[Any],
    table: Words,
    *,
    rows: slice,
    brightest: Frame,
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
    brightest : (rows, W)
        The largest values of the pixels, in which those of these frames are noted. [dn]
    """
    word, open_bits = _words(pairs, limit, rows, brightest)
    position = table.take(word, mode="clip")
    twice = np.add(position, position)
    weak = open_bits != 0
    borders = np.flatnonzero(weak & ((open_bits & (open_bits - 1)) == 0))
    here, there = position.ravel()[borders], table[(word ^ open_bits).ravel()[borders]]
    twice.ravel()[borders] = here + there
    weak.ravel()[borders] = np.abs(here.astype(np.int32) - there) > 1
    return twice, np.asarray(weak)


def _words(
    pairs: Sequence[tuple[Frame, Frame]], limit: NDArray[Any], rows: slice, brightest: Frame
) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """Words whose bits say which pictures are brighter than their others, and words of the bits that are open.

    Bits are gathered in bytes, of which more fit into the cache than of words. On the way the largest value of each
    pixel is noted in `brightest`.
    """
    first = pairs[0][0][rows]
    bits, open_bits = (np.zeros((2, *first.shape), dtype=np.uint8) for _ in range(2))
    flag, limit_here = np.empty(first.shape, dtype=bool), part(limit, rows)
    for nth, (lit, other) in enumerate(pairs):
        byte = int(nth >= len(pairs) - _BYTE)
        a, b = lit[rows], other[rows]
        _append(bits[byte], np.greater(a, b, out=flag))
        _append(open_bits[byte], np.less(difference(a, b), limit_here, out=flag))
        np.maximum(brightest, a, out=brightest)
        np.maximum(brightest, b, out=brightest, casting="unsafe")
    high_and_low = (each.astype(np.uint16) for each in (bits, open_bits))
    word, open_word = ((both[0] << _BYTE) | both[1] for both in high_and_low)
    return word, open_word


def _append(bits: NDArray[np.uint8], flag: BoolArray) -> None:
    np.add(bits, bits, out=bits)  # several times quicker than a shift
    np.bitwise_or(bits, flag.view(np.uint8), out=bits)


def difference(lit: Frame, other: Frame) -> Frame:
    """Return by how much two frames differ, in the frames' own kind where they are whole numbers."""
    if lit.dtype in (np.uint8, np.uint16) and other.dtype == lit.dtype:
        return np.asarray(cv2.absdiff(lit, other))
    return np.asarray(np.abs(lit.astype(np.float32) - other))


def limit_of_kind(limit: Limit, kind: np.dtype[Any]) -> NDArray[Any]:
    """Return a limit that whole differences can be held against without being converted."""
    if kind not in (np.uint8, np.uint16):
        return np.asarray(limit, dtype=np.float32)
    most = 255 if kind == np.uint8 else 65535
    return np.asarray(np.clip(np.ceil(limit), 0, most), dtype=kind)


def middle(bright: Frame, dark: Frame) -> Frame:
    """(H, W) mean of white and black; whole for whole numbers, which are above it or not as they are above the mean."""
    if bright.dtype.kind == "u" and bright.dtype == dark.dtype:
        return np.asarray(dark + (bright - np.minimum(bright, dark)) // 2, dtype=bright.dtype)
    return (bright.astype(np.float32) + dark.astype(np.float32)) * np.float32(0.5)
