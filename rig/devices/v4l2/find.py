"""Which cameras are plugged in, named by what stays when they are plugged in again: never by the node's number."""

from __future__ import annotations

import os
from collections import Counter, defaultdict
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from rig.devices.v4l2 import abi
from rig.devices.v4l2.node import Node, forbidden
from rig.errors import DeviceError, DeviceLost


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundCamera:
    """A camera that the kernel offers."""

    device_id: str
    """``usb-VVVV:PPPP-SERIAL`` when that names one camera only, else its bus path."""
    node: Path
    name: str
    driver: str
    bus_path: str
    """Where it is plugged in: V4L2's ``bus_info``."""
    serial: str | None = None
    vendor_id: int | None = None
    product_id: int | None = None
    usb_speed_mbps: float | None = None
    usb_port: str | None = None
    """The kernel's name of the USB device: bus and ports, such as ``1-4.2``."""


@dataclass(frozen=True, slots=True)
class NodeFacts:
    """What a node says of itself when it is opened."""

    driver: str
    bus_info: str
    captures: bool


def query_node(path: Path) -> NodeFacts | None:
    """Ask a node; None when it cannot be opened, or is no V4L2 node."""
    try:
        with Node(path, patience_s=0.0) as node:
            found = node.call(abi.QUERYCAP, abi.Capability(), "asking what it is")
    except DeviceError:
        return None
    captures = bool(found.device_caps & abi.VIDEO_CAPTURE and found.device_caps & abi.CAP_STREAMING)
    return NodeFacts(found.driver.decode(), found.bus_info.decode(), captures)


def find_cameras(root: Path = Path("/"), query: Callable[[Path], NodeFacts | None] = query_node) -> list[FoundCamera]:
    """Every camera with a streaming capture node, in the order of their bus paths.

    ``root`` is where ``sys`` and ``dev`` are. A node that may not be opened is listed by what sysfs tells.
    """
    by_device: dict[Path, list[Path]] = defaultdict(list)
    for entry in (root / "sys/class/video4linux").glob("video*"):
        by_device[(entry / "device").resolve()].append(entry)
    cameras = [
        camera
        for device, entries in sorted(by_device.items())
        if (camera := _first_that_captures(root, device, entries, query)) is not None
    ]
    return sorted(_with_unique_ids(cameras), key=lambda camera: (camera.bus_path, camera.device_id))


def find_camera(
    device_id: str, root: Path = Path("/"), query: Callable[[Path], NodeFacts | None] = query_node
) -> FoundCamera:
    """The camera with this id, or at this bus path.

    Raises DeviceLost, with a list of what is there, when there is none; DeviceError when there are two.
    """
    cameras = find_cameras(root, query)
    found = [camera for camera in cameras if device_id in (camera.device_id, camera.bus_path, serial_id(camera))]
    exact = [camera for camera in found if camera.device_id == device_id]
    if len(found) > 1 and len(exact) != 1:
        ids = ", ".join(camera.device_id for camera in found)
        raise DeviceError(f"{len(found)} cameras are {device_id!r}; say which in camera.device_id: {ids}")
    if not found:
        _refuse_hidden(device_id, root)
        there = ", ".join(f"{camera.device_id} ({camera.name})" for camera in cameras) or "no camera at all"
        raise DeviceLost(f"no camera {device_id!r} is plugged in; there is {there}: check cable and camera.device_id")
    return (exact or found)[0]


def _refuse_hidden(device_id: str, root: Path) -> None:
    """Raise DeviceForbidden when the camera may be one that cannot be asked."""
    for entry in sorted((root / "sys/class/video4linux").glob("video*")):
        node = root / "dev" / entry.name
        if node.exists() and not os.access(node, os.R_OK | os.W_OK, effective_ids=True):
            raise forbidden(f"no camera that may be opened is {device_id!r}, and {node} may not be", node)


def serial_id(camera: FoundCamera) -> str | None:
    """The id made of maker, product and serial number; None without these."""
    if camera.vendor_id is None or camera.product_id is None or not camera.serial:
        return None
    return f"usb-{camera.vendor_id:04x}:{camera.product_id:04x}-{camera.serial}"


def _first_that_captures(
    root: Path, device: Path, entries: list[Path], query: Callable[[Path], NodeFacts | None]
) -> FoundCamera | None:
    """Of a device's nodes the first that captures video; the others are outputs, metadata and the like.

    The first has index 0, unless somebody still holds a node of before the device was plugged in again.
    """
    for entry in sorted(entries, key=lambda entry: int(_read(entry / "index") or 0)):
        node = root / "dev" / entry.name
        facts = query(node)
        if facts is not None and facts.captures:
            return _describe(device, entry, node, facts)
        if facts is None and node.exists() and _read(entry / "index") == "0" and _usb_device(device) is not None:
            return _describe(device, entry, node, NodeFacts(_driver(device), "", True))
    return None


def _describe(device: Path, entry: Path, node: Path, facts: NodeFacts) -> FoundCamera:
    usb = _usb_device(device)
    camera = FoundCamera(
        device_id="", node=node, name=_read(entry / "name") or entry.name, driver=facts.driver, bus_path=facts.bus_info
    )
    if usb is None:
        return camera
    speed = _read(usb / "speed")
    return replace(
        camera,
        bus_path=facts.bus_info or _usb_bus_path(usb),
        serial=_read(usb / "serial"),
        vendor_id=int(_read(usb / "idVendor") or "0", 16),
        product_id=int(_read(usb / "idProduct") or "0", 16),
        usb_speed_mbps=float(speed) if speed else None,
        usb_port=usb.name,
    )


def _with_unique_ids(cameras: list[FoundCamera]) -> list[FoundCamera]:
    """Serial numbers where they tell cameras apart, else bus paths, else these with the node's interface."""
    serials = Counter(map(serial_id, cameras))
    paths = Counter(camera.bus_path for camera in cameras)
    seen: Counter[str] = Counter()
    named = []
    for camera in cameras:
        serial = serial_id(camera)
        if serial is not None and serials[serial] == 1:
            named.append(replace(camera, device_id=serial))
            continue
        seen[camera.bus_path] += 1
        several = paths[camera.bus_path] > 1
        number = f"#{seen[camera.bus_path]}" if several else ""
        named.append(replace(camera, device_id=camera.bus_path + number))
    return named


def _usb_device(device: Path) -> Path | None:
    """The USB device that an interface belongs to."""
    return next((folder for folder in (device, *device.parents) if (folder / "idVendor").is_file()), None)


def _usb_bus_path(usb: Path) -> str:
    """What V4L2 calls bus_info, for a node that may not be opened: the controller's name and the ports."""
    hub = next((folder for folder in (usb, *usb.parents) if folder.name.startswith("usb")), usb)
    return f"usb-{hub.parent.name}-{_read(usb / 'devpath') or usb.name}"


def _driver(device: Path) -> str:
    return (device / "driver").resolve().name if (device / "driver").exists() else ""


def _read(path: Path) -> str | None:
    try:
        return path.read_text(errors="replace").strip()
    except OSError:
        return None
