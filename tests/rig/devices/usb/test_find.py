"""What is plugged in is told by sysfs, whatever half-written state it is in."""

from pathlib import Path

import pytest
import usb.backend.libusb1

from rig.devices.usb.find import FoundUsbDevice, find_usb_devices
from rig.devices.usb.handle import libusb, open_usb_device
from rig.devices.usb.hid import find_hid_device, hidraw_node
from rig.errors import DeviceError, DeviceLost

SUPERSPEED_BOS = bytes.fromhex("05 0f 16 00 02  07 10 02 02 00 00 00  0a 10 03 00 0e 00 03 0a ff 07")
USB2_BOS = bytes.fromhex("05 0f 0c 00 01  07 10 02 02 00 00 00")


def plug(
    root: Path, bus_path: str = "1-4", *, interfaces: tuple[tuple[int, str | None], ...] = (), **facts: str
) -> Path:
    """Write a device into a made-up sysfs; interfaces are (class, driver)."""
    folder = root / "sys/bus/usb/devices" / bus_path
    folder.mkdir(parents=True)
    told = {
        "idVendor": "1209", "idProduct": "0001", "busnum": "1", "devnum": "7", "speed": "480", "version": " 2.00",
        "serial": "A1", "product": "Camera", "manufacturer": "Maker",
    } | facts  # fmt: skip
    for name, text in told.items():
        (folder / name).write_text(text + "\n")
    for number, (class_code, driver) in enumerate(interfaces):
        interface = folder / f"{bus_path}:1.{number}"
        interface.mkdir()
        (interface / "bInterfaceNumber").write_text(f"{number:02x}\n")
        (interface / "bInterfaceClass").write_text(f"{class_code:02x}\n")
        if driver is not None:
            target = root / "sys/bus/usb/drivers" / driver
            target.mkdir(parents=True, exist_ok=True)
            (interface / "driver").symlink_to(target)
    return folder


def only(root: Path) -> FoundUsbDevice:
    (device,) = find_usb_devices(root)
    return device


def test_a_camera_is_found_with_ids_serial_place_speed_node_and_drivers(tmp_path: Path) -> None:
    plug(tmp_path, "1-4.2", interfaces=((0x0E, "uvcvideo"), (0x03, None)), serial="SN 5", busnum="3", devnum="12")
    device = only(tmp_path)
    assert (device.vendor_id, device.product_id, device.serial) == (0x1209, 0x0001, "SN 5")
    assert (device.product, device.manufacturer, device.bus_path) == ("Camera", "Maker", "1-4.2")
    assert (device.speed_mbps, device.node) == (480.0, tmp_path / "dev/bus/usb/003/012")
    assert [(each.number, each.class_code, each.driver) for each in device.interfaces] == [
        (0, 0x0E, "uvcvideo"),
        (1, 0x03, None),
    ]
    assert device.is_camera
    assert device.warning is None


def test_devices_come_in_the_order_of_their_places_without_root_hubs(tmp_path: Path) -> None:
    for place in ("1-10", "1-2", "1-2.1", "2-1"):
        plug(tmp_path, place)
    (tmp_path / "sys/bus/usb/devices/usb1").mkdir()
    assert [device.bus_path for device in find_usb_devices(tmp_path)] == ["1-2", "1-2.1", "1-10", "2-1"]


def test_a_device_without_serial_or_names_is_found(tmp_path: Path) -> None:
    folder = plug(tmp_path)
    for name in ("serial", "product", "manufacturer"):
        (folder / name).unlink()
    device = only(tmp_path)
    assert (device.serial, device.product, device.manufacturer) == (None, "", "")
    assert device.name == "1209:0001"


@pytest.mark.parametrize(("name", "text"), [("idVendor", "what"), ("devnum", ""), ("speed", "unknown")])
def test_a_device_that_vanishes_while_it_is_read_is_left_out(tmp_path: Path, name: str, text: str) -> None:
    plug(tmp_path, "1-1")
    folder = plug(tmp_path, "1-2")
    (folder / name).write_text(text)
    assert only(tmp_path).bus_path == "1-1"
    (folder / name).unlink()
    assert only(tmp_path).bus_path == "1-1"


