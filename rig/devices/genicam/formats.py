"""Pixel formats of GenICam: what a buffer's bytes mean, as (H, W, C) unsigned integers of the sensor's own depth.

Names and codes are those of the Pixel Format Naming Convention of the EMVA; the older ``...Packed`` formats are of
GigE Vision.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.radiometry.mosaic import MosaicPattern
from rig.errors import SettingRefused

Bytes = NDArray[np.uint8]
Pixels = NDArray[np.uint16]
Unpack = Callable[[Bytes, int], Pixels]
"""(bytes, how many numbers) to numbers."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GenicamFormat:
    """A pixel format that is understood."""

    name: str
    code: int
    """Of 32 bits; its third byte is the room that a pixel takes."""
    depth: int
    """Bits of a number; those of 16 may have fewer."""
    unpack: Unpack
    numbers: int = 1
    """In each pixel."""
    mosaic: MosaicPattern | None = None

    @property
    def bits_per_pixel(self) -> int:
        """Room that a pixel takes, packed ones on the average."""
        return (self.code >> 16) & 0xFF

    def least_bytes(self, width_px: int, height_px: int) -> int:
        """Return the size of a whole picture."""
        return -(-width_px * height_px * self.bits_per_pixel // 8)

    def decode(self, data: Bytes, shape: tuple[int, int]) -> Pixels:
        """Return a copy, (H, W, numbers), of a buffer that has at least so many bytes."""
        height, width = shape
        return self.unpack(data, height * width * self.numbers).reshape(height, width, self.numbers)


def _bytes(data: Bytes, count: int) -> Pixels:
    return data[:count].astype(np.uint16)


def _words(data: Bytes, count: int) -> Pixels:
    return data[: 2 * count].view("<u2").astype(np.uint16)


def _pairs(data: Bytes, count: int) -> tuple[NDArray[np.uint16], ...]:
    """Three bytes for two numbers, as three rows."""
    whole = data[: 3 * -(-count // 2)]
    if whole.size % 3:  # an odd number of pixels ends within its three bytes
        whole = np.concatenate([whole, np.zeros(3 - whole.size % 3, np.uint8)])
    return tuple(whole.reshape(-1, 3).T.astype(np.uint16))


def _interleaved(first: NDArray[Any], second: NDArray[Any], count: int) -> Pixels:
    return np.stack([first, second], axis=-1).reshape(-1)[:count].astype(np.uint16)


def _packed(low_bits: int) -> Unpack:
    """GigE Vision: upper eight bits of two numbers around a byte with the lower ones of both."""

    def unpack(data: Bytes, count: int) -> Pixels:
        first, low, second = _pairs(data, count)
        mask = (1 << low_bits) - 1
        return _interleaved(first << low_bits | low & mask, second << low_bits | (low >> 4) & mask, count)

    return unpack


def _twelve(data: Bytes, count: int) -> Pixels:
    """One behind the other, lowest bit first: two numbers in three bytes."""
    first, middle, last = _pairs(data, count)
    return _interleaved(first | (middle & 0xF) << 8, middle >> 4 | last << 4, count)


def _ten(data: Bytes, count: int) -> Pixels:
    """The same: four numbers in five bytes."""
    groups = -(-count // 4)
    whole = np.zeros(5 * groups, np.uint8)
    given = data[: 5 * groups]
    whole[: given.size] = given
    part = whole.reshape(-1, 5).astype(np.uint16)
    shift = np.array([0, 2, 4, 6], np.uint16)
    return np.asarray((part[:, :4] >> shift | part[:, 1:] << (8 - shift)) & 0x3FF, np.uint16).reshape(-1)[:count]


def _reversed_colours(data: Bytes, count: int) -> Pixels:
    return np.ascontiguousarray(_bytes(data, count).reshape(-1, 3)[:, ::-1]).reshape(-1)


_KINDS: tuple[tuple[str, int, Unpack, tuple[int, ...]], ...] = (
    ("8", 8, _bytes, (0x01080001, 0x01080008, 0x01080009, 0x0108000A, 0x0108000B)),
    ("10", 10, _words, (0x01100003, 0x0110000C, 0x0110000D, 0x0110000E, 0x0110000F)),
    ("12", 12, _words, (0x01100005, 0x01100010, 0x01100011, 0x01100012, 0x01100013)),
    ("16", 16, _words, (0x01100007, 0x0110002E, 0x0110002F, 0x01100030, 0x01100031)),
    ("10Packed", 10, _packed(2), (0x010C0004, 0x010C0026, 0x010C0027, 0x010C0028, 0x010C0029)),
    ("12Packed", 12, _packed(4), (0x010C0006, 0x010C002A, 0x010C002B, 0x010C002C, 0x010C002D)),
    ("10p", 10, _ten, (0x010A0046, 0x010A0056, 0x010A0058, 0x010A0054, 0x010A0052)),
    ("12p", 12, _twelve, (0x010C0047, 0x010C0057, 0x010C0059, 0x010C0055, 0x010C0053)),
)
"""End of the name, depth, decoder, and the codes of Mono, BayerGR, BayerRG, BayerGB, BayerBG."""
_FILTERS: tuple[tuple[str, MosaicPattern | None], ...] = (
    ("Mono", None),
    ("BayerGR", "GRBG"),
    ("BayerRG", "RGGB"),
    ("BayerGB", "GBRG"),
    ("BayerBG", "BGGR"),
)


def _known() -> list[GenicamFormat]:
    known = [
        GenicamFormat(name=kind + end, code=code, depth=depth, unpack=unpack, mosaic=mosaic)
        for end, depth, unpack, codes in _KINDS
        for (kind, mosaic), code in zip(_FILTERS, codes, strict=True)
    ]
    known.append(GenicamFormat(name="RGB8", code=0x02180014, depth=8, unpack=_bytes, numbers=3))
    known.append(GenicamFormat(name="BGR8", code=0x02180015, depth=8, unpack=_reversed_colours, numbers=3))
    return known


PIXEL_FORMATS = {one.name: one for one in _known()}
"""Every format that is understood, by its name."""


def pixel_format(name: str, *, numbers: int, bit_depth: int) -> GenicamFormat:
    """Return the format of a name, with so many numbers a pixel and of this depth.

    Raises
    ------
    SettingRefused
        There is none, with what is possible.
    """
    found = PIXEL_FORMATS.get(name)
    if found is None:
        raise SettingRefused(f"pixel format {name!r} is not understood; it is one of {', '.join(PIXEL_FORMATS)}")
    if numbers != found.numbers:
        raise SettingRefused(f"{name} gives {found.numbers} channels, not {numbers}; change camera.channels")
    if bit_depth != found.depth and not 8 < bit_depth <= found.depth == 16:
        possible = "9 … 16" if found.depth == 16 else f"{found.depth}"
        raise SettingRefused(f"{name} has a bit depth of {possible}, not {bit_depth}; change camera.bit_depth")
    return found
