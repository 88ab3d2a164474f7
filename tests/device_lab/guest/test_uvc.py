"""The emulated USB camera under the real drivers vhci-hcd and uvcvideo, byte for byte, seen by other programs."""

from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
import usb.core

from rig.devices.v4l2.find import find_cameras
from rig.emulated.usbip.attach import attach
from rig.emulated.uvc.camera import FrameRequest, UvcCamera
from rig.emulated.uvc.descriptors import Transport
from rig.errors import DeviceError, DeviceForbidden
from tests.device_lab.guest.emulated_camera import (
    HEIGHT,
    NODES,
    WIDTH,
    Plugged,
    load_drivers,
    plug_in,
    plugging,
)
from tests.device_lab.guest.rights import as_nobody
from tests.device_lab.programs import output_of
from tests.device_lab.waiting import wait_until
from tests.rig.emulated.numbered_pictures import (
    FULL_SCALES,
    MEDIUM_EXPOSURE_S,
    PatternSource,
    encode_picture,
    read_number,
)

ALL_FORMATS = tuple(FULL_SCALES)


def stream(node: Path, fourcc: str, count: int, file: Path, *, size=(WIDTH, HEIGHT)) -> bytes:
    form = f"--set-fmt-video=width={size[0]},height={size[1]},pixelformat={fourcc}"
    output_of("v4l2-ctl", "-d", node, form, "--stream-mmap=3", f"--stream-count={count}", f"--stream-to={file}")
    return file.read_bytes()


def picture_of(frame: bytes, fourcc: str) -> np.ndarray:
    """Grey digital numbers of a frame's bytes."""
    if fourcc == "MJPG":
        return cv2.imdecode(np.frombuffer(frame, np.uint8), cv2.IMREAD_GRAYSCALE)
    if fourcc == "YUYV":
        return np.frombuffer(frame, np.uint8).reshape(HEIGHT, WIDTH, 2)[..., 0]
    return np.frombuffer(frame, np.uint8 if FULL_SCALES[fourcc] == 255 else "<u2").reshape(HEIGHT, WIDTH)


@pytest.fixture(scope="module", autouse=True)
def drivers() -> None:
    load_drivers()


@pytest.fixture(scope="module")
def every_format(drivers: None) -> Iterator[Plugged]:
    plugged = plug_in(serial="EVERY1", fourccs=ALL_FORMATS, name="Camera of every format")
    output_of("v4l2-ctl", "-d", plugged.node, "-c", "auto_exposure=1,exposure_time_absolute=100")
    yield plugged
    plugged.unplug()


@pytest.fixture
def plug() -> Iterator[Callable[..., Plugged]]:
    with plugging() as plug:
        yield plug


def test_the_system_knows_the_camera_by_name_and_serial_number(every_format: Plugged) -> None:
    device = NODES / every_format.node.name / "device/.."
    assert (device / "serial").read_text().strip() == "EVERY1"
    assert (device / "speed").read_text().strip() == "480"
    assert (NODES / every_format.node.name / "name").read_text().startswith("Camera of every format")
    assert "ID 1209:0001" in output_of("lsusb")
    described = output_of("lsusb", "-v", "-d", "1209:0001")
    assert described.count("bFormatIndex") == len(ALL_FORMATS)
    assert not [line for line in described.splitlines() if "Warning" in line or "unrecognized" in line.lower()]


def test_another_program_lists_formats_and_controls(every_format: Plugged) -> None:
    formats = output_of("v4l2-ctl", "-d", every_format.node, "--list-formats-ext")
    assert [fourcc for fourcc in ALL_FORMATS if f"'{fourcc}'" not in formats] == []
    assert formats.count("320x240") == len(ALL_FORMATS)
    controls = output_of("v4l2-ctl", "-d", every_format.node, "-l")
    assert "exposure_time_absolute 0x009a0902 (int)    : min=1 max=5000 step=1 default=156 value=100" in controls
    assert "focus_absolute 0x009a090a (int)    : min=0 max=250 step=5 default=0 value=0 flags=inactive" in controls
    for name in ("brightness", "contrast", "gain", "gamma", "sharpness", "power_line_frequency", "white_balance"):
        assert name in controls


