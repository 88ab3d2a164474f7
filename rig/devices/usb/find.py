"""Which USB devices are plugged in, told by sysfs: needs no library and no permission."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

VIDEO_CLASS, HID_CLASS = 0x0E, 0x03
FULL_SPEED_MBPS, HIGH_SPEED_MBPS = 12.0, 480.0
_BOS_CAPABILITY, _SUPERSPEED = 0x10, 0x03


@dataclass(frozen=True, slots=True)
class UsbInterface:
    """One interface of the active configuration."""

    number: int
    class_code: int
    """USB class: 0x0e video, 0x03 HID ..."""
    driver: str | None
    """Name of the kernel driver that holds it."""
    folder: Path
    """Its place in sysfs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundUsbDevice:
    """One USB device as the kernel enumerated it."""

    vendor_id: int
    product_id: int
    serial: str | None
    product: str
    manufacturer: str
    bus_path: str
    """Where it is plugged in, e.g. ``1-4.2``; stays when it is unplugged and plugged in again."""
    speed_mbps: float
    """Of the bus now: 1.5, 12, 480, 5000, 10000 ... [Mbit/s]"""
    node: Path
    """``/dev/bus/usb/BBB/DDD``; changes at each plug-in."""
    interfaces: tuple[UsbInterface, ...]
    superspeed: bool
    """It says that it can do USB 3, whatever it does now."""

    @property
    def name(self) -> str:
        """The device's ids and product, for messages."""
        return f"{self.vendor_id:04x}:{self.product_id:04x} {self.product}".rstrip()

    @property
    def is_camera(self) -> bool:
        """It has a video interface."""
        return any(interface.class_code == VIDEO_CLASS for interface in self.interfaces)

    @property
    def warning(self) -> str | None:
        """What is wrong with how it is plugged in, and what to try; None when nothing is."""
        where = f"{self.name} at {self.bus_path} runs at {self.speed_mbps:g} Mbit/s"
        if self.is_camera and self.speed_mbps <= FULL_SPEED_MBPS:
            return f"{where}, too slow for a camera; use another cable or port, without a hub"
        if self.superspeed and self.speed_mbps <= HIGH_SPEED_MBPS:
            return f"{where} but can do 5000; use a USB 3 port and a USB 3 cable"
        return None


def find_usb_devices(root: Path = Path("/")) -> list[FoundUsbDevice]:
    """List USB devices in the order of their bus paths; root hubs are left out.

    ``root`` is where ``sys`` and ``dev`` lie. Devices that vanish meanwhile are left out.
    """
    folders = sorted((root / "sys/bus/usb/devices").glob("*-*"), key=lambda folder: _path_key(folder.name))
    found = (_device(folder, root) for folder in folders if ":" not in folder.name)
    return [device for device in found if device is not None]


def _path_key(bus_path: str) -> tuple[int, ...]:
    return tuple(int(part) for part in bus_path.replace("-", ".").split(".") if part.isdigit())


def _device(folder: Path, root: Path) -> FoundUsbDevice | None:
    try:
        bus, number = (int(_text(folder / name)) for name in ("busnum", "devnum"))
        return FoundUsbDevice(
            vendor_id=int(_text(folder / "idVendor"), 16),
            product_id=int(_text(folder / "idProduct"), 16),
            serial=_optional(folder / "serial") or None,
            product=_optional(folder / "product"),
            manufacturer=_optional(folder / "manufacturer"),
            bus_path=folder.name,
            speed_mbps=float(_text(folder / "speed")),
            node=root / f"dev/bus/usb/{bus:03d}/{number:03d}",
            interfaces=tuple(_interfaces(folder)),
            superspeed=_superspeed(folder),
        )
    except (OSError, ValueError):  # it went away while being read
        return None


def _interfaces(folder: Path) -> Iterator[UsbInterface]:
    for interface in sorted(folder.glob(f"{folder.name}:*")):
        driver = interface / "driver"
        yield UsbInterface(
            number=int(_text(interface / "bInterfaceNumber"), 16),
            class_code=int(_text(interface / "bInterfaceClass"), 16),
            driver=driver.resolve().name if driver.is_symlink() else None,
            folder=interface,
        )


def _superspeed(folder: Path) -> bool:
    """Whether its BOS descriptor names SuperSpeed; kernels before 6.10 do not show it, and nothing is warned of."""
    try:
        descriptors = (folder / "bos_descriptors").read_bytes()
    except OSError:
        return float(_optional(folder / "version") or 0) >= 3
    capability = bytes([_BOS_CAPABILITY, _SUPERSPEED])
    return any(descriptor[1:3] == capability for descriptor in each_descriptor(descriptors))


def each_descriptor(descriptors: bytes) -> Iterator[bytes]:
    """Cut raw descriptors into pieces of at least 3 bytes; ends where they are damaged."""
    at = 0
    while at < len(descriptors) and 3 <= descriptors[at] <= len(descriptors) - at:
        yield descriptors[at : at + descriptors[at]]
        at += descriptors[at]


def _text(file: Path) -> str:
    return file.read_text(encoding="utf-8", errors="replace").strip()


def _optional(file: Path) -> str:
    try:
        return _text(file)
    except OSError:
        return ""
