"""A graphics card: its connectors, controllers, planes and properties, changed together in one request."""

from __future__ import annotations

import ctypes
import errno
import fcntl
import os
import select
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, TypeVar

from rig.devices.kms import abi
from rig.errors import DeviceBusy, DeviceError, DeviceForbidden, DeviceLost, SettingRefused

_Structure = TypeVar("_Structure", bound=ctypes.Structure)
_GONE = (errno.ENODEV, errno.ENXIO, errno.ENOENT, errno.EBADF)
_NOT_ALLOWED = (errno.EACCES, errno.EPERM)
_EVENT_BYTES = 4096
_USUAL_PROPERTIES = 64


@dataclass(frozen=True, slots=True, kw_only=True)
class Mode:
    """A video mode that shows whole frames, one line once."""

    width_px: int
    height_px: int
    refresh_rate_hz: float
    preferred: bool
    timings: bytes
    """The kernel's `ModeInfo`."""


@dataclass(frozen=True, slots=True)
class Connector:
    """A socket, as the kernel knows it now."""

    id: int
    name: str
    modes: tuple[Mode, ...]
    controllers: tuple[int, ...]
    """Ids of the controllers that can drive it."""


@dataclass(frozen=True, slots=True)
class Property:
    """A property of a connector, controller or plane, and its value when it was asked for."""

    id: int
    value: int
    choices: dict[str, int]
    """Values by name, where they have names."""


class Change(NamedTuple):
    """One property's new value."""

    object_id: int
    property_id: int
    value: int


@dataclass(frozen=True, slots=True)
class Plane:
    """A layer, and the controllers that can mix it in."""

    id: int
    controllers: tuple[int, ...]
    formats: tuple[int, ...]
    shown_by: int
    """The controller that shows it, or 0."""


