"""Words of a binary code, read from pairs of photographs: the definition of the kernel's `read_words`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calibration.arrays import BoolArray, Frame
from calibration.structured_light.bits import OWN_LIGHT_BITS, SURE_SHARE, BitPairs
from calibration.structured_light.correspondence import PixelReason


def read_words(bits: BitPairs, reason: NDArray[np.uint8]) -> tuple[NDArray[np.uint16], NDArray[np.uint8]]:
    """Return twice the position that each pixel shows, and why it has none; of several reasons the lowest.

    Parameters
    ----------
    bits : BitPairs
        Photographs of one axis.
    reason : (H, W)
        What is known of the pixels before, as PixelReason.
    """
    apart = [_apart(lit, other) for lit, other in zip(bits.lit, bits.other, strict=True)]
    open_ = [each < bits.limit for each in apart]
    word = _word([lit > other for lit, other in zip(bits.lit, bits.other, strict=True)])
    other_word = word ^ np.where(np.sum(open_, axis=0) == 1, _word(open_), 0)
    here, there = (bits.table[each].astype(np.int32) for each in (word, other_word))
    weak = (np.sum(open_, axis=0) > 1) | (np.abs(here - there) > 1)
    if bits.black is not None:
        weak |= _outshone(bits, apart)
    twice = (here + there).astype(np.uint16)
    result = reason.copy()
    for cause, where in (
        (PixelReason.OUT_OF_RANGE, (twice < bits.first) | (twice >= bits.end)),
        (PixelReason.UNCERTAIN_BIT, weak),
        (PixelReason.SATURATED, _clipped(bits)),
    ):
        result[where & ((result == PixelReason.VALID) | (result > cause))] = cause
    return twice, result


def _apart(one: Frame, other: Frame) -> Frame:
    """By how much two frames differ, in their own kind."""
    return np.asarray(np.maximum(one, other) - np.minimum(one, other))


def _word(bits: Sequence[BoolArray]) -> NDArray[np.int32]:
    """(H, W) words whose most significant bit comes first."""
    word = np.zeros(bits[0].shape, dtype=np.int32)
    for bit in bits:
        word = 2 * word + bit
    return word


def _outshone(bits: BitPairs, apart: Sequence[Frame]) -> BoolArray:
    """Tell which pixels get more light from elsewhere than from the projector in a coarse bit.

    What is a pixel's own, the next finer bits say: of three differences the middle one.
    """
    own = np.median(apart[bits.wide : bits.wide + OWN_LIGHT_BITS], axis=0).astype(np.float32)
    own = own * np.float32(SURE_SHARE) + np.asarray(bits.black, dtype=np.float32)
    darker = [np.minimum(lit, other) for lit, other in zip(bits.lit[: bits.wide], bits.other, strict=False)]
    return np.asarray(np.max(darker, axis=0).astype(np.float32) >= own)


def _clipped(bits: BitPairs) -> BoolArray:
    if bits.saturation is None:
        return np.zeros(bits.lit[0].shape, dtype=bool)
    return np.asarray(np.max([*bits.lit, *bits.other], axis=0) >= bits.saturation)
