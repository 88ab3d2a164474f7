"""Devices as they would be found, for tests without any."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rig.inventory.list import Finders


@dataclass(frozen=True)
class Camera:
    device_id: str = "usb-2bb8:0001-0007"
    node: Path = Path("/dev/video0")
    name: str = "oCam-1MGN-U"
    driver: str = "uvcvideo"
    bus_path: str = "usb-0000:00:14.0-3"
    serial: str | None = "0007"
    vendor_id: int | None = 0x2BB8
    product_id: int | None = 0x0001
    usb_speed_mbps: float | None = 5000.0


@dataclass(frozen=True)
class Format:
    pixel_format: str
    width_px: int
    height_px: int
    frame_rates_hz: tuple[float, ...]
    description: str = ""


@dataclass(frozen=True)
class Control:
    name: str
    id: int
    minimum: int
    maximum: int
    default: int
    value: int | None
    kind: str = "integer"
    step: int = 1
    menu: dict[int, str] = field(default_factory=dict)
    flags: tuple[str, ...] = ()
    is_settable: bool = True


@dataclass(frozen=True)
class Abilities:
    formats: tuple[Format, ...]
    controls: tuple[Control, ...]


@dataclass(frozen=True)
class Mode:
    width_px: int
    height_px: int
    refresh_rate_hz: float | None
    preferred: bool


@dataclass(frozen=True)
class Output:
    connector: str = "HDMI-A-1"
    card: Path = Path("/dev/dri/card0")
    status: str = "connected"
    edid_id: str | None = "GSM-PW800-1"
    monitor_name: str | None = "LG PW800"
    modes: tuple[Mode, ...] = (Mode(1920, 1080, 60.0, True), Mode(1280, 800, 59.81, False))

    @property
    def full_name(self) -> str:
        return f"{self.card.name}:{self.connector}"


@dataclass(frozen=True)
class Monitor:
    name: str = "HDMI-1"
    index: int = 1
    x_px: int = 1920
    y_px: int = 0
    width_px: int = 1280
    height_px: int = 800
    refresh_rate_hz: float = 60.0


@dataclass(frozen=True)
class UsbDevice:
    vendor_id: int
    product_id: int
    serial: str | None = None
    bus_path: str = "1-4"
    node: Path = Path("/dev/bus/usb/001/004")
    warning: str | None = None


EXPOSURE = Control("exposure_time_absolute", 0x009A0902, 1, 2000, 156, 156)
GAIN = Control("gain", 0x00980913, 4, 255, 64, 80)
BRIGHTNESS = Control("brightness", 0x00980900, -64, 64, 0, 12)
FOCUS = Control("focus_absolute", 0x009A090A, 0, 250, 0, 35)
MONO = Abilities(
    (
        Format("MJPG", 3840, 2160, (30.0,)),
        Format("YUYV", 1920, 1080, (30.0, 5.0)),
        Format("GREY", 640, 480, (120.0, 60.0, 30.0)),
        Format("GREY", 1280, 960, (45.0, 30.0)),
        Format("GREY", 2560, 1920, (2.0,)),
    ),
    (EXPOSURE, GAIN, BRIGHTNESS, FOCUS),
)


def finders(**changes: Any) -> Finders:
    """One grey camera and one projector, no desktop, nothing else on USB; change what a test is about."""
    parts: dict[str, Any] = {
        "cameras": lambda: (Camera(),),
        "describe": lambda node: MONO,
        "genicam": lambda: (),
        "stills": lambda: (),
        "outputs": lambda: (Output(),),
        "master_is_free": lambda card: True,
        "monitors": lambda: (),
        "usb_devices": lambda: (),
        "plug_ins": lambda: (),
    }
    return Finders(**(parts | changes))
