"""USB devices on the kernel's own drivers: an emulated camera under uvcvideo, an emulated LightCrafter under usbhid."""

from collections.abc import Iterator
from pathlib import Path
from uuid import UUID

import pytest
import usb.core

from rig.devices.clock import SystemClock
from rig.devices.lightcrafter.controller import LightCrafter, open_lightcrafter
from rig.devices.lightcrafter.protocol import PRODUCT_ID, VENDOR_ID, DisplayMode, Run, StoredPattern
from rig.devices.usb.extension_unit import VendorControls, extension_units_of, vendor_controls
from rig.devices.usb.find import FoundUsbDevice, find_usb_devices
from rig.devices.usb.handle import libusb, open_usb_device
from rig.devices.usb.hid import LibusbTransport, find_hid_device, hidraw_node, open_hid
from rig.devices.usb.reset import reset_usb_device
from rig.devices.v4l2.node import Node
from rig.emulated.usbip.attach import Attachment, attach
from rig.emulated.uvc.camera import UvcCamera
from rig.emulated.uvc.descriptors import EXTENSION_GUID
from rig.errors import DeviceBusy, DeviceForbidden, DeviceLost, SettingRefused
from tests.device_lab.guest.rights import as_nobody
from tests.device_lab.programs import output_of
from tests.device_lab.waiting import GENEROUS_S, wait_until
from tests.rig.devices.lightcrafter.emulated_controller import LightCrafterEmulation
from tests.rig.devices.lightcrafter.emulated_usb import LightCrafterUsb
from tests.rig.emulated.numbered_pictures import PatternSource

REGISTER, FIRMWARE = 1, 2
CLOCK = SystemClock()


def found(serial: str) -> list[FoundUsbDevice]:
    return [device for device in find_usb_devices() if device.serial == serial]


def with_drivers(serial: str, driver: str) -> bool:
    devices = found(serial)
    return len(devices) == 1 and all(interface.driver == driver for interface in devices[0].interfaces)


def video_node(device: FoundUsbDevice) -> Path:
    folders = sorted(device.interfaces[0].folder.glob("video4linux/video*"), key=lambda folder: int(folder.name[5:]))
    return Path("/dev") / folders[0].name


@pytest.fixture(scope="module")
def camera() -> Iterator[UvcCamera]:
    output_of("modprobe", "-a", "vhci-hcd", "uvcvideo")
    device = UvcCamera(source=PatternSource(), serial="LAB1", name="Lab camera")
    with attach(device):
        wait_until(lambda: with_drivers("LAB1", "uvcvideo") and video_node(found("LAB1")[0]).exists(), "uvcvideo")
        yield device


@pytest.fixture
def controller() -> Iterator[tuple[LightCrafterEmulation, Attachment]]:
    output_of("modprobe", "-a", "vhci-hcd", "usbhid", "hid-generic")
    emulation = LightCrafterEmulation()
    with attach(LightCrafterUsb(emulation, "LCR-7")) as plugged:
        wait_until(lambda: with_drivers("LCR-7", "usbhid") and has_hidraw(), "hidraw")
        yield emulation, plugged


def has_hidraw() -> bool:
    try:
        return hidraw_node(find_hid_device(VENDOR_ID, PRODUCT_ID, "LCR-7")).exists()
    except DeviceLost:
        return False


@pytest.fixture
def lightcrafter(controller: object) -> Iterator[LightCrafter]:
    device = open_lightcrafter("LCR-7", CLOCK)
    yield device
    device.close()


@pytest.fixture
def vendor(camera: UvcCamera) -> Iterator[VendorControls]:
    with vendor_controls(video_node(found("LAB1")[0]), EXTENSION_GUID) as controls:
        yield controls


def test_sysfs_tells_serial_names_and_speed_of_the_camera(camera: UvcCamera) -> None:
    (device,) = found("LAB1")
    assert (device.vendor_id, device.product_id, device.product) == (0x1209, 0x0001, "Lab camera")
    assert (device.speed_mbps, device.is_camera, device.warning) == (480.0, True, None)


def test_libusb_sees_what_sysfs_sees_and_can_take_a_hid_interface(
    camera: UvcCamera, controller: tuple[LightCrafterEmulation, Attachment]
) -> None:
    """One test, because libusb hears of devices that are plugged in later from udev, and the lab has none."""
    devices = {serial: found(serial)[0] for serial in ("LAB1", "LCR-7")}
    places = {
        (int(each.node.parent.name), int(each.node.name), each.vendor_id, each.product_id) for each in devices.values()
    }
    listed = usb.core.find(find_all=True, backend=libusb())
    assert places <= {(each.bus, each.address, each.idVendor, each.idProduct) for each in listed}
    assert open_usb_device(devices["LAB1"]).serial_number == "LAB1"
    with as_nobody(), pytest.raises(DeviceForbidden, match=r"70-procam-rig-1209-0001\.rules"):
        open_usb_device(devices["LAB1"])
    transport = LibusbTransport(devices["LCR-7"])
    device = LightCrafter(transport, CLOCK)
    assert str(device.version()) == "4.0.0"
    assert found("LCR-7")[0].interfaces[0].driver == "usbfs"
    assert transport.read_report(0.01) is None
    device.close()
    device.close()
    wait_until(lambda: with_drivers("LCR-7", "usbhid"), "usbhid")


