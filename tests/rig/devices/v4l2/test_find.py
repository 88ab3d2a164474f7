"""Cameras by what stays, on made-up machines."""

from collections.abc import Callable
from pathlib import Path

import pytest

from rig.devices.v4l2.find import NodeFacts, find_camera, find_cameras
from rig.errors import DeviceError, DeviceForbidden, DeviceLost


class Machine:
    """A root folder with sys and dev as the kernel lays them out."""

    def __init__(self, root: Path):
        self.root = root
        self.facts: dict[str, NodeFacts | None] = {}
        (root / "dev").mkdir()
        (root / "sys/class/video4linux").mkdir(parents=True)

    def query(self, node: Path) -> NodeFacts | None:
        return self.facts[node.name]

    def node(self, number: int, device: Path, bus_path: str, *, index: int = 0, captures: bool = True) -> None:
        name = f"video{number}"
        folder = device / "video4linux" / name
        folder.mkdir(parents=True)
        (folder / "name").write_text(f"Camera {number}\n")
        (folder / "index").write_text(f"{index}\n")
        (folder / "device").symlink_to(device)
        (self.root / "sys/class/video4linux" / name).symlink_to(folder)
        (self.root / "dev" / name).touch()
        self.facts[name] = NodeFacts("uvcvideo", bus_path, captures)

    def usb(self, port: str, *, serial: str | None, product: str = "0825", interface: int = 0) -> Path:
        """An interface of a USB device; the device is made when it is not there yet."""
        device = self.root / "sys/devices/pci0000:00/0000:00:14.0/usb1" / port
        device.mkdir(parents=True, exist_ok=True)
        facts = {"idVendor": "046d", "idProduct": product, "speed": "480", "devpath": port.split("-")[1]}
        for file, text in {**facts, **({"serial": serial} if serial else {})}.items():
            (device / file).write_text(text + "\n")
        made = device / f"{port}:1.{interface}"
        made.mkdir()
        return made

    def ids(self) -> list[str]:
        return [camera.device_id for camera in find_cameras(self.root, self.query)]


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    return Machine(tmp_path)


@pytest.fixture
def find(machine: Machine) -> Callable[[str], object]:
    return lambda device_id: find_camera(device_id, machine.root, machine.query)


def test_a_machine_without_cameras_has_none(machine: Machine) -> None:
    assert machine.ids() == []


def test_a_camera_with_a_serial_number_is_named_by_it(machine: Machine) -> None:
    machine.node(4, machine.usb("1-3", serial="8F2A"), "usb-0000:00:14.0-3")
    (camera,) = find_cameras(machine.root, machine.query)
    assert camera.device_id == "usb-046d:0825-8F2A"
    assert (camera.node, camera.name) == (machine.root / "dev/video4", "Camera 4")
    assert (camera.vendor_id, camera.product_id, camera.serial) == (0x46D, 0x825, "8F2A")
    assert (camera.bus_path, camera.usb_port, camera.usb_speed_mbps) == ("usb-0000:00:14.0-3", "1-3", 480.0)


def test_without_serial_number_it_is_named_by_where_it_is_plugged_in(machine: Machine) -> None:
    machine.node(0, machine.usb("1-3", serial=None), "usb-0000:00:14.0-3")
    machine.node(1, machine.root / "sys/devices/platform/vivid.0", "platform:vivid-000")
    assert machine.ids() == ["platform:vivid-000", "usb-0000:00:14.0-3"]


def test_twins_with_one_serial_number_are_told_apart_by_their_ports(machine: Machine) -> None:
    machine.node(0, machine.usb("1-3", serial="0001"), "usb-0000:00:14.0-3")
    machine.node(2, machine.usb("1-4", serial="0001"), "usb-0000:00:14.0-4")
    assert machine.ids() == ["usb-0000:00:14.0-3", "usb-0000:00:14.0-4"]


def test_two_cameras_in_one_case_are_told_apart(machine: Machine) -> None:
    machine.node(0, machine.usb("1-3", serial="D435"), "usb-0000:00:14.0-3")
    machine.node(2, machine.usb("1-3", serial="D435", interface=3), "usb-0000:00:14.0-3")
    assert machine.ids() == ["usb-0000:00:14.0-3#1", "usb-0000:00:14.0-3#2"]


def test_metadata_nodes_and_outputs_are_no_cameras(machine: Machine) -> None:
    device = machine.usb("1-3", serial="A")
    machine.node(0, device, "usb-0000:00:14.0-3")
    machine.node(1, device, "usb-0000:00:14.0-3", index=1, captures=False)
    machine.node(2, machine.root / "sys/devices/platform/out.0", "platform:out", captures=False)
    assert machine.ids() == ["usb-046d:0825-A"]


def test_the_first_node_that_captures_counts_although_an_old_one_has_index_0(machine: Machine) -> None:
    machine.node(3, machine.root / "sys/devices/platform/vivid.0", "platform:vivid-000", index=2)
    assert machine.ids() == ["platform:vivid-000"]


def test_a_usb_camera_that_may_not_be_asked_is_named_by_sysfs(machine: Machine) -> None:
    machine.node(0, machine.usb("1-3.2", serial=None), "")
    machine.facts["video0"] = None
    assert machine.ids() == ["usb-0000:00:14.0-3.2"]


def test_a_camera_is_found_by_serial_number_and_by_port(machine: Machine, find: Callable[[str], object]) -> None:
    machine.node(7, machine.usb("1-3", serial="8F2A"), "usb-0000:00:14.0-3")
    assert find("usb-046d:0825-8F2A") == find("usb-0000:00:14.0-3") == find_cameras(machine.root, machine.query)[0]


def test_a_missing_camera_is_lost_and_the_message_lists_the_others(
    machine: Machine, find: Callable[[str], object]
) -> None:
    with pytest.raises(DeviceLost, match="no camera at all"):
        find("usb-046d:0825-B")
    machine.node(0, machine.usb("1-3", serial="A"), "usb-0000:00:14.0-3")
    with pytest.raises(DeviceLost, match=r"'usb-046d:0825-B' is plugged in; there is usb-046d:0825-A \(Camera 0\)"):
        find("usb-046d:0825-B")


def test_an_id_that_two_cameras_have_is_refused_with_better_ones(
    machine: Machine, find: Callable[[str], object]
) -> None:
    for number, port in enumerate(("1-3", "1-4")):
        machine.node(number, machine.usb(port, serial="0001"), f"usb-0000:00:14.0-{port[-1]}")
    with pytest.raises(DeviceError, match=r"2 cameras are .*: usb-0000:00:14.0-3, usb-0000:00:14.0-4") as refused:
        find("usb-046d:0825-0001")
    assert not isinstance(refused.value, DeviceLost)


def test_a_camera_that_may_not_be_asked_could_be_the_one(
    machine: Machine, find: Callable[[str], object], monkeypatch: pytest.MonkeyPatch
) -> None:
    machine.node(0, machine.root / "sys/devices/platform/cam.0", "platform:cam")
    machine.facts["video0"] = None
    monkeypatch.setattr("os.access", lambda *_, **__: False)
    with pytest.raises(DeviceForbidden, match=r"video0 may not be; .*usermod -aG"):
        find("platform:cam")
