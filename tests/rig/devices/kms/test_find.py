"""Outputs found in the kernel's description of its cards, and the one that a profile means."""

from pathlib import Path

import pytest

from rig.devices.kms.find import choose_output, find_outputs, list_outputs, offers, paste_name
from rig.errors import DeviceLost, SettingRefused

# Identity of a display, as recorded from an emulated one: maker RHT, product 1234, no serial, "QEMU Monitor".
HEADER = bytes.fromhex("00ffffffffffff00")


def identity(serial: int) -> bytes:
    block = bytearray(128)
    block[:8] = HEADER
    block[8:16] = bytes.fromhex("49143412") + serial.to_bytes(4, "little")
    block[127] = -sum(block) % 256
    return bytes(block)


def add(root: Path, name: str, *, status: str = "connected", modes: str = "", edid: bytes = b"") -> None:
    folder = root / "sys/class/drm" / name
    folder.mkdir(parents=True)
    (folder / "status").write_text(f"{status}\n")
    (folder / "modes").write_text(modes)
    (folder / "edid").write_bytes(edid)


@pytest.fixture
def two_cards(tmp_path: Path) -> Path:
    """A computer with a graphics card of three sockets, and one of one."""
    add(tmp_path, "card0-HDMI-A-1", modes="1920x1080\n1920x1080\n1920x1080i\n1280x720\n", edid=identity(1))
    add(tmp_path, "card0-DP-1", status="disconnected")
    add(tmp_path, "card0-Writeback-1", status="unknown")
    add(tmp_path, "card10-HDMI-A-1", modes="1024x768\n", edid=identity(2))
    (tmp_path / "sys/class/drm/card0").mkdir()
    (tmp_path / "sys/class/drm/version").write_text("drm 1.1.0 20060810")
    return tmp_path


class TestFind:
    def test_every_socket_of_every_card_is_found(self, two_cards: Path) -> None:
        found = find_outputs(two_cards)
        assert [output.full_name for output in found] == ["card0:DP-1", "card0:HDMI-A-1", "card10:HDMI-A-1"]
        assert [output.status for output in found] == ["disconnected", "connected", "connected"]
        assert found[2].card == two_cards / "dev/dri/card10"

    def test_sizes_come_from_the_kernel_where_the_card_cannot_be_opened(self, two_cards: Path) -> None:
        output = find_outputs(two_cards)[1]
        assert [(mode.width_px, mode.height_px, mode.refresh_rate_hz) for mode in output.modes] == [
            (1920, 1080, None),
            (1280, 720, None),
        ]

    def test_displays_are_told_apart_by_their_identity(self, two_cards: Path) -> None:
        assert [output.edid_id for output in list_outputs(two_cards)] == [None, "RHT-1234-1", "RHT-1234-2"]

    def test_a_computer_without_graphics_has_no_outputs(self, tmp_path: Path) -> None:
        assert find_outputs(tmp_path) == []

    def test_only_whole_frames_are_offered(self, two_cards: Path) -> None:
        folder = two_cards / "sys/class/drm/card0-HDMI-A-1"
        assert offers(folder, 1280, 720)
        assert not offers(folder, 640, 480)
        (folder / "modes").write_text("1920x1080i\n")
        assert not offers(folder, 1920, 1080)


class TestChoose:
    def test_a_connector_is_enough_where_one_card_has_it(self, two_cards: Path) -> None:
        outputs = list_outputs(two_cards)
        assert choose_output("DP-1", outputs).full_name == "card0:DP-1"
        assert [paste_name(each, outputs) for each in outputs] == ["DP-1", "card0:HDMI-A-1", "card10:HDMI-A-1"]

    @pytest.mark.parametrize("name", ["card10:HDMI-A-1", "edid:RHT-1234-2"])
    def test_a_card_or_an_identity_tells_twins_apart(self, two_cards: Path, name: str) -> None:
        assert choose_output(name, list_outputs(two_cards)).full_name == "card10:HDMI-A-1"

    def test_an_ambiguous_name_is_refused_with_the_list(self, two_cards: Path) -> None:
        with pytest.raises(SettingRefused, match="'HDMI-A-1' means 2 outputs") as refused:
            choose_output("HDMI-A-1", list_outputs(two_cards))
        assert "card0:HDMI-A-1 (connected, edid:RHT-1234-1)" in str(refused.value)
        assert "card10:HDMI-A-1" in str(refused.value)

    @pytest.mark.parametrize("name", ["HDMI-A-9", "", "edid:None", "edid:RHT-1234-3", "card0"])
    def test_a_name_that_is_not_there_says_what_is(self, two_cards: Path, name: str) -> None:
        with pytest.raises(DeviceLost, match=r"card0:DP-1 \(disconnected\)"):
            choose_output(name, list_outputs(two_cards))

    def test_without_graphics_the_message_says_so(self) -> None:
        with pytest.raises(DeviceLost, match="no graphics driver"):
            choose_output("HDMI-A-1", [])
