"""Reports through hidraw and libusb end in time, and errors say what to do; the emulated device keeps its answers."""

import errno
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace

import pytest
import usb.core
import usb.util

from rig.devices.usb import hid
from rig.devices.usb.find import FoundUsbDevice, UsbInterface
from rig.devices.usb.hid import HidrawTransport, LibusbTransport, hidraw_node, open_hid
from rig.emulated.usbip.device import Setup, Stall, StandardRequests, Transfer
from rig.errors import DeviceBusy, DeviceError, DeviceForbidden, DeviceLost
from tests.rig.devices.lightcrafter.emulated_controller import LightCrafterEmulation
from tests.rig.devices.lightcrafter.emulated_usb import LightCrafterUsb

QUESTION = bytes.fromhex("c0 01 02 00 05 02") + bytes(58)


@pytest.fixture
def found(tmp_path: Path) -> FoundUsbDevice:
    """A HID device whose hidraw node is a pipe: what is written comes back."""
    interface = tmp_path / "sys/1-2:1.0"
    (interface / "0003:0451:6401.0001/hidraw/hidraw3").mkdir(parents=True)
    (tmp_path / "dev").mkdir()
    os.mkfifo(tmp_path / "dev/hidraw3")
    return FoundUsbDevice(
        vendor_id=0x0451, product_id=0x6401, serial="A", product="DLPC350", manufacturer="", bus_path="1-2",
        speed_mbps=12.0, node=tmp_path / "dev/bus/usb/001/002", superspeed=False,
        interfaces=(UsbInterface(0, 0x03, "usbhid", interface),),
    )  # fmt: skip


@pytest.fixture
def transport(found: FoundUsbDevice, tmp_path: Path) -> Iterator[HidrawTransport]:
    transport = HidrawTransport(found, hidraw_node(found, tmp_path))
    yield transport
    transport.close()
    transport.close()


def test_a_report_goes_out_behind_a_report_number_of_0(transport: HidrawTransport) -> None:
    transport.write_report(QUESTION)
    assert transport.read_report(1.0) == (b"\0" + QUESTION)[:64]


def test_waiting_for_a_report_ends_in_time(transport: HidrawTransport) -> None:
    assert transport.read_report(0.01) is None
    assert transport.read_report(-1.0) is None


def test_a_second_opener_is_told_to_wait(transport: HidrawTransport, found: FoundUsbDevice, tmp_path: Path) -> None:
    with pytest.raises(DeviceBusy, match="another program controls"):
        HidrawTransport(found, hidraw_node(found, tmp_path))
    transport.close()
    HidrawTransport(found, hidraw_node(found, tmp_path)).close()


def raiser(number: int) -> object:
    def fail(*given: object) -> None:
        raise OSError(number, os.strerror(number))

    return fail


@pytest.mark.parametrize(
    ("number", "kind", "text"),
    [(errno.EACCES, DeviceForbidden, "70-procam-rig-0451-6401"), (errno.ENODEV, DeviceLost, "plug it in again")],
)
def test_a_node_that_does_not_open_is_named(
    found: FoundUsbDevice,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    number: int,
    kind: type[DeviceError],
    text: str,
) -> None:
    monkeypatch.setattr("os.open", raiser(number))
    with pytest.raises(kind, match=text):
        HidrawTransport(found, hidraw_node(found, tmp_path))


@pytest.mark.parametrize(("number", "text"), [(errno.EIO, "went away"), (errno.ETIMEDOUT, "takes no report")])
def test_a_device_that_does_not_take_or_give_reports_is_lost(
    transport: HidrawTransport, monkeypatch: pytest.MonkeyPatch, number: int, text: str
) -> None:
    transport.write_report(QUESTION)
    with monkeypatch.context() as patched:
        patched.setattr("os.write", raiser(number))
        patched.setattr("os.read", raiser(number))
        with pytest.raises(DeviceLost, match=text):
            transport.write_report(QUESTION)
        with pytest.raises(DeviceLost, match=text):
            transport.read_report(1.0)


@dataclass
class FakeEndpoint:
    bEndpointAddress: int  # noqa: N815 - pyusb's name
    error: usb.core.USBError | None = None
    written: list[bytes] = field(default_factory=list)

    def write(self, report: bytes, timeout: int) -> None:
        if self.error:
            raise self.error
        self.written.append(report)

    def read(self, length: int, timeout: int) -> list[int]:
        if self.error:
            raise self.error
        return list(QUESTION)


class FakePyusbDevice:
    def __init__(self) -> None:
        self.endpoints = [FakeEndpoint(0x81), FakeEndpoint(0x01)]
        self.calls: list[str] = []

    def is_kernel_driver_active(self, number: int) -> bool:
        return "detach" not in self.calls

    def detach_kernel_driver(self, number: int) -> None:
        self.calls.append("detach")

    def attach_kernel_driver(self, number: int) -> None:
        self.calls.append("attach")

    def get_active_configuration(self) -> dict[tuple[int, int], SimpleNamespace]:
        return {(0, 0): SimpleNamespace(endpoints=lambda: self.endpoints)}


@pytest.fixture
def pyusb(monkeypatch: pytest.MonkeyPatch) -> FakePyusbDevice:
    device = FakePyusbDevice()
    monkeypatch.setattr(hid, "open_usb_device", lambda found: device)
    for name in ("claim_interface", "release_interface"):
        monkeypatch.setattr(usb.util, name, lambda device, number, name=name: device.calls.append(name))
    monkeypatch.setattr(usb.util, "dispose_resources", lambda device: device.calls.append("dispose"))
    return device


