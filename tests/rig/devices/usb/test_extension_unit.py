"""Vendor controls are found by GUID, read, written and read back; what the camera refuses is named."""

import ctypes
import errno
import os
import struct
from collections.abc import Callable
from pathlib import Path
from uuid import UUID

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig.devices.clock import VirtualClock
from rig.devices.usb.extension_unit import (
    UVCIOC_CTRL_QUERY,
    ExtensionUnit,
    Query,
    VendorControls,
    XuControlQuery,
    extension_units,
    extension_units_of,
    vendor_controls,
)
from rig.errors import DeviceBusy, DeviceError, DeviceForbidden, DeviceLost, SettingRefused

GUID = UUID("a29e7641-de04-47e3-8b2b-f4341aff003b")
OTHER = UUID("00112233-4455-6677-8899-aabbccddeeff")
DEVICE = struct.pack("<BBHBBBBHHHBBBB", 18, 1, 0x200, 0xEF, 2, 1, 64, 0x1209, 1, 0x100, 1, 2, 3, 1)
CONFIGURATION = struct.pack("<BBHBBBBB", 9, 2, 0, 2, 1, 0, 0x80, 250)
VIDEO_CONTROL = struct.pack("<9B", 9, 4, 0, 0, 0, 0x0E, 1, 0, 0)
VIDEO_STREAMING = struct.pack("<9B", 9, 4, 1, 0, 0, 0x0E, 2, 0, 0)


def unit(unit_id: int, guid: UUID, bits: bytes, sources: bytes = b"\x02") -> bytes:
    body = bytes([0x24, 6, unit_id]) + guid.bytes_le + bytes([bin(int.from_bytes(bits)).count("1"), len(sources)])
    body += sources + bytes([len(bits)]) + bits + b"\0"
    return bytes([1 + len(body)]) + body


DESCRIPTORS = DEVICE + CONFIGURATION + VIDEO_CONTROL + unit(4, OTHER, b"\x01") + unit(9, GUID, b"\x03\x80", b"\x02\x04")


def test_units_are_read_from_raw_descriptors() -> None:
    assert extension_units(DESCRIPTORS) == (ExtensionUnit(4, OTHER, (1,)), ExtensionUnit(9, GUID, (1, 2, 16)))


def test_the_same_subtype_on_a_streaming_interface_is_no_unit() -> None:
    assert extension_units(DEVICE + CONFIGURATION + VIDEO_STREAMING + unit(4, GUID, b"\x01")) == ()


@pytest.mark.parametrize("cut", range(1, len(unit(4, GUID, b"\x01"))))
def test_descriptors_that_end_early_are_no_units(cut: int) -> None:
    assert extension_units(DEVICE + VIDEO_CONTROL + unit(4, GUID, b"\x01")[:-cut]) == ()


@pytest.mark.parametrize("junk", [b"", b"\0" * 40, b"\xff" * 40, b"\x03\x24\x06" * 9, b"\x02\x24" * 9])
def test_junk_has_no_units(junk: bytes) -> None:
    assert extension_units(DEVICE + VIDEO_CONTROL + junk) == ()


@given(st.binary(max_size=200))
def test_any_bytes_have_units_or_none(junk: bytes) -> None:
    for found in extension_units(DEVICE + VIDEO_CONTROL + junk):
        assert all(1 <= selector for selector in found.selectors)


def test_the_request_has_the_kernels_layout() -> None:
    assert ctypes.sizeof(XuControlQuery) == 16
    assert UVCIOC_CTRL_QUERY == 0xC0107521


class FakeUnit:
    """Stands for the kernel and a camera with unit 9: control 1 has two bytes, control 2 one and is read-only."""

    def __init__(self) -> None:
        self.values = {1: b"\x10\x00", 2: b"\x07"}
        self.error: int | None = None
        self.clamps = False

    def ioctl(self, descriptor: int, request: int, query: ctypes.Structure) -> None:
        assert isinstance(query, XuControlQuery)
        assert (descriptor, request) == (5, UVCIOC_CTRL_QUERY)
        if self.error is not None:
            raise OSError(self.error, os.strerror(self.error))
        if query.unit != 9 or query.selector not in self.values:
            raise OSError(errno.ENOENT, "none")
        self.answer(query, self.values[query.selector])

    def answer(self, query: XuControlQuery, value: bytes) -> None:
        if query.query == Query.SET_CUR:
            data = ctypes.string_at(query.data, query.size)
            self.values[query.selector] = min(data, b"\x20\x00") if self.clamps else data
            return
        told = {
            Query.GET_LEN: struct.pack("<H", len(value)),
            Query.GET_INFO: b"\x03" if query.selector == 1 else b"\x01",
            Query.GET_CUR: value,
            Query.GET_MIN: bytes(len(value)),
            Query.GET_MAX: b"\xff" * len(value),
        }
        if query.query not in told:
            raise OSError(errno.EPIPE, "stall")
        ctypes.memmove(query.data, told[Query(query.query)], query.size)


@pytest.fixture
def camera() -> FakeUnit:
    return FakeUnit()


@pytest.fixture
def controls(camera: FakeUnit) -> VendorControls:
    return VendorControls(5, 9, "/dev/video0", camera.ioctl)


