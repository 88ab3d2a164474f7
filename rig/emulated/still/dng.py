"""The least DNG file: one uncompressed raw picture with its filters and levels (Adobe, DNG specification 1.4)."""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

_BYTE, _ASCII, _SHORT, _LONG, _RATIONAL, _SIGNED = 1, 2, 3, 4, 5, 10
_FORMATS = {_BYTE: "B", _ASCII: "s", _SHORT: "H", _LONG: "I", _RATIONAL: "II", _SIGNED: "ii"}
_COLOUR_FILTERS, _LINEAR_LIGHT = 32803, 1
_IDENTITY = [number for row in np.eye(3, dtype=int).tolist() for cell in row for number in (cell, 1)]

Tag = tuple[int, int, list[int] | bytes]


def dng(
    pixels: NDArray[np.uint16], white_dn: int, mosaic: str, black_dn: tuple[int, int, int, int] = (0, 0, 0, 0)
) -> bytes:
    """Return the file.

    Parameters
    ----------
    pixels : (H, W)
        Digital numbers.
    white_dn
        Where they clip.
    mosaic
        Filters of the first two pixels of the first row, then of the second.
    black_dn
        Without light, of the same four pixels.
    """
    height, width = pixels.shape
    data = pixels.astype("<u2").tobytes()
    tags: list[Tag] = [
        (254, _LONG, [0]),
        (256, _LONG, [width]),
        (257, _LONG, [height]),
        (258, _SHORT, [16]),
        (259, _SHORT, [1]),
        (262, _SHORT, [_COLOUR_FILTERS]),
        (271, _ASCII, b"procam-rig\0"),
        (272, _ASCII, b"virtual still camera\0"),
        (273, _LONG, [0]),
        (274, _SHORT, [1]),
        (277, _SHORT, [1]),
        (278, _LONG, [height]),
        (279, _LONG, [len(data)]),
        (284, _SHORT, [1]),
        (33421, _SHORT, [2, 2]),
        (33422, _BYTE, ["RGB".index(letter) for letter in mosaic]),
        (50706, _BYTE, [1, 4, 0, 0]),
        (50708, _ASCII, b"procam-rig virtual still camera\0"),
        (50713, _SHORT, [2, 2]),
        (50714, _LONG, list(black_dn)),
        (50717, _LONG, [white_dn]),
        (50721, _SIGNED, _IDENTITY),
        (50728, _RATIONAL, [1, 1, 1, 1, 1, 1]),
        (50778, _SHORT, [21]),
    ]
    return _file(tags, data)


def _file(tags: list[Tag], data: bytes) -> bytes:
    """Header, one directory, values that do not fit into it, and the picture."""
    behind = 8 + 2 + 12 * len(tags) + 4
    values = [_packed(kind, value) for _, kind, value in tags]
    picture_at = behind + sum(len(value) + len(value) % 2 for value in values if len(value) > 4)
    directory, extra = [], b""
    for (tag, kind, value), packed in zip(tags, values, strict=True):
        content = struct.pack("<I", picture_at) if tag == 273 else packed
        count = len(value) // (2 if kind in (_RATIONAL, _SIGNED) else 1)
        if len(content) > 4:
            directory.append(struct.pack("<HHII", tag, kind, count, behind + len(extra)))
            extra += content + b"\0" * (len(content) % 2)
        else:
            directory.append(struct.pack("<HHI", tag, kind, count) + content.ljust(4, b"\0"))
    head = struct.pack("<2sHIH", b"II", 42, 8, len(tags))
    return head + b"".join(directory) + struct.pack("<I", 0) + extra + data


def _packed(kind: int, value: list[int] | bytes) -> bytes:
    if isinstance(value, bytes):
        return value
    one = _FORMATS[kind]
    return struct.pack("<" + one * (len(value) // len(one)), *value)
