"""What is plugged in: cameras, display outputs, monitors of the desktop, USB controllers. Verb `devices`."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from rig.devices.drivers import brought_along
from rig.devices.protocols import ExposureRange
from rig.devices.v4l2.controls import exposure_range_of
from rig.errors import DeviceForbidden, RigError, UsageError
from rig.files.toml import toml_value
from rig.inventory.choose import CameraMode, best_camera_mode, best_output_mode
from rig.inventory.found import (
    DeviceList,
    ListedBusCamera,
    ListedCamera,
    ListedController,
    ListedDevice,
    ListedMonitor,
    ListedOutput,
    ShownMode,
)
from rig.plug_ins import GROUPS, PlugIn, clashes, others, own_codes, own_strategies
from rig.profile.hardware_facts import CameraFile, known_cameras, known_projectors

if TYPE_CHECKING:
    from rig.devices.genicam.describe import GenicamAbilities
    from rig.devices.genicam.find import FoundGenicam
    from rig.devices.gphoto2.find import FoundStill, StillAbilities
    from rig.devices.kms.find import FoundOutput
    from rig.devices.usb.find import FoundUsbDevice
    from rig.devices.v4l2.describe import CameraAbilities
    from rig.devices.v4l2.find import FoundCamera
    from rig.devices.window.find import FoundMonitor


def installed() -> tuple[PlugIn, ...]:
    """Return the drivers, strategies and codes that there are: this program's, then those of other packages."""
    brought = {
        "camera driver": brought_along("camera driver"),
        "projector driver": brought_along("projector driver"),
        "strategy": own_strategies(),
        "code": own_codes(),
    }
    return tuple(one for kind in GROUPS for one in (*brought[kind], *others(kind)))


def _cameras() -> Sequence[FoundCamera]:
    from rig.devices.v4l2.find import find_cameras

    return find_cameras()


def _describe(node: Path) -> CameraAbilities:
    from rig.devices.v4l2.describe import describe

    return describe(node)


def _outputs() -> Sequence[FoundOutput]:
    from rig.devices.kms.find import find_outputs

    return find_outputs()


def _master_is_free(card: Path) -> bool | None:
    from rig.devices.kms.master import master_is_free

    return master_is_free(card)


def _monitors() -> Sequence[FoundMonitor]:
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        return ()
    from rig.devices.window.find import find_monitors

    return find_monitors()


def _usb_devices() -> Sequence[FoundUsbDevice]:
    from rig.devices.usb.find import find_usb_devices

    return find_usb_devices()


def _genicam() -> Sequence[FoundGenicam]:
    from rig.devices.genicam.aravis import is_installed
    from rig.devices.genicam.find import list_genicam

    return list_genicam() if is_installed() else ()


def _describe_genicam(found: FoundGenicam) -> GenicamAbilities:
    from rig.devices.genicam.describe import describe_genicam

    return describe_genicam(found)


def _stills() -> Sequence[FoundStill]:
    from rig.devices.gphoto2.find import list_stills

    return list_stills()


def _describe_still(found: FoundStill) -> StillAbilities:
    from rig.devices.gphoto2.find import describe_still

    return describe_still(found)


@dataclass(frozen=True, slots=True, kw_only=True)
class Finders:
    """Where devices are looked for; the defaults ask this machine."""

    cameras: Callable[[], Sequence[FoundCamera]] = _cameras
    describe: Callable[[Path], CameraAbilities] = _describe
    genicam: Callable[[], Sequence[FoundGenicam]] = _genicam
    describe_genicam: Callable[[FoundGenicam], GenicamAbilities] = _describe_genicam
    stills: Callable[[], Sequence[FoundStill]] = _stills
    describe_still: Callable[[FoundStill], StillAbilities] = _describe_still
    outputs: Callable[[], Sequence[FoundOutput]] = _outputs
    master_is_free: Callable[[Path], bool | None] = _master_is_free
    monitors: Callable[[], Sequence[FoundMonitor]] = _monitors
    usb_devices: Callable[[], Sequence[FoundUsbDevice]] = _usb_devices
    plug_ins: Callable[[], Sequence[PlugIn]] = installed


THIS_MACHINE = Finders()
Found = TypeVar("Found")
Listed = TypeVar("Listed", bound=ListedDevice)


