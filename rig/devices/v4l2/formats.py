"""Pixel formats: what a buffer's bytes mean, as (H, W, C) unsigned integers of the sensor's own depth.

:data:`PIXEL_FORMATS` is the one table of their facts: name, bits, channels, bytes, decoder.

Luma of YUV formats is returned as it is (16 … 235 where the camera says so). Red, green and blue are computed from
YUV with the matrix and range that the driver reports; chroma is taken from the nearest sample.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.radiometry.mosaic import MosaicPattern
from rig.devices.v4l2 import abi
from rig.errors import SettingRefused

Bytes = NDArray[np.uint8]
Pixels = NDArray[np.uint16]


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """How a picture lies in its buffer."""

    width_px: int
    height_px: int
    bytes_per_line: int
    luma_weights: tuple[float, float] = (0.299, 0.114)
    """Kr and Kb of the YUV matrix; those of BT.601 unless the driver says otherwise."""
    full_range: bool = False
    """Luma is 0 … 255 and not 16 … 235."""


Decoder = Callable[[Bytes, Layout, int], Pixels]
"""(buffer, layout, channels) to (H, W, C); always a copy."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PixelFormat:
    """A pixel format that is understood."""

    name: str
    depths: tuple[int, int]
    """Smallest and largest bit depth that its numbers may have."""
    channels: tuple[int, ...]
    """Numbers of channels that it can give: 1 is grey, 3 is red, green and blue."""
    bytes_per_line: Callable[[int], int] | None
    """The least for a width; None for compressed pictures."""
    decode: Decoder
    planes: float = 1.0
    """Lines in the buffer, as a multiple of the picture's height."""

    @property
    def bits(self) -> int:
        """The most that its numbers may have."""
        return self.depths[1]

    @property
    def is_compressed(self) -> bool:
        """Its pictures have no fixed size."""
        return self.bytes_per_line is None

    @property
    def bits_per_pixel(self) -> int | None:
        """Room that a pixel takes in the buffer, packed ones on the average; None for compressed pictures."""
        return None if self.bytes_per_line is None else int(self.bytes_per_line(8) * self.planes)  # of 8 pixels

    def least_bytes(self, layout: Layout) -> int:
        """Size of a whole picture; a compressed one has at least a byte."""
        if self.bytes_per_line is None:
            return 1
        lines = int(layout.height_px * self.planes)
        return (lines - 1) * layout.bytes_per_line + self.bytes_per_line(layout.width_px)


class Undecodable(Exception):
    """The buffer holds no picture; the frame is rejected like one with an error flag."""


def pixel_format(name: str, *, channels: int, bit_depth: int) -> PixelFormat:
    """The format of this name, which has to have these channels and this depth.

    Raises SettingRefused otherwise, with what is possible.
    """
    found = PIXEL_FORMATS.get(name.strip())
    if found is None:
        raise SettingRefused(f"pixel format {name!r} is not understood; it is one of {', '.join(PIXEL_FORMATS)}")
    if channels not in found.channels:
        possible = " or ".join(map(str, found.channels))
        raise SettingRefused(f"{name} gives {possible} channels, not {channels}; change camera.channels")
    least, most = found.depths
    if not least <= bit_depth <= most:
        possible = f"{least}" if least == most else f"{least} … {most}"
        raise SettingRefused(f"{name} has a bit depth of {possible}, not {bit_depth}; change camera.bit_depth")
    return found


def layout_of(pix: abi.PixFormat) -> Layout:
    """Return what the driver says of its buffers."""
    encoding, quantization = pix.ycbcr_enc, pix.quantization
    if encoding == abi.YCBCR_DEFAULT:
        by_space = {abi.COLORSPACE_REC709: abi.YCBCR_709, abi.COLORSPACE_BT2020: abi.YCBCR_BT2020}
        encoding = by_space.get(pix.colorspace, abi.YCBCR_601)
    if quantization == abi.QUANTIZATION_DEFAULT and pix.colorspace == abi.COLORSPACE_JPEG:
        quantization = abi.QUANTIZATION_FULL
    weights = {abi.YCBCR_709: (0.2126, 0.0722), abi.YCBCR_BT2020: (0.2627, 0.0593)}.get(encoding, (0.299, 0.114))
    full_range = quantization == abi.QUANTIZATION_FULL
    return Layout(
        width_px=pix.width,
        height_px=pix.height,
        bytes_per_line=pix.bytesperline,
        luma_weights=weights,
        full_range=full_range,
    )


