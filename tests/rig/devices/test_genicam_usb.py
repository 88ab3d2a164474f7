"""A USB3 Vision camera that cannot be opened is told with the remedy, by what the kernel says of it."""

from pathlib import Path

import pytest

from rig.devices.genicam import find
from rig.devices.genicam.find import opened_by
from rig.devices.genicam.usb import list_usb_vision, usb_advice, why_usb_silent
from rig.errors import DeviceForbidden, DeviceLost
from tests.rig.devices.usb.test_find import plug

VISION = (0xEF, 0x05)


def plug_camera(
    root: Path, bus_path: str = "2-1", *, driver: str | None = None, subclass: int = 5, **facts: str
) -> None:
    folder = plug(root, bus_path, interfaces=((VISION[0], driver),), **({"speed": "5000", "version": "3.00"} | facts))
    (folder / f"{bus_path}:1.0" / "bInterfaceSubClass").write_text(f"{subclass:02x}\n")


def make_node(root: Path, mode: int) -> None:
    node = root / "dev/bus/usb/001/007"
    node.parent.mkdir(parents=True)
    node.touch()
    node.chmod(mode)


def test_vision_cameras_are_told_from_other_devices(tmp_path: Path) -> None:
    plug_camera(tmp_path, "2-1")
    plug_camera(tmp_path, "2-2", subclass=2)
    plug(tmp_path, "2-3", interfaces=((0x0E, "uvcvideo"),))
    assert [one.bus_path for one in list_usb_vision(tmp_path)] == ["2-1"]


def test_one_that_is_not_plugged_in_or_has_another_number_is_said(tmp_path: Path) -> None:
    assert "no USB3 Vision camera is plugged in" in why_usb_silent("usb3-A1", tmp_path)
    plug_camera(tmp_path, "2-1", serial="A1")
    plug_camera(tmp_path, "2-2", serial="B2")
    assert "(A1), 1209:0001 Camera (B2); give one of their serial numbers" in why_usb_silent("usb3-C3", tmp_path)


def test_one_that_may_not_be_opened_comes_with_a_rule(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The library does not list it then: without this one would look for a broken cable."""
    plug_camera(tmp_path)
    make_node(tmp_path, 0o644)
    monkeypatch.setattr("rig.devices.genicam.usb.os.access", lambda *_: False)  # also where tests run as root
    with pytest.raises(DeviceForbidden, match=r"idVendor.*1209.*idProduct.*0001.*uaccess"):
        why_usb_silent("usb3-A1", tmp_path)


def test_one_that_is_held_or_slow_or_taken_is_said(tmp_path: Path) -> None:
    make_node(tmp_path, 0o666)
    plug_camera(tmp_path, "2-1", driver="u3v")
    assert "held by the kernel's driver u3v: sudo modprobe -r u3v" in why_usb_silent("usb3-A1", tmp_path)
    (tmp_path / "sys/bus/usb/devices/2-1/2-1:1.0/driver").unlink()
    assert "close other programs" in why_usb_silent("usb3-A1", tmp_path)
    (tmp_path / "sys/bus/usb/devices/2-1/speed").write_text("480")
    assert "use a USB 3 port" in why_usb_silent("usb3-A1", tmp_path)
    assert "use a USB 3 port" in usb_advice("usb3-A1", 1, tmp_path)[0]


def test_little_room_for_transfers_is_told_with_the_setting(tmp_path: Path) -> None:
    assert usb_advice("usb3-A1", 100 << 20, tmp_path) == ()
    limit = tmp_path / "sys/module/usbcore/parameters/usbfs_memory_mb"
    limit.parent.mkdir(parents=True)
    limit.write_text("16\n")
    (line,) = usb_advice("usb3-A1", (35 << 20) + 1, tmp_path)
    assert "keep 16 MB, 36 are wanted: echo 36 | sudo tee /sys/module/usbcore/parameters/usbfs_memory_mb" in line
    assert usb_advice("usb3-A1", 16 << 20, tmp_path) == ()
    limit.write_text("0\n")  # no limit
    assert usb_advice("usb3-A1", 100 << 20, tmp_path) == ()


def test_a_camera_that_the_library_does_not_list_is_lost_with_the_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(find, "list_genicam", list)
    monkeypatch.setattr(find, "why_usb_silent", lambda _: "no USB3 Vision camera is plugged in")
    with pytest.raises(DeviceLost, match="usb3-A1 is not there: no USB3 Vision camera is plugged in"):
        opened_by("usb3-A1")
