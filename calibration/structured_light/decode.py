"""Frames of a binary code to a correspondence map, with a reason for every pixel that has none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.arrays import BoolArray, Frame
from calibration.errors import CalibrationError
from calibration.structured_light.bits import BitPairs, half_share, middle
from calibration.structured_light.correspondence import ROUNDING_PX, Correspondence, PixelReason
from calibration.structured_light.frames import (
    Limit,
    extreme,
    follows_stripes,
    is_dark,
    mark,
    part,
    refuse_unequal,
)
from calibration.structured_light.gray import (
    BOTH_AXES,
    Axis,
    CodeName,
    bits_for,
    pattern_name,
    positions,
    size_along,
)
from calibration.structured_light.neighbours import isolated
from calibration.structured_light.strips import for_each_strip

_WIDE_BITS = 5
"""The coarsest ones, whose stripes are wider than a thirtieth of the picture and light different parts of a room."""
_LEAST_WIDE_BIT = 3
"""Of small pictures: finer stripes are as wide as blur."""


def decode_gray(
    frames: Mapping[str, Frame],
    projector_shape: tuple[int, int],
    *,
    white: Frame | None = None,
    black: Frame | None = None,
    contrast_limit: Limit,
    bit_limit: Limit,
    saturation: float | None = None,
    code: CodeName = "gray",
    first_code: tuple[int, int] = (0, 0),
    isolation_px: float = 8.0,
    axes: Sequence[Axis] = BOTH_AXES,
    finest_bit: int = 0,
    own_light: bool = False,
) -> Correspondence:
    """Find which projector pixel each camera pixel sees, from frames of a binary code.

    Parameters
    ----------
    frames : mapping of pattern name to (H, W)
        Frames as :func:`~calibration.structured_light.gray.gray_code_patterns` names them. [dn]
        Without inverses a bit is compared with what half the light comes to between black and white
        (:func:`~calibration.structured_light.bits.half_share`).
    projector_shape : (height, width)
    white, black : (H, W), optional
        Full frames; without them the largest and smallest value of each pixel over all frames.
    contrast_limit, bit_limit : float or (H, W)
        Least white minus black, and least difference of a pattern and its inverse, in the frames' unit.
    saturation : float, optional
        Values from here on are clipped.
    code : {"gray", "long-run", "xor-02", "xor-04"}
    first_code : (column, row)
        Code that is shown at the projector's first pixel.
    isolation_px : float
        A code further than this from the median of its neighbours is ISOLATED.
    axes : sequence of {"column", "row"}
        What was coded; the other coordinate is NaN.
    finest_bit : int
        Bits below this one were not shown, which only `gray` can do without: coordinates are the middles of
        2**finest_bit pixels.
    own_light : bool
        Of `gray` with inverses: a bit of wide stripes counts only where the darker of its two frames has less light
        than the pixel's own, which its fine stripes tell. Where both have more, light from other walls can have made
        either the brighter one, and no difference between them is proof.

    Returns
    -------
    Correspondence
        Whole projector pixels, halves on the border between two.

    Raises
    ------
    CalibrationError
        If frames are missing, or their shapes differ.
    """
    refuse_unequal({**frames, "white": white, "black": black})
    bright = white if white is not None else extreme(frames, np.maximum)
    dark = black if black is not None else extreme(frames, np.minimum)
    height, width = bright.shape
    bits = [
        _Bits.of(frames, axis, projector_shape, code=code, first=first_code, finest_bit=finest_bit) for axis in axes
    ]
    threshold = None
    if not any(name.endswith("-inverse") for name in frames):
        finest = [frames[each.names[-1]] for each in bits if each.names[-1] in frames]
        threshold = middle(bright, dark, half_share(finest, bright, dark, contrast_limit))
    read = [
        _AxisReading.of(
            frames,
            each,
            bit_limit=bit_limit,
            threshold=threshold,
            black=dark if own_light else None,
            saturation=saturation,
        )
        for each in bits
    ]
    reason = np.empty((height, width), dtype=np.uint8)
    flats = _Flats(bright=bright, dark=dark, contrast_limit=np.asarray(contrast_limit))
    for_each_strip(partial(_read_strip, read, flats=flats, reason=reason), reason.shape)
    if threshold is not None:
        _mark_unlit(reason, read, bright=bright, dark=dark)
    lonely = isolated([each.twice for each in read], reason == 0, 2 * isolation_px / 2**finest_bit)
    reason[lonely & (reason == PixelReason.VALID)] = PixelReason.ISOLATED
    return _correspondence(read, reason, projector_shape)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Bits:
    """The pictures of one axis."""

    code: CodeName
    axis: Axis
    count: int
    finest: int
    first_code: int
    size: int
    """Of the projector along the axis. [px]"""

    @classmethod
    def of(
        cls,
        frames: Mapping[str, Frame],
        axis: Axis,
        projector_shape: tuple[int, int],
        *,
        code: CodeName,
        first: tuple[int, int],
        finest_bit: int,
    ) -> _Bits:
        """Say which bits an axis has; the common Gray code may have been shown with more than the projector needs."""
        size, first_code = size_along(projector_shape, axis), first[BOTH_AXES.index(axis)]
        count = bits_for(size + first_code)
        while code == "gray" and pattern_name(code, axis, count) in frames:
            count += 1
        finest = min(finest_bit, count - 1)
        if finest and code != "gray":
            raise CalibrationError(
                f"{code} code of the {axis}s without its {finest} finest bits: only the code 'gray' can be read so"
            )
        return cls(code=code, axis=axis, count=count, finest=finest, first_code=first_code, size=size)

    @property
    def names(self) -> list[str]:
        """Names of the pictures, the most significant bit first."""
        return [pattern_name(self.code, self.axis, bit) for bit in reversed(range(self.finest, self.count))]

    @property
    def bounds(self) -> tuple[int, int]:
        """Twice the first position that the projector shows, and twice the one behind the last, in finest stripes."""
        step, end = 1 << self.finest, self.first_code + self.size
        return -(-2 * self.first_code // step), -(-2 * end // step)

    def pairs(self, frames: Mapping[str, Frame], threshold: Frame | None) -> list[tuple[Frame, Frame]]:
        """Return each picture's frame, and the frame that it has to be brighter than."""
        missing = [name for name in self.names if name not in frames]
        if missing:
            raise CalibrationError(
                f"{self.code} code of the {self.axis}s: {len(missing)} of {len(self.names)} bits have no frame "
                f"({', '.join(missing)}); photograph them, or give the size of the area that the patterns were shown in"
            )
        pairs = []
        for name in self.names:
            other = frames.get(f"{name}-inverse", threshold)
            if other is None:
                raise CalibrationError(f"{name}-inverse has no frame, but other bits have theirs: photograph it")
            pairs.append((frames[name], other))
        return pairs