def list_devices(name: str | None = None, finders: Finders = THIS_MACHINE) -> DeviceList:
    """List everything that is plugged in; what cannot be asked has an ``error``, and hides nothing else.

    Parameters
    ----------
    name
        Keeps only the devices that it names: device id, node, connector, part of a name.
    finders
        Where devices are looked for; default: this machine.

    Returns
    -------
    DeviceList

    Raises
    ------
    UsageError
        The name fits none.
    """
    problems: list[str] = []
    usb = _asked("USB", finders.usb_devices, problems)
    outputs = _asked("display outputs", finders.outputs, problems)
    plug_ins = tuple(finders.plug_ins())
    found = DeviceList(
        cameras=tuple(_camera(one, usb, finders) for one in _asked("cameras", finders.cameras, problems)),
        bus_cameras=_bus_cameras(finders, problems),
        outputs=tuple(_output(one, outputs, finders) for one in outputs),
        monitors=tuple(_monitor(one) for one in _asked("monitors of the desktop", finders.monitors, problems)),
        controllers=_controllers(usb),
        plug_ins=plug_ins,
        problems=(*problems, *clashes(plug_ins)),
    )
    return found if name is None else _named(found, name)


def _asked(what: str, ask: Callable[[], Sequence[Found]], problems: list[str]) -> Sequence[Found]:
    try:
        return ask()
    except (RigError, OSError) as error:
        problems.append(f"{what}: {error}")
        return ()


def _named(found: DeviceList, name: str) -> DeviceList:
    kept = replace(
        found,
        cameras=_meant(found.cameras, name),
        bus_cameras=_meant(found.bus_cameras, name),
        outputs=_meant(found.outputs, name),
        monitors=_meant(found.monitors, name),
        controllers=_meant(found.controllers, name),
        plug_ins=(),
    )
    all_kinds = [(one.cameras, one.bus_cameras, one.outputs, one.monitors, one.controllers) for one in (kept, found)]
    if not any(all_kinds[0]):
        kinds: tuple[Sequence[ListedDevice], ...] = all_kinds[1]
        there = [one.name for kind in kinds for one in kind]
        raise UsageError(f"no device is called {name!r}; there are: {', '.join(there) or 'none'}")
    return kept


def _meant(devices: tuple[Listed, ...], name: str) -> tuple[Listed, ...]:
    return tuple(one for one in devices if any(word and name.lower() in word.lower() for word in one.names()))


def _camera(found: FoundCamera, usb: Sequence[FoundUsbDevice], finders: Finders) -> ListedCamera:
    facts = facts_of(found)
    able, error = None, None
    try:
        able = finders.describe(found.node)
    except (RigError, OSError) as problem:
        error = _advice(problem, found)
    range_s = exposure_range_of(able.controls) if able else None
    mode = best_camera_mode(able.formats, facts.facts if facts else None) if able else None
    warnings = _usb_warnings(found, usb)
    if able and range_s is None:
        warnings.append("has no control of its exposure time")
    if able and mode is None:
        warnings.append("has no pixel format that a rig can use")
    return ListedCamera(
        found=found,
        able=able,
        error=error,
        warnings=tuple(warnings),
        known_as=f"{facts.maker} {facts.model}" if facts else None,
        exposure_range_s=range_s,
        mode=mode,
        profile=_camera_lines(found, mode, range_s) if mode else (),
    )


def _advice(error: Exception, found: FoundCamera) -> str:
    """What went wrong; with a udev rule where permission is missing."""
    from rig.devices.usb.permissions import forbidden

    if isinstance(error, DeviceForbidden):
        return str(forbidden(found.node, found.vendor_id, found.product_id))
    return str(error)


def facts_of(found: FoundCamera) -> CameraFile | None:
    """What is publicly known of this camera's model, told by its USB ids and name."""
    usb_id = usb_id_of(found.vendor_id, found.product_id)
    return next((file for file in known_cameras() if file.fits(usb_id, found.name)), None)


def usb_id_of(vendor_id: int | None, product_id: int | None) -> str | None:
    """``vvvv:pppp`` of USB ids; None for a device that is not on USB."""
    return None if vendor_id is None or product_id is None else f"{vendor_id:04x}:{product_id:04x}"


def _usb_warnings(found: FoundCamera, usb: Sequence[FoundUsbDevice]) -> list[str]:
    ids = (found.vendor_id, found.product_id, found.serial)
    warnings = (one.warning for one in usb if (one.vendor_id, one.product_id, one.serial) == ids)
    return sorted({warning for warning in warnings if warning})


