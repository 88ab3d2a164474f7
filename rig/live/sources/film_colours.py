"""What a film's file says of its colours: films are shown as BT.709, so that what says otherwise has to be known."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import BinaryIO, NamedTuple

from rig.live.sources.source import FilmBroken

_HDR = {16: "PQ", 18: "HLG"}
"""Transfer characteristics (ITU-T H.273) of high dynamic range, in which white lies far below the largest code."""
_LINEAR, _UNKNOWN = 8, 2
_OTHER_PRIMARIES = {9: "BT.2020", 11: "DCI P3", 12: "Display P3"}
"""Of H.273; those of BT.709 and BT.601 are too near each other to be told."""
_MOST_BYTES = 16 << 20
"""Of a film's description: that of a film of ten hours has some 8 MB."""
_MOST_BOXES = 1000
"""At the top of a file; films have a dozen."""


class FilmColours(NamedTuple):
    """Code points of ITU-T H.273."""

    primaries: int
    transfer: int


def film_colours(path: Path) -> FilmColours | None:
    """Return what an MP4, MOV, MKV or WebM says of its colours; None of another file, or where it says nothing.

    A box ``colr`` of the type ``nclx`` or ``nclc`` (ISO/IEC 14496-12, 12.1.5), or Matroska's ``Colour`` before its
    first picture. Broken files say nothing: the decoder tells what is wrong with them.
    """
    try:
        with path.open("rb") as file:
            head = file.read(_MOST_BYTES if file.read(4) == b"\x1a\x45\xdf\xa3" else 0)
            return _of_matroska(head) if head else _of_boxes(file)
    except OSError:
        return None


def check_colours(path: Path) -> tuple[str, ...]:
    """Return what a person has to know of a film's colours; nothing of most films.

    Raises
    ------
    FilmBroken
        Shown as BT.709 it would be another picture: it is of high dynamic range, or linear light.
    """
    told = film_colours(path)
    if told is None:
        return ()
    if told.transfer in _HDR or told.transfer == _LINEAR:
        kind = f"high dynamic range ({_HDR[told.transfer]})" if told.transfer in _HDR else "linear light"
        raise FilmBroken(f"{path}: says that it is {kind}, which would look wrong here; convert it to BT.709 (SDR)")
    if told.primaries in _OTHER_PRIMARIES:
        name = _OTHER_PRIMARIES[told.primaries]
        return (f"{path.name}: its colours are those of {name}, shown as BT.709: less vivid than they are meant",)
    return ()


def _of_boxes(file: BinaryIO) -> FilmColours | None:
    file.seek(0)
    for _ in range(_MOST_BOXES):
        head = file.read(16)
        if len(head) < 8:
            return None
        size, kind = struct.unpack_from(">I4s", head)
        whole = struct.unpack_from(">Q", head, 8)[0] if size == 1 and len(head) == 16 else size
        if kind == b"moov":
            return _of_description(head[8:] + file.read(min(max(whole - 16, 0), _MOST_BYTES)))
        if whole < 8 or whole >= 1 << 62:
            return None
        file.seek(whole - len(head), 1)
    return None


def _of_description(box: bytes) -> FilmColours | None:
    found = max(box.find(b"colrnclx"), box.find(b"colrnclc"))
    if found < 0 or len(box) < found + 12:
        return None
    return FilmColours(*struct.unpack_from(">HH", box, found + 8))


def _of_matroska(head: bytes) -> FilmColours | None:
    """Elements TransferCharacteristics and Primaries, of one byte each, before the first Cluster."""
    begin = head[: max(head.find(b"\x1f\x43\xb6\x75"), 0)]
    at = [begin.find(bytes(name)) for name in ((0x55, 0xBB, 0x81), (0x55, 0xBA, 0x81))]
    values = [begin[k + 3] if 0 <= k < len(begin) - 3 else _UNKNOWN for k in at]
    return None if values == [_UNKNOWN, _UNKNOWN] else FilmColours(*values)
