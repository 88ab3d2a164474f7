"""What a PNG says of its colours before its pixels (PNG, third edition, 11.3.2)."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_WANTED = (b"cICP", b"iCCP", b"sRGB", b"gAMA", b"cHRM")
_LONGEST = 4 << 20
"""Bytes that are read of a chunk, and unpacked of a profile: large ones have one megabyte."""


def colour_chunks(path: Path) -> dict[bytes, bytes]:
    """Return the chunks of a file that tell colours, by name; none where it is no PNG or ends early."""
    chunks: dict[bytes, bytes] = {}
    with path.open("rb") as file:
        if file.read(8) != _SIGNATURE:
            return {}
        while len(head := file.read(8)) == 8:
            length, name = struct.unpack(">I4s", head)
            if name in (b"IDAT", b"IEND"):
                break
            if name in _WANTED:
                chunks[name] = file.read(min(length, _LONGEST))
                length -= len(chunks[name])
            file.seek(length + 4, 1)
    return chunks


def profile_of_chunk(data: bytes) -> bytes:
    """Return the colour profile of an iCCP chunk; empty where it cannot be unpacked."""
    _, _, packed = data.partition(b"\0")
    try:
        return zlib.decompressobj().decompress(packed[1:], _LONGEST)
    except zlib.error:
        return b""
