"""What `rig devices` lists: found devices with what they can do, and what a rig would take of it."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from rig.devices.protocols import ExposureRange
from rig.inventory.choose import CameraMode
from rig.plug_ins import PlugIn
from rig.records import JsonObject, Record, json_of

if TYPE_CHECKING:
    from rig.devices.kms.find import FoundOutput
    from rig.devices.v4l2.describe import CameraAbilities
    from rig.devices.v4l2.find import FoundCamera
    from rig.devices.window.monitor import FoundMonitor


class ShownMode(Protocol):
    """A mode of an output, or of a monitor."""

    @property
    def width_px(self) -> int:
        """Width of the picture."""
        ...

    @property
    def height_px(self) -> int:
        """Height of the picture."""
        ...

    @property
    def refresh_rate_hz(self) -> float | None:
        """Pictures a second; None or 0 where nobody knows."""
        ...


class ListedDevice(Protocol):
    """Anything that is listed."""

    @property
    def name(self) -> str:
        """What people call it."""
        ...

    def names(self) -> tuple[str | None, ...]:
        """What it may be asked for by."""
        ...


class Pasted(ListedDevice, Protocol):
    """A device that a profile can have."""

    @property
    def profile(self) -> tuple[str, ...]:
        """Lines to paste."""
        ...


class Asked(ListedDevice, Protocol):
    """A device that may have refused to answer."""

    @property
    def error(self) -> str | None:
        """What asking it gave in the place of an answer."""
        ...

    @property
    def warnings(self) -> tuple[str, ...]:
        """What may go wrong with it in a rig."""
        ...


@dataclass(frozen=True, kw_only=True)
class ListedCamera(Record):
    """A camera, and what it can do; or the error that asking it gave."""

    found: FoundCamera
    able: CameraAbilities | None = None
    error: str | None = None
    warnings: tuple[str, ...]
    known_as: str | None = None
    """Maker and model, where there are facts of it."""
    exposure_range_s: ExposureRange | None = None
    mode: CameraMode | None = None
    """The best for a rig."""
    profile: tuple[str, ...]
    """Lines to paste."""

    @property
    def name(self) -> str:
        """What the driver calls it."""
        return self.found.name

    def names(self) -> tuple[str | None, ...]:
        """What it may be asked for by."""
        return self.found.device_id, str(self.found.node), self.name

    def as_json(self) -> JsonObject:
        """All fields flat, what is not known as null."""
        able: JsonObject = {
            "formats": [_flat(one) for one in self.able.formats] if self.able else [],
            "controls": [_flat(one) for one in self.able.controls] if self.able else [],
        }
        keys = ("error", "warnings", "known_as", "exposure_range_s", "profile")
        return _flat(self.found) | able | {key: json_of(getattr(self, key)) for key in keys}


@dataclass(frozen=True, kw_only=True)
class ListedOutput(Record):
    """An output of a graphics card."""

    found: FoundOutput
    output: str
    """As a profile names it."""
    master_free: bool | None = None
    error: str | None = None
    warnings: tuple[str, ...]
    mode: ShownMode | None = None
    profile: tuple[str, ...]
    """Lines to paste."""

    @property
    def name(self) -> str:
        """Its connector."""
        return self.found.connector

    def names(self) -> tuple[str | None, ...]:
        """What it may be asked for by."""
        return self.found.connector, self.output, self.found.edid_id, self.found.monitor_name

    def as_json(self) -> JsonObject:
        """All fields flat, what is not known as null."""
        keys = ("name", "output", "error", "warnings", "master_free", "profile")
        modes: JsonObject = {"modes": [_flat(one) for one in self.found.modes]}
        return _flat(self.found) | modes | {key: json_of(getattr(self, key)) for key in keys}


@dataclass(frozen=True, kw_only=True)
class ListedMonitor(Record):
    """A monitor of the desktop."""

    found: FoundMonitor
    profile: tuple[str, ...]
    """Lines to paste."""

    @property
    def name(self) -> str:
        """As a profile names it."""
        return self.found.name

    @property
    def mode(self) -> ShownMode:
        """The mode that it is in."""
        return self.found

    def names(self) -> tuple[str | None, ...]:
        """What it may be asked for by."""
        return (self.name,)

    def as_json(self) -> JsonObject:
        """All fields flat."""
        return _flat(self.found) | {"output": self.name, "profile": list(self.profile)}


@dataclass(frozen=True, kw_only=True)
class ListedController(Record):
    """A USB device that a projector of ours is controlled by."""

    name: str
    usb_id: str
    serial: str | None = None
    bus_path: str
    node: Path

    def names(self) -> tuple[str | None, ...]:
        """What it may be asked for by."""
        return self.name, str(self.node)

    def as_json(self) -> JsonObject:
        """All fields, what is not known as null."""
        return _flat(self)


@dataclass(frozen=True, kw_only=True)
class ListedBusCamera(Record):
    """A camera of GigE Vision or USB3 Vision, or a still camera."""

    driver: str
    """genicam or gphoto2."""
    device_id: str
    """As a profile names it."""
    name: str
    """Maker and model."""
    address: str
    """On the network, or of the USB port."""
    error: str | None = None
    """Why it could not be asked what it can do."""
    profile: tuple[str, ...]
    """Lines to paste."""

    def names(self) -> tuple[str | None, ...]:
        """What it may be asked for by."""
        return self.device_id, self.name, self.address


@dataclass(frozen=True, kw_only=True)
class DeviceList(Record):
    """Everything that is plugged in, and what is installed to use it with."""

    cameras: tuple[ListedCamera, ...]
    bus_cameras: tuple[ListedBusCamera, ...]
    """Of GigE Vision and USB3 Vision, and still cameras."""
    outputs: tuple[ListedOutput, ...]
    monitors: tuple[ListedMonitor, ...]
    controllers: tuple[ListedController, ...]
    plug_ins: tuple[PlugIn, ...]
    """Drivers, strategies and codes, this program's and those of other packages."""
    problems: tuple[str, ...]
    """What could not be asked, and names that two packages offer."""


def _flat(found: object) -> JsonObject:
    """The fields of a dataclass, what is not known as null."""
    return {one.name: json_of(getattr(found, one.name)) for one in fields(found)}  # type: ignore[arg-type]