@dataclass(frozen=True, slots=True, kw_only=True)
class _AxisReading:
    """One axis while it is read, some rows at a time."""

    bits: _Bits
    pairs: BitPairs
    twice: NDArray[np.uint16]
    """(H, W) twice the position, in steps of the finest bit: a whole number on borders, too."""

    @classmethod
    def of(
        cls,
        frames: Mapping[str, Frame],
        bits: _Bits,
        *,
        bit_limit: Limit,
        threshold: Frame | None,
        black: Frame | None,
        saturation: float | None,
    ) -> _AxisReading:
        """Prepare to read an axis; with `black`, wide stripes are told by the pixel's own light."""
        pairs = BitPairs.of(
            bits.pairs(frames, threshold),
            bit_limit,
            positions(bits.code, bits.count - bits.finest),
            black=black,
            wide=bits.count - max(bits.count - _WIDE_BITS, _LEAST_WIDE_BIT),
            saturation=saturation,
            bounds=bits.bounds,
        )
        return cls(bits=bits, pairs=pairs, twice=np.empty(pairs.lit[0].shape, dtype=np.uint16))

    def read(self, rows: slice, reason: NDArray[np.uint8]) -> None:
        """Find the positions of some rows, and say why pixels have none."""
        self.pairs.read(rows, self.twice[rows], reason)

    def coordinate_px(self, rows: slice) -> NDArray[np.float32]:
        """Projector coordinates of some rows: of the middle of the finest stripe, where bits are left out."""
        step = np.float32(1 << self.bits.finest)
        found = self.twice[rows].astype(np.float32)
        found *= step / 2
        found += (step - 1) / 2 - np.float32(self.bits.first_code)
        return np.minimum(found, np.float32(self.bits.size - 1)) if self.bits.finest else found


@dataclass(frozen=True, slots=True, kw_only=True)
class _Flats:
    """Frames of white and black, and by how much they differ where the projector lights."""

    bright: Frame
    dark: Frame
    contrast_limit: NDArray[Any]

    def dark_in(self, rows: slice) -> BoolArray:
        """Tell which pixels of some rows are not lit."""
        return is_dark(self.bright[rows], self.dark[rows], part(self.contrast_limit, rows))


def _read_strip(read: Sequence[_AxisReading], rows: slice, *, flats: _Flats, reason: NDArray[np.uint8]) -> None:
    """Read some rows of all axes, and say why pixels have no position; that they are dark counts most."""
    here = reason[rows]
    here[...] = PixelReason.VALID
    for axis in read:
        axis.read(rows, here)
    mark(here, PixelReason.DARK, flats.dark_in(rows))


def _mark_unlit(reason: NDArray[np.uint8], read: Sequence[_AxisReading], *, bright: Frame, dark: Frame) -> None:
    """Say of which pixels only other surfaces' light is seen: a tone curve makes all of their bits the same.

    A pattern and its inverse, which such light makes equal, need no such question.
    """
    fine = [frame for axis in read for frame in axis.pairs.lit[axis.pairs.wide :]]
    wide = [frame for axis in read for frame in axis.pairs.lit[: axis.pairs.wide]]
    if fine and wide:
        unlit = ~follows_stripes(fine, wide, bright=bright, dark=dark)
        mark(reason, PixelReason.WASHED_OUT, unlit & (reason == PixelReason.VALID))


def _correspondence(
    read: Sequence[_AxisReading], reason: NDArray[np.uint8], projector_shape: tuple[int, int]
) -> Correspondence:
    xy = np.empty((*reason.shape, 2), dtype=np.float32)
    by_axis = {axis.bits.axis: axis for axis in read}

    def strip(rows: slice) -> None:
        unknown = np.full(reason[rows].shape, np.nan, dtype=np.float32)
        coordinates = [by_axis[axis].coordinate_px(rows) if axis in by_axis else unknown for axis in BOTH_AXES]
        invalid = reason[rows] != PixelReason.VALID
        for each in coordinates:
            np.copyto(each, np.float32(np.nan), where=invalid)
        cv2.merge(coordinates, xy[rows])

    for_each_strip(strip, reason.shape)
    sigmas = [ROUNDING_PX * 2 ** by_axis[axis].bits.finest if axis in by_axis else np.nan for axis in BOTH_AXES]
    return Correspondence(xy, reason, projector_shape, np.broadcast_to(np.array(sigmas, np.float32), xy.shape))
