"""Who a display says it is."""

import pytest

from rig.devices.kms.edid import parse_edid


def edid_block(
    *, maker: str = "EPS", product: int = 0xA012, number: int = 7, texts: dict[int, bytes] | None = None
) -> bytes:
    """A display's identity block with descriptors of text, by tag."""
    block = bytearray(128)
    block[:8] = bytes.fromhex("00ffffffffffff00")
    letters = 0
    for letter in maker:
        letters = letters << 5 | ord(letter) - ord("A") + 1
    block[8:10] = letters.to_bytes(2, "big")
    block[10:12] = product.to_bytes(2, "little")
    block[12:16] = number.to_bytes(4, "little")
    for start, (tag, text) in zip((54, 72, 90, 108), (texts or {}).items(), strict=False):
        block[start : start + 18] = bytes((0, 0, 0, tag, 0)) + (text + b"\n").ljust(13)[:13]
    block[127] = -sum(block) % 256
    return bytes(block)


class TestEdid:
    def test_a_display_is_known_by_maker_model_and_serial(self) -> None:
        edid = parse_edid(edid_block(texts={0xFC: b"EPSON PJ", 0xFF: b"X3Y 00123"}))
        assert edid is not None
        assert edid.id == "EPS-A012-X3Y_00123"
        assert edid.monitor_name == "EPSON PJ"

    def test_a_serial_number_stands_in_for_a_missing_text(self) -> None:
        edid = parse_edid(edid_block(number=4711))
        assert edid is not None
        assert (edid.id, edid.monitor_name) == ("EPS-A012-4711", None)

    def test_a_text_of_full_length_is_read_whole(self) -> None:
        edid = parse_edid(edid_block(texts={0xFC: b"THIRTEEN_CHAR"}))
        assert edid is not None
        assert edid.monitor_name == "THIRTEEN_CHAR"

    def test_extensions_after_the_block_do_not_matter(self) -> None:
        assert parse_edid(edid_block() + bytes(128)) == parse_edid(edid_block())

    @pytest.mark.parametrize("length", [0, 1, 127])
    def test_a_short_block_is_no_identity(self, length: int) -> None:
        assert parse_edid(edid_block()[:length]) is None

    @pytest.mark.parametrize("place", [0, 9, 60, 127])
    def test_a_damaged_block_is_no_identity(self, place: int) -> None:
        block = bytearray(edid_block(texts={0xFC: b"EPSON PJ"}))
        block[place] ^= 0x55
        assert parse_edid(bytes(block)) is None