def test_a_machine_without_usb_has_no_devices(tmp_path: Path) -> None:
    assert find_usb_devices(tmp_path) == []


def test_a_usb_3_camera_in_a_slow_port_is_warned_of(tmp_path: Path) -> None:
    folder = plug(tmp_path, version=" 2.10", interfaces=((0x0E, None),))
    (folder / "bos_descriptors").write_bytes(SUPERSPEED_BOS)
    assert only(tmp_path).warning == (
        "1209:0001 Camera at 1-4 runs at 480 Mbit/s but can do 5000; use a USB 3 port and a USB 3 cable"
    )
    (folder / "speed").write_text("5000")
    assert only(tmp_path).warning is None


@pytest.mark.parametrize("bos", [USB2_BOS, b"", b"\x05\x0f\x05\x00\x00", b"\x01\x10\x03\x00"])
def test_a_usb_2_camera_at_its_full_speed_is_not_warned_of(tmp_path: Path, bos: bytes) -> None:
    folder = plug(tmp_path, version=" 2.10", interfaces=((0x0E, None),))
    (folder / "bos_descriptors").write_bytes(bos)
    assert only(tmp_path).warning is None


def test_a_camera_at_12_mbit_is_warned_of_and_a_keyboard_is_not(tmp_path: Path) -> None:
    plug(tmp_path, "1-1", speed="12", interfaces=((0x0E, None),))
    plug(tmp_path, "1-2", speed="1.5", interfaces=((0x03, None),))
    camera, keyboard = find_usb_devices(tmp_path)
    assert camera.warning is not None
    assert "runs at 12 Mbit/s, too slow for a camera" in camera.warning
    assert keyboard.warning is None


def test_a_hid_device_is_found_by_ids_and_serial_with_its_node(tmp_path: Path) -> None:
    plug(tmp_path, "1-1", serial="A", interfaces=((3, "usbhid"),))
    folder = plug(tmp_path, "1-2", serial="B", interfaces=((3, "usbhid"),))
    (folder / "1-2:1.0/0003:1209:0001.0004/hidraw/hidraw3").mkdir(parents=True)
    device = find_hid_device(0x1209, 1, "B", tmp_path)
    assert device.bus_path == "1-2"
    assert hidraw_node(device, tmp_path) == tmp_path / "dev/hidraw3"


def test_a_hid_device_that_is_absent_or_ambiguous_is_named_with_what_is_there(tmp_path: Path) -> None:
    with pytest.raises(DeviceLost, match="0 USB devices 0451:6401, wanted is one; plugged in: none"):
        find_hid_device(0x0451, 0x6401, None, tmp_path)
    for place, serial in (("1-1", "A"), ("1-2", "B")):
        plug(tmp_path, place, serial=serial)
    with pytest.raises(DeviceLost, match="serial A at 1-1, serial B at 1-2; give the serial number"):
        find_hid_device(0x1209, 1, None, tmp_path)
    with pytest.raises(DeviceLost, match="0 USB devices 1209:0001 with serial C"):
        find_hid_device(0x1209, 1, "C", tmp_path)


def test_a_hid_device_without_a_node_says_which_driver_is_missing(tmp_path: Path) -> None:
    plug(tmp_path, interfaces=((3, None),))
    with pytest.raises(DeviceLost, match="modprobe usbhid"):
        hidraw_node(only(tmp_path), tmp_path)


def test_without_a_libusb_library_the_package_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(usb.backend.libusb1, "get_backend", lambda: None)
    with pytest.raises(DeviceError, match=r"apt-get install libusb-1\.0-0"):
        libusb()
    plug(tmp_path)
    with pytest.raises(DeviceError, match="libusb"):
        open_usb_device(only(tmp_path))


def test_a_device_that_libusb_does_not_find_is_lost(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plug(tmp_path)
    monkeypatch.setattr(usb.backend.libusb1, "get_backend", lambda: object())
    monkeypatch.setattr("usb.core.find", lambda **wanted: None)
    with pytest.raises(DeviceLost, match="1209:0001 Camera is no longer at 1-4"):
        open_usb_device(only(tmp_path))