def test_vendor_controls_are_read_and_written_through_uvcvideo(vendor: VendorControls) -> None:
    units = extension_units_of(video_node(found("LAB1")[0]))
    assert [(unit.guid, unit.selectors) for unit in units] == [(EXTENSION_GUID, (REGISTER, FIRMWARE))]
    assert vendor.describe(REGISTER).length == 32
    vendor.write(REGISTER, bytes(range(32)))
    assert vendor.read(REGISTER) == bytes(range(32))
    assert vendor.read(FIRMWARE) == b"1.04"


def test_what_the_camera_or_the_driver_refuses_is_named(camera: UvcCamera, vendor: VendorControls) -> None:
    with pytest.raises(SettingRefused, match="can only be read"):
        vendor.write(FIRMWARE, b"2.00")
    with pytest.raises(SettingRefused, match="no such unit or control"):
        vendor.read(7)
    camera.faults.stalled_controls.add((4, REGISTER))
    with pytest.raises(SettingRefused, match="GET_LEN of control 1"):
        vendor.read(REGISTER)
    camera.faults.stalled_controls.clear()
    with pytest.raises(SettingRefused, match="the camera has: " + str(EXTENSION_GUID)):
        with vendor_controls(video_node(found("LAB1")[0]), UUID(int=1)):
            pass


def test_a_reset_enumerates_a_hung_camera_anew_and_it_streams_again(camera: UvcCamera) -> None:
    camera.faults.frozen_until_reset = True
    before = found("LAB1")[0]
    after = reset_usb_device(before)
    assert (after.serial, after.bus_path) == ("LAB1", before.bus_path)
    wait_until(lambda: video_node(after).exists(), "the video node")
    with Node(video_node(after), patience_s=GENEROUS_S):
        pass  # it opens: for a moment after it was plugged in, a camera's node is busy
    stream = ("--stream-mmap=2", "--stream-count=3", "--stream-to=/dev/null")
    output_of("v4l2-ctl", "-d", video_node(after), *stream)


def test_a_reset_by_authorisation_works_without_the_ioctl(camera: UvcCamera, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*given: object) -> None:
        raise OSError(5, "refused")

    monkeypatch.setattr("rig.devices.usb.reset.fcntl.ioctl", refuse)
    before = found("LAB1")[0]
    after = reset_usb_device(before.bus_path)
    assert [interface.driver for interface in after.interfaces] == ["uvcvideo", "uvcvideo"]


def test_another_user_is_told_the_rule_for_a_reset(camera: UvcCamera) -> None:
    with as_nobody(), pytest.raises(DeviceForbidden, match=r"70-procam-rig-1209-0001\.rules"):
        reset_usb_device(found("LAB1")[0])


def test_a_lightcrafter_is_set_up_whole_over_hidraw(
    controller: tuple[LightCrafterEmulation, Attachment], lightcrafter: LightCrafter
) -> None:
    registers = controller[0].registers
    assert str(lightcrafter.version()) == "4.0.0"
    found_state = lightcrafter.state()
    lightcrafter.prepare_video((80, 90, 100))
    assert (registers.gamma, registers.led_currents) == (0, bytes([175, 165, 155]))
    lightcrafter.set_trigger_out_1(0.0, 1e-6)
    patterns = [StoredPattern(number=number, bit_depth=1) for number in range(24)]
    lightcrafter.set_up_patterns(patterns, exposure_us=400, frame_period_us=690, refresh_rate_hz=60.0)
    lightcrafter.run(Run.START)
    assert (registers.mode, registers.running) == (1, 2)
    lightcrafter.restore(found_state)
    assert lightcrafter.display_mode() is DisplayMode.VIDEO
    assert (registers.gamma, registers.led_currents) == (0x80, bytes([151, 120, 125]))


def test_a_refusal_and_a_silence_over_hidraw_are_named(
    controller: tuple[LightCrafterEmulation, Attachment], lightcrafter: LightCrafter
) -> None:
    faults = controller[0].faults
    faults.refused.add(0x1A0E)
    with pytest.raises(SettingRefused, match="refuses the value 00 for GAMMA"):
        lightcrafter.gamma_off()
    faults.silent = True
    with pytest.raises(DeviceLost, match="no answer to SOFTWARE_VERSION within 1 s"):
        lightcrafter.version()


def test_a_pulled_cable_is_lost_and_the_device_is_found_again(
    controller: tuple[LightCrafterEmulation, Attachment], lightcrafter: LightCrafter
) -> None:
    controller[1].unplug()
    wait_until(lambda: not found("LCR-7"), "the kernel's notice")
    with pytest.raises(DeviceLost, match="went away"):
        lightcrafter.version()
    lightcrafter.close()
    with pytest.raises(DeviceLost, match="0 USB devices 0451:6401 with serial LCR-7"):
        open_lightcrafter("LCR-7", CLOCK)
    with attach(LightCrafterUsb(LightCrafterEmulation(), "LCR-7")):
        wait_until(has_hidraw, "hidraw")
        again = open_lightcrafter("LCR-7", CLOCK)
        assert again.main_status().gamma_on
        again.close()


def test_a_second_program_is_told_that_the_first_holds_it(
    controller: tuple[LightCrafterEmulation, Attachment], lightcrafter: LightCrafter
) -> None:
    with pytest.raises(DeviceBusy, match="another program controls"):
        open_lightcrafter("LCR-7", CLOCK)


def test_another_user_is_told_the_rule_for_hidraw(controller: tuple[LightCrafterEmulation, Attachment]) -> None:
    with as_nobody(), pytest.raises(DeviceForbidden, match="hidraw") as caught:
        open_hid(find_hid_device(VENDOR_ID, PRODUCT_ID))
    assert "70-procam-rig-0451-6401.rules" in str(caught.value)
