"""Pictures that are projected to measure something; each has a name that says how to read it back.

This is the one set of such pictures: sessions and the self-check show the same.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from calibration.arrays import Codes
from calibration.errors import CalibrationError

WHITE = 255
Side = Literal["left", "right", "top", "bottom"]
_LEAST_BLOCK = 40
"""Code of a dark block: not black, so that noise and black level of the display matter less than its edges."""
_BLOCK_SEED = 7


@dataclass(frozen=True, eq=False)
class Pattern:
    """A picture in projector codes."""

    name: str
    codes: Codes
    """(H, W), or (H, W, 3) in colour."""


def flat(shape: tuple[int, int], code: int, name: str | None = None) -> Pattern:
    """Return a picture of one code everywhere.

    Parameters
    ----------
    shape : (height, width)
        Of the projector. [px]
    code : int
        From 0 to 255.
    name : str, optional
        Of the pattern; default: `level-128` for code 128.

    Returns
    -------
    Pattern
        Its codes are (H, W).

    Raises
    ------
    CalibrationError
        If the code is outside 0 … 255.
    """
    if not 0 <= code <= WHITE:
        raise CalibrationError(f"code {code} is outside 0 … {WHITE}; give one within it")
    return Pattern(name or f"level-{code:03d}", np.full(shape, code, dtype=np.uint8))


def level_patterns(shape: tuple[int, int], codes: Sequence[int]) -> Iterator[Pattern]:
    """Yield flat pictures, one a code."""
    return (flat(shape, code) for code in codes)


def primary(shape: tuple[int, int], channel: int, name: str, channels: int = 3) -> Pattern:
    """Return a picture of one channel of the projector at its largest code, the others at 0.

    Parameters
    ----------
    shape : (height, width)
        Of the projector. [px]
    channel : int
        Index of the channel.
    name : str
        Of the pattern.
    channels : int
        How many channels the projector has.

    Returns
    -------
    Pattern
        Its codes are (H, W, channels).
    """
    codes = np.zeros((*shape, channels), np.uint8)
    codes[..., channel] = WHITE
    return Pattern(name, codes)


def checker(shape: tuple[int, int], size_px: int, shift_px: tuple[int, int] = (0, 0)) -> Codes:
    """Return a checkerboard of white and black squares.

    Parameters
    ----------
    shape : (height, width)
        Of the projector. [px]
    size_px : int
        Side of a square.
    shift_px : (down, right)
        By which the squares are moved up and left; a shift of one square in one direction gives the complement.

    Returns
    -------
    (H, W) uint8
        0 or 255; 255 at the first pixel of an unshifted board.
    """
    row, column = np.arange(shape[0])[:, None], np.arange(shape[1])[None, :]
    on = ((row + shift_px[0]) // size_px + (column + shift_px[1]) // size_px) % 2 == 0
    return np.asarray(on.astype(np.uint8) * WHITE)


def checker_patterns(shape: tuple[int, int], size_px: int = 8, shifts: int = 25) -> Iterator[Pattern]:
    """Yield checkers that are moved evenly over their period in both directions.

    Parameters
    ----------
    shape : (height, width)
        Of the projector. [px]
    size_px : int
        Side of a square.
    shifts : int
        How many pictures: a square number.

    Yields
    ------
    Pattern
        `checker-00`, `checker-01` …, codes (H, W).

    Raises
    ------
    CalibrationError
        If `shifts` is not a square number, or the shifts are finer than a pixel.

    References
    ----------
    S. K. Nayar, G. Krishnan, M. D. Grossberg, R. Raskar, Fast separation of direct and global components of a scene
    using high frequency illumination, ACM Trans. Graph. 25(3), 2006, section 3.
    """
    side = round(shifts**0.5)
    if side * side != shifts or side < 2 or side > 2 * size_px:
        raise CalibrationError(
            f"{shifts} checker shifts of {size_px} px: give a square number from 4 to {(2 * size_px) ** 2}"
        )
    offsets = [round(k * 2 * size_px / side) for k in range(side)]
    for index in range(shifts):
        shift_px = offsets[index // side], offsets[index % side]
        yield Pattern(f"checker-{index:02d}", checker(shape, size_px, shift_px))


def left_half(shape: tuple[int, int]) -> Codes:
    """(H, W) codes: white on the left half, black on the right; the complement is 255 minus it."""
    codes = np.zeros(shape, np.uint8)
    codes[:, : shape[1] // 2] = WHITE
    return codes


def strip(shape: tuple[int, int], side: Side, inset_px: int, width_px: int) -> Codes:
    """(H, W) codes: a white strip `width_px` wide along a side of the picture, `inset_px` in; black elsewhere."""
    codes = np.zeros(shape, np.uint8)
    turned = {"left": codes.T, "right": codes.T[::-1], "top": codes, "bottom": codes[::-1]}[side]
    turned[inset_px : inset_px + width_px] = WHITE
    return codes


def random_blocks(shape: tuple[int, int], along: int) -> Codes:
    """(H, W) codes: square blocks, light or dark at random but always the same, `along` of them on the longer side."""
    size = max(max(shape) // along, 1)
    random = np.random.default_rng(_BLOCK_SEED)
    small = random.integers(0, 2, (shape[0] // size + 1, shape[1] // size + 1)) * (WHITE - _LEAST_BLOCK) + _LEAST_BLOCK
    whole = np.repeat(np.repeat(small, size, axis=0), size, axis=1)
    return np.asarray(whole[: shape[0], : shape[1]], dtype=np.uint8)
