"""Gray codes: words for positions, one bit changing from each position to the next, and their patterns.

The binary-reflected code is what everybody's patterns use. Its coarse planes light whole halves of a room,
and in a closed room the light that comes back from there can exceed a wall's own direct light: the bit reads
wrong. The *long-run* code has in every plane only stripes of some 7 to 30 pixels (10 bits), so a pattern and
its inverse put the same global light everywhere and differ by direct light alone; no stripe is finer than a
few pixels. (Long-run Gray codes: L. Goddyn and P. Gvozdjak, Binary gray codes with long bit runs, Electron.
J. Combin. 10, 2003; their use against interreflection: M. Gupta et al., Structured light 3D scanning in the
presence of global illumination, CVPR 2011.)

The *XOR* codes of the same paper combine the coarse planes of the binary-reflected code with a fine wave by exclusive
or: only narrow stripes are projected, and combining once more gives the coarse planes. Here the wave's edges are where
coarse planes change, so that no stripe is narrower than the wave's: two pixels in `xor-02`, four in `xor-04`. (With the
finest plane itself for a wave, stripes of one pixel appear beside each change, and blur exchanges their neighbours.)
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from calibration.arrays import Codes
from calibration.errors import CalibrationError
from calibration.structured_light.patterns import WHITE, Pattern

CodeName = Literal["gray", "long-run", "xor-02", "xor-04"]
Axis = Literal["column", "row"]
Words = NDArray[np.uint16]

BOTH_AXES: tuple[Axis, ...] = ("column", "row")
_BASE_BIT: Mapping[str, int] = {"xor-02": 1, "xor-04": 2}
"""Of an XOR code: the binary digit that coarse planes are combined with; its stripes are 2 and 4 px wide."""

MAX_BITS = 14
_SMALL_RUNS = {1: 1, 2: 2, 3: 2, 4: 2, 5: 4}
"""Longest shortest run that a cyclic code of so many bits can have."""


def size_along(shape: tuple[int, int], axis: Axis) -> int:
    """Return how many positions there are along an axis of a picture (height, width)."""
    return shape[1 - BOTH_AXES.index(axis)]


def across(stripes: Codes, shape: tuple[int, int], axis: Axis) -> Codes:
    """(H, W) picture of stripes whose codes along an axis are given."""
    return np.broadcast_to(stripes if axis == "column" else stripes[:, None], shape).copy()


def bits_for(size_px: int) -> int:
    """Return the number of bits that tell `size_px` positions apart."""
    return max(1, (size_px - 1).bit_length())


def pattern_name(code: CodeName, axis: str, bit: int) -> str:
    """Return the name of the picture that shows a bit of an axis: `long-run-row-03`; its inverse has `-inverse`."""
    return f"{code}-{axis}-{bit:02d}"


def gray_code_patterns(
    shape: tuple[int, int],
    inverse: bool = True,
    code: CodeName = "gray",
    *,
    axes: Sequence[Axis] = BOTH_AXES,
    finest_bit: int = 0,
) -> Iterator[Pattern]:
    """Yield a binary code of the columns, then of the rows, most significant bit first.

    Parameters
    ----------
    shape : (height, width)
        Of the projector. [px]
    inverse : bool
        After each picture also its complement.
    code : {"gray", "long-run", "xor-02", "xor-04"}
        Which one.
    axes : sequence of {"column", "row"}
        What is coded.
    finest_bit : int
        Bits below this one are left out.

    Yields
    ------
    Pattern
        `gray-column-09`, `gray-column-09-inverse`, `long-run-row-03` …, codes (H, W); the number is the bit.
    """
    for axis in axes:
        size = size_along(shape, axis)
        word = words(code, bits_for(size))[:size]
        for bit in reversed(range(min(finest_bit, bits_for(size) - 1), bits_for(size))):
            stripe = ((word >> bit) & 1).astype(np.uint8) * WHITE
            codes = across(stripe, shape, axis)
            yield Pattern(pattern_name(code, axis, bit), codes)
            if inverse:
                yield Pattern(f"{pattern_name(code, axis, bit)}-inverse", WHITE - codes)


def words(code: CodeName, bits: int) -> Words:
    """(2**bits,) the word of each position.

    Raises
    ------
    CalibrationError
        For an unknown code or more than 14 bits.
    """
    if not 1 <= bits <= MAX_BITS:
        raise CalibrationError(f"a Gray code of {bits} bits; give 1 to {MAX_BITS}")
    if code == "gray":
        position = np.arange(2**bits)
        return np.asarray(position ^ (position >> 1), dtype=np.uint16)
    if code == "long-run":
        return np.array(_long_run(bits), dtype=np.uint16)
    if code in _BASE_BIT:
        return _combined(bits, _BASE_BIT[code])
    raise CalibrationError(f"unknown code {code!r}; there are {', '.join(repr(name) for name in get_args(CodeName))}")


def _combined(bits: int, base_bit: int) -> Words:
    """Words of the binary-reflected code whose coarse bits are combined with a fine wave by exclusive or.

    The wave is a binary digit of the position, whose edges are where coarse bits change, so that no stripe is narrower
    than the wave's. It is not shown: over an even number of combined bits it cancels, and their exclusive or is the
    binary digit of the finest of them.
    """
    position = np.arange(2**bits)
    finest = base_bit + (bits - base_bit) % 2
    coarse = (1 << bits) - (1 << min(finest, bits))
    wave = (position >> base_bit) & 1
    return np.asarray(position ^ (position >> 1) ^ (wave * coarse), dtype=np.uint16)


def positions(code: CodeName, bits: int) -> Words:
    """(2**bits,) the position of each word."""
    table = np.empty(2**bits, dtype=np.uint16)
    table[words(code, bits)] = np.arange(2**bits)
    return table


@cache
def _long_run(bits: int) -> tuple[int, ...]:
    if bits <= 5:
        return _searched(bits, _SMALL_RUNS[bits])
    high = (bits + 1) // 2
    return _interleaved(_long_run(high), _long_run(bits - high), high)


def _searched(bits: int, run: int) -> tuple[int, ...]:
    """Search depth-first a cyclic code in which no bit changes twice within `run` steps."""
    size = 2**bits
    path, seen = [0], {0}
    flips: list[int] = []

    def extend() -> bool:
        if len(path) == size:
            last = (path[-1] ^ path[0]).bit_length() - 1
            closes = path[-1] ^ path[0] == 1 << last
            ring = [*flips, last] * 2
            return closes and all(ring[k] not in ring[k + 1 : k + run] for k in range(size))
        for bit in range(bits):
            word = path[-1] ^ (1 << bit)
            if word in seen or bit in flips[max(0, len(flips) - run + 1) :]:
                continue
            path.append(word)
            flips.append(bit)
            seen.add(word)
            if extend():
                return True
            seen.remove(word)
            path.pop()
            flips.pop()
        return False

    if not extend():
        raise CalibrationError(f"no cyclic Gray code of {bits} bits with runs of {run}; ask for shorter runs")
    return tuple(path)


def _interleaved(a: tuple[int, ...], b: tuple[int, ...], a_bits: int) -> tuple[int, ...]:
    """Walk two cyclic codes in turn, so that every pair of their words comes once.

    On the torus of the positions (i, j) a step goes on in code a or in code b; which one depends on (i + j)
    modulo the shorter length only, an odd number of times on a: then the walk visits every pair once.
    """
    n = len(b)
    odd = n // 2 + 1 if n > 1 else 1
    steps_a = {(k * n) // odd for k in range(odd)} if n > 1 else {0}
    path, i, j = [], 0, 0
    for _ in range(len(a) * n):
        path.append(a[i] | (b[j] << a_bits))
        if (i + j) % n in steps_a:
            i = (i + 1) % len(a)
        else:
            j = (j + 1) % n
    return tuple(path)