def _camera_lines(found: FoundCamera, mode: CameraMode, range_s: ExposureRange | None) -> tuple[str, ...]:
    keys: dict[str, object] = {
        "driver": "v4l2",
        "device_id": found.device_id,
        "pixel_format": mode.pixel_format,
        "width_px": mode.width_px,
        "height_px": mode.height_px,
        "bit_depth": mode.bit_depth,
        "frame_rate_hz": mode.frame_rate_hz,
        "exposure_range_s": range_s,
    }
    return _toml_lines("camera", keys)


def _toml_lines(table: str, keys: Mapping[str, object]) -> tuple[str, ...]:
    known = (f"{key} = {toml_value(value)}" for key, value in keys.items() if value is not None)
    return (f"[[{table}]]", f"name = {toml_value(table)}", *known)


def _bus_cameras(finders: Finders, problems: list[str]) -> tuple[ListedBusCamera, ...]:
    genicam = _asked("GigE and USB3 cameras", finders.genicam, problems)
    stills = _asked("still cameras", finders.stills, problems)
    return (
        *(_genicam_camera(one, finders) for one in genicam),
        *(_still(one) for one in stills),
    )


def _genicam_camera(found: FoundGenicam, finders: Finders) -> ListedBusCamera:
    """With what the camera says of itself; the first pixel format that is understood is the best one."""
    from rig.devices.genicam.formats import PIXEL_FORMATS

    able, error = None, None
    try:
        able = finders.describe_genicam(found)
    except (RigError, OSError) as problem:
        error = str(problem)
    keys: dict[str, object] = {"driver": "genicam", "device_id": found.device_id}
    if able is not None:
        best = next((PIXEL_FORMATS[name] for name in able.pixel_formats), None)
        keys |= {
            "pixel_format": best and best.name,
            "width_px": able.width_px,
            "height_px": able.height_px,
            "channels": best and (3 if best.mosaic else best.numbers),
            "mosaic": best and best.mosaic,
            "bit_depth": best and best.depth,
            "frame_rate_hz": able.frame_rate_hz,
            "exposure_range_s": able.exposure_range_s,
        }
    return ListedBusCamera(
        driver="genicam",
        device_id=found.device_id,
        name=f"{found.vendor} {found.model}",
        address=found.address,
        error=error,
        profile=_toml_lines("camera", keys),
    )


def _still(found: FoundStill) -> ListedBusCamera:
    lines = _toml_lines("camera", {"driver": "gphoto2", "device_id": found.port})
    return ListedBusCamera(driver="gphoto2", device_id=found.port, name=found.model, address=found.port, profile=lines)


def _output(found: FoundOutput, outputs: Sequence[FoundOutput], finders: Finders) -> ListedOutput:
    from rig.devices.kms.find import paste_name

    output = paste_name(found, list(outputs))
    free, error = None, None
    try:
        free = finders.master_is_free(found.card)
    except (RigError, OSError) as problem:
        error = str(problem)
    is_connected = found.status == "connected"
    held = 'a desktop or another program drives this card: use driver = "window", or stop it'
    mode = best_output_mode(found.modes) if is_connected else None
    return ListedOutput(
        found=found,
        output=output,
        master_free=free,
        error=error,
        warnings=(held,) if free is False and is_connected else (),
        mode=mode,
        profile=_display_lines("kms", output, mode) if mode else (),
    )


def _monitor(found: FoundMonitor) -> ListedMonitor:
    return ListedMonitor(found=found, profile=_display_lines("window", found.name, found))


def _display_lines(driver: str, output: str, mode: ShownMode) -> tuple[str, ...]:
    keys: dict[str, object] = {
        "driver": driver,
        "output": output,
        "width_px": mode.width_px,
        "height_px": mode.height_px,
        "refresh_rate_hz": mode.refresh_rate_hz or None,
    }
    return _toml_lines("projector", keys)


def _controllers(usb: Sequence[FoundUsbDevice]) -> tuple[ListedController, ...]:
    models = {usb_id: file for file in known_projectors() if file.facts.usb_ids for usb_id in file.facts.usb_ids.value}
    return tuple(
        ListedController(
            name=f"{models[usb_id].maker} {models[usb_id].model}",
            usb_id=usb_id,
            serial=one.serial,
            bus_path=one.bus_path,
            node=one.node,
        )
        for one in usb
        if (usb_id := usb_id_of(one.vendor_id, one.product_id)) in models and usb_id is not None
    )