class Card:
    """An open card. Raises OSError as the kernel gives it; `named` turns that into the rig's errors."""

    def __init__(self, path: Path):
        self.path = path
        self.name = path.name
        self._names: dict[int, tuple[str, dict[str, int]]] = {}
        self._fd = -1
        try:
            self._fd = os.open(path, os.O_RDWR | os.O_CLOEXEC | os.O_NONBLOCK)
        except OSError as error:
            raise _cannot_open(path, error) from error
        self._set_capabilities()

    def close(self) -> None:
        """Let it go; any number of times."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1

    def __enter__(self) -> Card:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def fd(self) -> int:
        """The file descriptor; -1 when closed."""
        return self._fd

    def ioctl(self, request: int, structure: _Structure) -> _Structure:
        """Send a request, again when a signal cut it short; the kernel's answer stands in the structure."""
        while True:
            try:
                fcntl.ioctl(self._fd, request, structure, True)
                return structure
            except InterruptedError:
                continue

    def become_master(self) -> None:
        """Be the one program that may change what is shown. Raises DeviceBusy when another one is."""
        try:
            fcntl.ioctl(self._fd, abi.SET_MASTER)
        except OSError as error:
            raise self.held_by_another() from error

    def held_by_another(self) -> DeviceBusy:
        """The error that says who shows pictures instead of us."""
        return DeviceBusy(
            f"another program (a desktop?) holds {self.name}; end it, or change to a text console (Ctrl+Alt+F3), "
            "or use driver = 'window'"
        )

    def drop_master(self) -> None:
        """Leave what is shown to others; no-op when it already is."""
        try:
            fcntl.ioctl(self._fd, abi.DROP_MASTER)
        except OSError as error:
            if error.errno not in (errno.EINVAL, *_NOT_ALLOWED):
                raise

    def _set_capabilities(self) -> None:
        try:
            self.ioctl(abi.SET_CLIENT_CAPABILITY, abi.ClientCapability(abi.UNIVERSAL_PLANES, 1))
            self.ioctl(abi.SET_CLIENT_CAPABILITY, abi.ClientCapability(abi.ATOMIC_CLIENT, 1))
        except OSError as error:
            self.close()
            raise SettingRefused(
                f"{self.name}: its driver cannot change a whole picture at once ({error.strerror}); "
                "use driver = 'window'"
            ) from error
        try:
            self.ioctl(abi.SET_CLIENT_CAPABILITY, abi.ClientCapability(abi.CURSOR_HOTSPOT, 1))
        except OSError:
            return  # only the cards of virtual machines, on newer kernels, know it

    def controllers(self) -> tuple[int, ...]:
        """Ids, in the kernel's order."""
        return self._resources()[0]

    def connectors(self) -> tuple[Connector, ...]:
        """Every socket. The master's question makes the kernel look at what is plugged in."""
        controllers, connectors = self._resources()
        return tuple(self._connector(each, controllers) for each in connectors)

    def connector(self, name: str) -> Connector:
        """The socket of that name. Raises DeviceLost when the card has none."""
        for connector in self.connectors():
            if connector.name == name:
                return connector
        raise DeviceLost(f"{self.name} has no connector {name} any more; look with `rig devices` what there is")

    def _resources(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        counts = self.ioctl(abi.GET_RESOURCES, abi.Resources())
        controllers = (ctypes.c_uint32 * counts.controllers_count)()
        connectors = (ctypes.c_uint32 * counts.connectors_count)()
        asked = abi.Resources(
            controllers=ctypes.addressof(controllers),
            connectors=ctypes.addressof(connectors),
            controllers_count=len(controllers),
            connectors_count=len(connectors),
        )
        answer = self.ioctl(abi.GET_RESOURCES, asked)
        return tuple(controllers), tuple(connectors[: answer.connectors_count])

    def _connector(self, connector_id: int, controllers: tuple[int, ...]) -> Connector:
        asked = self.ioctl(abi.GET_CONNECTOR, abi.ConnectorInfo(id=connector_id))
        while True:
            modes = (abi.ModeInfo * max(asked.modes_count, 1))()
            encoders = (ctypes.c_uint32 * max(asked.encoders_count, 1))()
            info = abi.ConnectorInfo(
                id=connector_id,
                modes=ctypes.addressof(modes),
                modes_count=len(modes),
                encoders=ctypes.addressof(encoders),
                encoders_count=len(encoders),
            )
            self.ioctl(abi.GET_CONNECTOR, info)
            if info.modes_count <= len(modes) and info.encoders_count <= len(encoders):
                break
            asked = info
        possible = 0
        for encoder in encoders[: info.encoders_count]:
            possible |= self.ioctl(abi.GET_ENCODER, abi.EncoderInfo(id=encoder)).possible_controllers
        return Connector(
            connector_id,
            f"{_connector_type(info.type)}-{info.type_number}",
            tuple(_mode(each) for each in modes[: info.modes_count] if _is_plain(each)),
            tuple(each for index, each in enumerate(controllers) if possible >> index & 1),
        )

    def planes(self) -> tuple[Plane, ...]:
        """Every layer: primary ones, overlays and cursors."""
        counts = self.ioctl(abi.GET_PLANES, abi.PlaneResources())
        ids = (ctypes.c_uint32 * counts.planes_count)()
        self.ioctl(abi.GET_PLANES, abi.PlaneResources(ctypes.addressof(ids), len(ids)))
        controllers = self.controllers()
        return tuple(self._plane(each, controllers) for each in ids)

    def _plane(self, plane_id: int, controllers: tuple[int, ...]) -> Plane:
        count = self.ioctl(abi.GET_PLANE, abi.PlaneInfo(id=plane_id)).formats_count
        formats = (ctypes.c_uint32 * max(count, 1))()
        info = abi.PlaneInfo(id=plane_id, formats=ctypes.addressof(formats), formats_count=count)
        self.ioctl(abi.GET_PLANE, info)
        possible = tuple(each for index, each in enumerate(controllers) if info.possible_controllers >> index & 1)
        return Plane(plane_id, possible, tuple(formats[:count]), info.controller)

    def controller(self, controller_id: int) -> abi.ControllerInfo:
        """Return what a controller scans out now."""
        return self.ioctl(abi.GET_CONTROLLER, abi.ControllerInfo(id=controller_id))

    def values(self, object_id: int) -> dict[int, int]:
        """Values of an object's properties, by property id."""
        room = _USUAL_PROPERTIES
        while True:
            ids, values = (ctypes.c_uint32 * room)(), (ctypes.c_uint64 * room)()
            asked = abi.ObjectProperties(ctypes.addressof(ids), ctypes.addressof(values), room, object_id)
            count = self.ioctl(abi.GET_OBJECT_PROPERTIES, asked).properties_count
            if count <= room:
                return dict(zip(ids[:count], values[:count], strict=True))
            room = count

    def properties(self, object_id: int) -> dict[str, Property]:
        """An object's properties, by name."""
        found = {}
        for property_id, value in self.values(object_id).items():
            name, choices = self._described(property_id)
            found[name] = Property(property_id, value, choices)
        return found

    def _described(self, property_id: int) -> tuple[str, dict[str, int]]:
        if property_id not in self._names:
            count = self.ioctl(abi.GET_PROPERTY, abi.PropertyInfo(id=property_id)).choices_count
            choices = (abi.PropertyChoice * max(count, 1))()
            asked = abi.PropertyInfo(id=property_id, choices=ctypes.addressof(choices), choices_count=count)
            info = self.ioctl(abi.GET_PROPERTY, asked)
            named = {each.name.decode(): int(each.value) for each in choices[: min(count, info.choices_count)]}
            self._names[property_id] = (info.name.decode(), named)
        return self._names[property_id]

    def make_blob(self, data: bytes) -> int:
        """Bytes as a property's value; lives until the card is closed."""
        held = ctypes.create_string_buffer(data, len(data))
        return int(self.ioctl(abi.CREATE_BLOB, abi.NewBlob(ctypes.addressof(held), len(data))).id)

    def commit(self, changes: Iterable[Change], flags: int, user_data: int = 0) -> None:
        """Make changes together or not at all."""
        by_object: dict[int, list[Change]] = {}
        for change in changes:
            by_object.setdefault(change.object_id, []).append(change)
        ordered = [change for group in by_object.values() for change in group]
        objects = (ctypes.c_uint32 * len(by_object))(*by_object)
        counts = (ctypes.c_uint32 * len(by_object))(*(len(group) for group in by_object.values()))
        properties = (ctypes.c_uint32 * len(ordered))(*(change.property_id for change in ordered))
        values = (ctypes.c_uint64 * len(ordered))(*(change.value for change in ordered))
        addresses = [ctypes.addressof(each) for each in (objects, counts, properties, values)]
        self.ioctl(abi.ATOMIC, abi.AtomicRequest(flags, len(objects), *addresses, 0, user_data))

    def events(self, timeout_s: float) -> list[abi.FlipEvent]:
        """Flips that were completed; waits for one, but not longer than ``timeout_s``."""
        ready = select.poll()
        ready.register(self._fd, select.POLLIN)
        happened = ready.poll(max(timeout_s, 0.0) * 1e3)
        if not happened:
            return []
        if happened[0][1] & (select.POLLHUP | select.POLLERR | select.POLLNVAL):
            raise OSError(errno.ENODEV, "the card is gone")
        return _parse_events(os.read(self._fd, _EVENT_BYTES))

    def named(self, error: OSError, what: str) -> DeviceError:
        """One of the rig's errors for what the kernel said when it was asked to do ``what``."""
        if error.errno in _GONE:
            return DeviceLost(f"{self.name} is gone ({error.strerror}) while {what}; check the graphics card")
        if error.errno in _NOT_ALLOWED:
            return self.held_by_another()
        if error.errno == errno.EBUSY:
            return DeviceBusy(f"{self.name} is busy with an earlier request while {what}; try again")
        return SettingRefused(f"{self.name} refuses {what}: {error.strerror}; try another mode or connector")


def _parse_events(data: bytes) -> list[abi.FlipEvent]:
    flips, start = [], 0
    while start + ctypes.sizeof(abi.FlipEvent) <= len(data):
        event = abi.FlipEvent.from_buffer_copy(data, start)
        if event.type == abi.FLIP_COMPLETE:
            flips.append(event)
        start += max(event.length, 8)
    return flips


def _cannot_open(path: Path, error: OSError) -> DeviceError:
    if error.errno in _NOT_ALLOWED:
        return DeviceForbidden(
            f"you may not open {path}; add yourself to the group 'video' (sudo usermod -aG video $USER), "
            "then log in again"
        )
    return DeviceLost(f"{path} cannot be opened: {error.strerror}; check the graphics card and its driver")


def _connector_type(number: int) -> str:
    return abi.CONNECTOR_TYPES[number] if number < len(abi.CONNECTOR_TYPES) else f"Unknown{number}"


def _is_plain(mode: abi.ModeInfo) -> bool:
    return not mode.flags & (abi.INTERLACED | abi.DOUBLE_SCAN) and mode.htotal > 0 and mode.vtotal > 0


def _mode(mode: abi.ModeInfo) -> Mode:
    refresh_rate_hz = mode.clock_khz * 1e3 / (mode.htotal * mode.vtotal * max(mode.vscan, 1))
    return Mode(
        width_px=mode.width,
        height_px=mode.height,
        refresh_rate_hz=refresh_rate_hz,
        preferred=bool(mode.type & abi.PREFERRED),
        timings=bytes(mode),
    )
