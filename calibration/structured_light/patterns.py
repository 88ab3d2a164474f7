"""Pictures that are projected to measure something; each has a name that says how to read it back."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.records import CalibrationError
from calibration.structured_light.gray import CodeName, bits_for, words

Codes = NDArray[np.uint8]
WHITE = 255


@dataclass(frozen=True, eq=False)
class Pattern:
    """A picture in projector codes."""

    name: str
    codes: Codes
    """(H, W), or (H, W, 3) in colour."""


def gray_code_patterns(shape: tuple[int, int], inverse: bool = True, code: CodeName = "gray") -> Iterator[Pattern]:
    """Gray code of the columns, then of the rows, most significant bit first.

    Names: `gray-column-09`, `gray-column-09-inverse`, `long-run-row-03` …; the number is the bit.
    """
    for axis, size in (("column", shape[1]), ("row", shape[0])):
        word = words(code, bits_for(size))[:size]
        for bit in reversed(range(bits_for(size))):
            stripe = ((word >> bit) & 1).astype(np.uint8) * WHITE
            codes = np.broadcast_to(stripe if axis == "column" else stripe[:, None], shape)
            yield Pattern(f"{code}-{axis}-{bit:02d}", codes.copy())
            if inverse:
                yield Pattern(f"{code}-{axis}-{bit:02d}-inverse", WHITE - codes)


def checker_patterns(shape: tuple[int, int], size_px: int = 8, shifts: int = 25) -> Iterator[Pattern]:
    """Checkers of `size_px`, moved evenly over their period in both directions.

    Raises
    ------
    CalibrationError
        If `shifts` is not a square number, or the shifts are finer than a pixel.
    """
    side = round(shifts**0.5)
    if side * side != shifts or side < 2 or side > 2 * size_px:
        raise CalibrationError(
            f"{shifts} checker shifts of {size_px} px: give a square number from 4 to {(2 * size_px) ** 2}"
        )
    offsets = [round(k * 2 * size_px / side) for k in range(side)]
    row, column = np.arange(shape[0])[:, None], np.arange(shape[1])[None, :]
    for index in range(shifts):
        dy, dx = offsets[index // side], offsets[index % side]
        on = ((row + dy) // size_px + (column + dx) // size_px) % 2 == 0
        yield Pattern(f"checker-{index:02d}", on.astype(np.uint8) * WHITE)


def flat(shape: tuple[int, int], code: int, name: str | None = None) -> Pattern:
    """One code everywhere; `level-128` unless named otherwise."""
    if not 0 <= code <= WHITE:
        raise CalibrationError(f"code {code} is outside 0 … {WHITE}")
    return Pattern(name or f"level-{code:03d}", np.full(shape, code, dtype=np.uint8))


def level_patterns(shape: tuple[int, int], codes: Sequence[int]) -> Iterator[Pattern]:
    """Flat pictures, one a code."""
    return (flat(shape, code) for code in codes)