def test_libusb_takes_the_device_from_the_kernel_and_gives_it_back(
    found: FoundUsbDevice, pyusb: FakePyusbDevice
) -> None:
    transport = LibusbTransport(found)
    transport.write_report(QUESTION)
    assert transport.read_report(1.0) == QUESTION
    transport.close()
    transport.close()
    assert pyusb.calls == ["detach", "claim_interface", "release_interface", "attach", "dispose"]
    assert pyusb.endpoints[1].written == [QUESTION]


def test_the_kernels_node_is_taken_where_there_is_one_and_libusb_where_there_is_none(
    found: FoundUsbDevice, pyusb: FakePyusbDevice, tmp_path: Path
) -> None:
    by_kernel = open_hid(found, tmp_path)
    assert isinstance(by_kernel, HidrawTransport)
    by_kernel.close()
    assert pyusb.calls == []
    (tmp_path / "sys/1-2:1.0/0003:0451:6401.0001/hidraw/hidraw3").rmdir()
    by_libusb = open_hid(found, tmp_path)
    assert isinstance(by_libusb, LibusbTransport)
    by_libusb.close()
    assert pyusb.calls[-1] == "dispose"


@pytest.mark.parametrize(("number", "kind"), [(19, DeviceLost), (5, DeviceLost), (13, DeviceForbidden)])
def test_libusbs_errors_are_named(
    found: FoundUsbDevice, pyusb: FakePyusbDevice, number: int, kind: type[DeviceError]
) -> None:
    transport = LibusbTransport(found)
    for endpoint in pyusb.endpoints:
        endpoint.error = usb.core.USBError("broken", errno=number)
    with pytest.raises(kind):
        transport.write_report(QUESTION)
    with pytest.raises(kind):
        transport.read_report(0.1)
    pyusb.endpoints[0].error = usb.core.USBTimeoutError("late", errno=110)
    assert transport.read_report(0.1) is None


def test_an_interface_that_another_program_holds_is_named(
    found: FoundUsbDevice, pyusb: FakePyusbDevice, monkeypatch: pytest.MonkeyPatch
) -> None:
    def busy(device: object, number: int) -> None:
        raise usb.core.USBError("busy", errno=errno.EBUSY)

    monkeypatch.setattr(usb.util, "claim_interface", busy)
    with pytest.raises(DeviceBusy, match="another program holds its interface"):
        LibusbTransport(found)
    assert pyusb.calls[-2:] == ["attach", "dispose"]


def test_a_device_without_endpoints_both_ways_is_refused_and_given_back(
    found: FoundUsbDevice, pyusb: FakePyusbDevice
) -> None:
    del pyusb.endpoints[1]
    with pytest.raises(DeviceError, match="not one endpoint each way"):
        LibusbTransport(found)
    assert pyusb.calls[-1] == "dispose"


class Recipient:
    """Counts what an emulated device answers; transfers in `cancelled` were taken back."""

    def __init__(self) -> None:
        self.device = LightCrafterUsb(LightCrafterEmulation(), "S1")
        self.answers: dict[int, bytes] = {}
        self.cancelled: set[int] = set()

    def submit(self, number: int, endpoint: int, data: bytes = b"") -> None:
        self.device.submit(
            Transfer(number=number, endpoint=endpoint, length=64, data=data, packet_table=b"", answer=self.answer)
        )

    def answer(self, transfer: Transfer, data: object, status: int, table: bytes) -> bool:
        if transfer.number in self.cancelled:
            return False
        assert isinstance(data, tuple)
        self.answers[transfer.number] = b"".join(data)
        return True


def test_the_emulated_device_answers_a_question_that_waited_and_one_that_comes_later() -> None:
    host = Recipient()
    host.submit(1, 0x81)
    host.submit(2, 0x01, QUESTION)
    assert host.answers[1][:4] == bytes.fromhex("c0 01 10 00")
    host.submit(3, 0x01, QUESTION)
    host.submit(4, 0x81)
    assert host.answers[4] == host.answers[1]


def test_an_answer_whose_question_was_taken_back_goes_to_the_next() -> None:
    host = Recipient()
    host.submit(1, 0x81)
    host.cancelled.add(1)
    host.submit(2, 0x01, QUESTION)
    host.submit(3, 0x81)
    assert host.answers[3][:4] == bytes.fromhex("c0 01 10 00")


def test_the_emulated_device_says_that_it_is_a_hid_device_with_64_byte_reports() -> None:
    device = LightCrafterUsb(LightCrafterEmulation(), "S1")
    requests = StandardRequests(device)
    assert requests.answer(Setup(request_type=0x80, request=6, value=0x0100, index=0, length=18), b"")[
        8:12
    ] == bytes.fromhex("51 04 01 64")
    reports = requests.answer(Setup(request_type=0x81, request=6, value=0x2200, index=0, length=255), b"")
    assert reports.count(b"\x95\x40") == 1
    assert reports.endswith(b"\xc0")
    assert requests.answer(Setup(request_type=0x21, request=0x0A, value=0, index=0, length=0), b"") == b""
    with pytest.raises(Stall):
        requests.answer(Setup(request_type=0xA1, request=1, value=0, index=0, length=64), b"")