def _lines(data: Bytes, layout: Layout, bytes_used: int, *, first_line: int = 0, lines: int | None = None) -> Bytes:
    """(lines, bytes_used) view of a buffer, without what pads its lines."""
    stride = max(layout.bytes_per_line, bytes_used)
    count = layout.height_px if lines is None else lines
    start = first_line * stride
    if data.size < start + (count - 1) * stride + bytes_used:
        raise Undecodable(f"{data.size} bytes, {start + count * stride} are needed")
    return np.lib.stride_tricks.as_strided(data[start:], (count, bytes_used), (stride, 1), writeable=False)


def _grey8(data: Bytes, layout: Layout, _channels: int) -> Pixels:
    return _lines(data, layout, layout.width_px).astype(np.uint16)[:, :, np.newaxis]


def _words(order: str) -> Decoder:
    def decode(data: Bytes, layout: Layout, _channels: int) -> Pixels:
        lines = _lines(data, layout, 2 * layout.width_px)
        return lines.view(order).astype(np.uint16)[:, :, np.newaxis]

    return decode


def _tails(bits: int) -> Decoder:
    """MIPI packing: the upper eight bits of each of a group, then one byte of lower bits, the first pixel's lowest."""
    extra = bits - 8
    group = 8 // extra

    def decode(data: Bytes, layout: Layout, _channels: int) -> Pixels:
        groups = -(-layout.width_px // group)
        packed = _lines(data, layout, groups * (group + 1)).reshape(layout.height_px, groups, group + 1)
        low = packed[:, :, group:] >> (extra * np.arange(group, dtype=np.uint8)) & ((1 << extra) - 1)
        pixels = packed[:, :, :group].astype(np.uint16) << extra | low
        return np.ascontiguousarray(pixels.reshape(layout.height_px, -1)[:, : layout.width_px, np.newaxis])

    return decode


def _bit_stream(data: Bytes, layout: Layout, _channels: int) -> Pixels:
    """Y10B: ten bits a pixel, highest first, one behind the other: four pixels in five bytes."""
    groups = -(-layout.width_px // 4)
    packed = _lines(data, layout, groups * 5).reshape(layout.height_px, groups, 5).astype(np.uint16)
    shift = np.array([2, 4, 6, 8], np.uint16)
    pixels = (packed[:, :, :4] << shift | packed[:, :, 1:] >> (8 - shift)) & 0x3FF
    return np.ascontiguousarray(pixels.reshape(layout.height_px, -1)[:, : layout.width_px, np.newaxis])


def _rgb24(order: slice) -> Decoder:
    def decode(data: Bytes, layout: Layout, _channels: int) -> Pixels:
        lines = _lines(data, layout, 3 * layout.width_px).reshape(layout.height_px, layout.width_px, 3)
        return np.ascontiguousarray(lines[:, :, order]).astype(np.uint16)

    return decode


def _yuv422(luma: int, blue: int, red: int) -> Decoder:
    """Two pixels in four bytes; the arguments say where the first luma and the chroma samples are."""

    def decode(data: Bytes, layout: Layout, channels: int) -> Pixels:
        lines = _lines(data, layout, 4 * -(-layout.width_px // 2))
        brightness = lines[:, luma::2][:, : layout.width_px]
        if channels == 1:
            return brightness.astype(np.uint16)[:, :, np.newaxis]
        chroma = [np.repeat(lines[:, at::4], 2, axis=1)[:, : layout.width_px] for at in (blue, red)]
        return _rgb(brightness, chroma[0], chroma[1], layout)

    return decode


def _nv12(data: Bytes, layout: Layout, channels: int) -> Pixels:
    width, height = layout.width_px, layout.height_px
    brightness = _lines(data, layout, width)
    if channels == 1:
        return brightness.astype(np.uint16)[:, :, np.newaxis]
    pairs = _lines(data, layout, 2 * -(-width // 2), first_line=height, lines=-(-height // 2))
    chroma = [np.repeat(np.repeat(pairs[:, at::2], 2, 1), 2, 0)[:height, :width] for at in (0, 1)]
    return _rgb(brightness, chroma[0], chroma[1], layout)


def _rgb(luma: Bytes, blue: Bytes, red: Bytes, layout: Layout) -> Pixels:
    kr, kb = layout.luma_weights
    offset, luma_range, chroma_range = (0.0, 255.0, 255.0) if layout.full_range else (16.0, 219.0, 224.0)
    y, c = 255.0 / luma_range, 255.0 / chroma_range
    cr, cb = 2 * (1 - kr) * c, 2 * (1 - kb) * c
    kg = 1 - kr - kb
    matrix = np.array([[y, 0, cr], [y, -cb * kb / kg, -cr * kr / kg], [y, cb, 0]])
    shift = -matrix @ np.array([offset, 128.0, 128.0])
    yuv = np.dstack([luma, blue, red])
    return cv2.transform(yuv, np.column_stack([matrix, shift])).astype(np.uint16)


def _jpeg(data: Bytes, layout: Layout, channels: int) -> Pixels:
    flags = cv2.IMREAD_GRAYSCALE if channels == 1 else cv2.IMREAD_COLOR
    picture = cv2.imdecode(data, flags | cv2.IMREAD_IGNORE_ORIENTATION)
    if picture is None or picture.shape[:2] != (layout.height_px, layout.width_px):
        found = "no JPEG picture" if picture is None else f"a picture of {picture.shape[1]} x {picture.shape[0]} px"
        raise Undecodable(f"{found} in {data.size} bytes")
    if channels == 1:
        return picture.astype(np.uint16)[:, :, np.newaxis]
    return np.ascontiguousarray(picture[:, :, ::-1]).astype(np.uint16)


def _one_byte(width: int) -> int:
    return width


def _two_bytes(width: int) -> int:
    return 2 * width


def _three_bytes(width: int) -> int:
    return 3 * width


def _five_for_four(width: int) -> int:
    return 5 * -(-width // 4)


def _three_for_two(width: int) -> int:
    return 3 * -(-width // 2)


def _pairs(width: int) -> int:
    return 4 * -(-width // 2)


def _grey(
    names: Iterable[str], depths: tuple[int, int], bytes_per_line: Callable[[int], int], decode: Decoder
) -> list[PixelFormat]:
    return [
        PixelFormat(name=name, depths=depths, channels=(1,), bytes_per_line=bytes_per_line, decode=decode)
        for name in names
    ]


def _colour(
    name: str, channels: tuple[int, ...], bytes_per_line: Callable[[int], int] | None, decode: Decoder
) -> PixelFormat:
    return PixelFormat(name=name, depths=(8, 8), channels=channels, bytes_per_line=bytes_per_line, decode=decode)


def _known() -> list[PixelFormat]:
    little, big = _words("<u2"), _words(">u2")
    known = _grey(("GREY", "BA81", "GBRG", "GRBG", "RGGB"), (8, 8), _one_byte, _grey8)
    for depth, names in {
        10: ("Y10", "BG10", "GB10", "BA10", "RG10"),
        12: ("Y12", "BG12", "GB12", "BA12", "RG12"),
        14: ("Y14", "BG14", "GB14", "GR14", "RG14"),
    }.items():
        known += _grey(names, (depth, depth), _two_bytes, little)
    known += _grey(("Y16", "BYR2", "GB16", "GR16", "RG16"), (9, 16), _two_bytes, little)
    known += _grey(("Y16-BE",), (9, 16), _two_bytes, big)
    known += _grey(("Y10P", "pBAA", "pGAA", "pgAA", "pRAA"), (10, 10), _five_for_four, _tails(10))
    known += _grey(("Y12P", "pBCC", "pGCC", "pgCC", "pRCC"), (12, 12), _three_for_two, _tails(12))
    known += _grey(("Y10B",), (10, 10), _five_for_four, _bit_stream)
    yuv = {"YUYV": (0, 1, 3), "UYVY": (1, 0, 2), "YVYU": (0, 3, 1), "VYUY": (1, 2, 0)}
    known += [_colour(name, (1, 3), _pairs, _yuv422(*order)) for name, order in yuv.items()]
    known.append(replace(_colour("NV12", (1, 3), _one_byte, _nv12), planes=1.5))
    known.append(_colour("RGB3", (3,), _three_bytes, _rgb24(slice(None))))
    known.append(_colour("BGR3", (3,), _three_bytes, _rgb24(slice(None, None, -1))))
    known += [_colour(name, (1, 3), None, _jpeg) for name in ("MJPG", "JPEG")]
    return known


_MOSAICS: Mapping[MosaicPattern, str] = {
    "RGGB": "RGGB RG10 RG12 RG14 RG16 pRAA pRCC",
    "GRBG": "GRBG BA10 BA12 GR14 GR16 pgAA pgCC",
    "GBRG": "GBRG GB10 GB12 GB14 GB16 pGAA pGCC",
    "BGGR": "BA81 BG10 BG12 BG14 BYR2 pBAA pBCC",
}
"""Formats with colour filters, by their first two rows (kernel documentation, "Raw Bayer Formats")."""


def mosaic_of_format(name: str) -> MosaicPattern | None:
    """Return the colour filters that a pixel format says; None of one that is no mosaic."""
    return next((pattern for pattern, names in _MOSAICS.items() if name.strip() in names.split()), None)


PIXEL_FORMATS = {known.name: known for known in _known()}
"""Every format that is understood, by its name."""