@pytest.mark.parametrize("fourcc", ALL_FORMATS)
def test_frames_of_every_format_arrive_with_exactly_their_bytes(
    every_format: Plugged, fourcc: str, tmp_path: Path
) -> None:
    count = 1 if fourcc == "MJPG" else 3
    data = stream(every_format.node, fourcc, count, tmp_path / "frames")
    size = len(data) // count
    frames = [data[start : start + size] for start in range(0, len(data), size)]
    numbers = [read_number(picture_of(frame, fourcc)) for frame in frames]
    assert numbers == sorted(set(numbers))
    for number, frame in zip(numbers, frames, strict=True):
        expected = PatternSource().picture(
            FrameRequest(
                fourcc=fourcc, width_px=WIDTH, height_px=HEIGHT, started_s=0.0, exposure_s=0.01, gain=1.0, number=number
            )
        )
        assert frame == encode_picture(expected, fourcc)


def test_a_bulk_camera_serves_the_same_pictures(plug: Callable[..., Plugged], tmp_path: Path) -> None:
    plugged = plug(serial="BULK1", transport=Transport.BULK, sizes=((160, 120),))
    output_of("v4l2-ctl", "-d", plugged.node, "-c", "auto_exposure=1,exposure_time_absolute=100")
    data = stream(plugged.node, "GREY", 3, tmp_path / "frames", size=(160, 120))
    assert len(data) == 3 * 160 * 120
    assert np.frombuffer(data, np.uint8)[-1] == round(255 / 2 * 0.01 / MEDIUM_EXPOSURE_S)


def test_libusb_sees_the_camera_and_its_strings(every_format: Plugged) -> None:
    device = usb.core.find(idVendor=0x1209, idProduct=0x0001)
    assert device is not None
    assert (device.serial_number, device.product) == ("EVERY1", "Camera of every format")
    usb.util.dispose_resources(device)


def test_a_camera_stays_where_it_is_while_others_come_and_go(plug: Callable[..., Plugged]) -> None:
    """The kernel would put it to sleep, and its emulated controller loses devices that wake up beside others."""
    node = plug(serial="STAYS1").node
    device = (NODES / node.name / "device/..").resolve()
    wait_until(lambda: (device / "power/autosuspend_delay_ms").read_text().strip() == "-1", "being kept awake")
    number = (device / "devnum").read_text()
    for _ in range(4):
        plug(serial="PASSING1").unplug()
        with node.open("rb"):
            assert (device / "devnum").read_text() == number
    assert (device / "power/runtime_status").read_text().strip() == "active"


def test_an_occupied_port_is_named(every_format: Plugged) -> None:
    with pytest.raises(DeviceError, match="port"):
        attach(UvcCamera(source=PatternSource()), port=every_format.attachment.port)


def test_plugging_in_needs_root_and_says_so(every_format: Plugged) -> None:
    with as_nobody(), pytest.raises(DeviceForbidden, match="sudo"):
        attach(UvcCamera(source=PatternSource()))


def test_a_camera_without_a_serial_number_is_known_by_its_port() -> None:
    with attach(UvcCamera(source=PatternSource(), serial="", product_id=0x0BAD)):
        wait_until(lambda: [camera for camera in find_cameras() if camera.product_id == 0x0BAD])
        (found,) = [camera for camera in find_cameras() if camera.product_id == 0x0BAD]
        assert found.serial is None
        assert found.device_id == found.bus_path
        assert found.usb_speed_mbps == 480


def test_a_program_may_stop_and_start_as_often_as_it_likes(every_format: Plugged, tmp_path: Path) -> None:
    for size in (1, 2, 1):
        data = stream(every_format.node, "GREY", size, tmp_path / "frames")
        assert len(data) == size * WIDTH * HEIGHT
