"""Who a monitor or projector says it is: the 128-byte block that it sends over its cable (EDID)."""

from __future__ import annotations

from dataclasses import dataclass

_HEADER = bytes((0, 255, 255, 255, 255, 255, 255, 0))
_DESCRIPTORS = (54, 72, 90, 108)
_SERIAL_TEXT, _NAME_TEXT = 0xFF, 0xFC
BLOCK_BYTES = 128


@dataclass(frozen=True, slots=True)
class Edid:
    """What identifies a display."""

    maker: str
    """Three letters."""
    model: str
    """Four hexadecimal digits."""
    serial: str
    """As text where the display has one, else its number; "0" when it has neither."""
    monitor_name: str | None

    @property
    def id(self) -> str:
        """``MAKER-MODEL-SERIAL``, free of blanks: the same whichever socket the display is plugged into."""
        return f"{self.maker}-{self.model}-{self.serial}"


def parse_edid(block: bytes) -> Edid | None:
    """Read a display's identity; None when the block is missing, too short or damaged."""
    block = block[:BLOCK_BYTES]
    if len(block) < BLOCK_BYTES or block[:8] != _HEADER or sum(block) % 256:
        return None
    letters = int.from_bytes(block[8:10], "big")
    maker = "".join(chr(ord("A") - 1 + (letters >> shift & 31)) for shift in (10, 5, 0))
    number = int.from_bytes(block[12:16], "little")
    return Edid(
        maker,
        f"{int.from_bytes(block[10:12], 'little'):04X}",
        _word(_text(block, _SERIAL_TEXT)) or str(number),
        _text(block, _NAME_TEXT),
    )


def _text(block: bytes, tag: int) -> str | None:
    """A descriptor's text: up to 13 characters, ended by a line feed."""
    for start in _DESCRIPTORS:
        if block[start : start + 5] == bytes((0, 0, 0, tag, 0)):
            return block[start + 5 : start + 18].split(b"\n")[0].decode("ascii", "replace").strip() or None
    return None


def _word(text: str | None) -> str:
    return "".join(letter if letter.isascii() and letter.isalnum() else "_" for letter in text or "")