def test_a_control_is_described_as_far_as_the_camera_tells(controls: VendorControls) -> None:
    control = controls.describe(1)
    assert (control.length, control.readable, control.writable) == (2, True, True)
    assert (control.minimum, control.maximum, control.default) == (b"\0\0", b"\xff\xff", b"")
    assert not controls.describe(2).writable


def test_a_value_is_written_and_read(controls: VendorControls) -> None:
    controls.write(1, b"\x34\x12")
    assert controls.read(1) == b"\x34\x12"


def test_a_value_that_the_camera_changes_is_refused(controls: VendorControls, camera: FakeUnit) -> None:
    camera.clamps = True
    with pytest.raises(SettingRefused, match="control 1 of unit 9 was set to 34 12, but reads 20 00"):
        controls.write(1, b"\x34\x12")


def test_wrong_lengths_and_read_only_controls_are_refused(controls: VendorControls) -> None:
    with pytest.raises(SettingRefused, match="has 2 bytes, not 1"):
        controls.write(1, b"\x01")
    with pytest.raises(SettingRefused, match="can only be read"):
        controls.write(2, b"\x01")
    with pytest.raises(SettingRefused, match="there is no such unit or control"):
        controls.read(3)


@pytest.mark.parametrize(
    ("number", "kind", "text"),
    [
        (errno.EPIPE, SettingRefused, "refuses it .stall"),
        (errno.ENOENT, SettingRefused, "no such unit"),
        (errno.EINVAL, SettingRefused, "EINVAL"),
        (errno.EACCES, SettingRefused, "automatic"),
        (errno.ENOTTY, SettingRefused, "no UVC camera"),
        (errno.ENODEV, DeviceLost, "went away"),
        (errno.EBUSY, DeviceBusy, "busy"),
        (errno.EIO, DeviceError, "reset the camera"),
        (errno.ETIMEDOUT, DeviceError, "reset the camera"),
    ],
)
def test_what_the_kernel_says_is_named(
    controls: VendorControls, camera: FakeUnit, number: int, kind: type[DeviceError], text: str
) -> None:
    camera.error = number
    with pytest.raises(kind, match=text) as caught:
        controls.read(1)
    assert "/dev/video0: GET_LEN of control 1 of unit 9" in str(caught.value)


def plug(root: Path) -> None:
    interface = root / "sys/devices/usb1/1-4/1-4:1.0"
    interface.mkdir(parents=True)
    (interface.parent / "descriptors").write_bytes(DESCRIPTORS)
    node = root / "sys/class/video4linux/video0"
    node.mkdir(parents=True)
    (node / "device").symlink_to(interface)


def test_units_of_a_video_node_are_found_through_sysfs(tmp_path: Path) -> None:
    plug(tmp_path)
    assert [each.guid for each in extension_units_of(Path("/dev/video0"), tmp_path)] == [OTHER, GUID]
    with pytest.raises(DeviceLost, match="/dev/video7: no USB camera"):
        extension_units_of(Path("/dev/video7"), tmp_path)


def test_a_missing_unit_lists_those_that_the_camera_has(tmp_path: Path) -> None:
    plug(tmp_path)
    wanted = UUID(int=5)
    with pytest.raises(SettingRefused, match=f"no extension unit {wanted}; the camera has: {OTHER}, {GUID}"):
        with vendor_controls(Path("/dev/video0"), wanted, tmp_path):
            pass


def test_a_node_that_does_not_open_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plug(tmp_path)
    node = tmp_path / "dev/video0"
    with pytest.raises(DeviceLost, match="cannot be opened"):
        with vendor_controls(node, GUID, tmp_path):
            pass

    def deny(*given: object) -> int:
        raise PermissionError(errno.EACCES, "denied")

    monkeypatch.setattr("os.open", deny)
    with pytest.raises(DeviceForbidden, match="you may not open it"):
        with vendor_controls(node, GUID, tmp_path):
            pass


def test_a_camera_that_was_just_plugged_in_may_be_busy_for_a_moment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plug(tmp_path)
    clock, opened, asked = VirtualClock(), os.open, []
    node = tmp_path / "video0"
    node.touch()

    def busy_until(end_s: float) -> Callable[[Path, int], int]:
        def answer(path: Path, flags: int) -> int:
            asked.append(clock.now_s())
            if clock.now_s() < end_s:
                raise OSError(errno.EBUSY, "Device or resource busy")
            return opened(path, flags)

        return answer

    monkeypatch.setattr("os.open", busy_until(0.5))
    with vendor_controls(node, GUID, tmp_path, clock):
        assert asked[-1] >= 0.5
    monkeypatch.setattr("os.open", busy_until(60.0))
    with pytest.raises(DeviceBusy, match="another program holds the camera"):
        with vendor_controls(node, GUID, tmp_path, clock):
            pass
    assert asked[-1] < 4.0, "it is not waited for longer than two seconds"


def test_another_kind_of_file_is_no_cameras_node(tmp_path: Path) -> None:
    plug(tmp_path)
    node = tmp_path / "video0"
    node.touch()
    with vendor_controls(node, GUID, tmp_path) as controls, pytest.raises(SettingRefused, match="no UVC camera's node"):
        controls.read(1)
