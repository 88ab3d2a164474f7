"""What is plugged in: cameras, display outputs, monitors of the desktop, USB controllers. Verb `devices`."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rig.errors import DeviceForbidden, RigError, UsageError
from rig.files.toml import toml_value
from rig.inventory.choose import best_camera_mode, best_output_mode, exposure_range_s
from rig.profile.hardware_facts import CameraFile, known_cameras, known_projectors

if TYPE_CHECKING:
    from rig.devices.kms.find import FoundOutput
    from rig.devices.usb.find import FoundUsbDevice
    from rig.devices.v4l2.describe import CameraAbilities
    from rig.devices.v4l2.find import FoundCamera
    from rig.devices.window.find import FoundMonitor


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


@dataclass(frozen=True, slots=True)
class Finders:
    """Where devices are looked for; the defaults ask this machine."""

    cameras: Callable[[], Sequence[FoundCamera]] = _cameras
    describe: Callable[[Path], CameraAbilities] = _describe
    outputs: Callable[[], Sequence[FoundOutput]] = _outputs
    master_is_free: Callable[[Path], bool | None] = _master_is_free
    monitors: Callable[[], Sequence[FoundMonitor]] = _monitors
    usb_devices: Callable[[], Sequence[FoundUsbDevice]] = _usb_devices


THIS_MACHINE = Finders()


def list_devices(name: str | None = None, finders: Finders = THIS_MACHINE) -> dict[str, Any]:
    """Everything that is plugged in, as plain data; what cannot be asked has an ``error``, and hides nothing else.

    ``name`` keeps only the devices that it names (device id, node, connector, part of a name). Raises UsageError when
    it names none.
    """
    problems: list[str] = []
    usb = _asked("USB", finders.usb_devices, problems)
    outputs = _asked("display outputs", finders.outputs, problems)
    found: dict[str, Any] = {
        "cameras": [_camera(one, usb, finders) for one in _asked("cameras", finders.cameras, problems)],
        "outputs": [_output(one, outputs, finders) for one in outputs],
        "monitors": [_monitor(one) for one in _asked("monitors of the desktop", finders.monitors, problems)],
        "controllers": _controllers(usb),
        "problems": problems,
    }
    return found if name is None else _named(found, name)


def _asked(what: str, ask: Callable[[], Sequence[Any]], problems: list[str]) -> Sequence[Any]:
    try:
        return ask()
    except (RigError, OSError) as error:
        problems.append(f"{what}: {error}")
        return ()


def _named(found: dict[str, Any], name: str) -> dict[str, Any]:
    kept = {kind: [one for one in found[kind] if _is_meant(one, name)] for kind in found if kind != "problems"}
    if not any(kept.values()):
        there = [one["name"] for kind in kept for one in found[kind]]
        raise UsageError(f"no device is called {name!r}; there are: {', '.join(there) or 'none'}")
    return {**kept, "problems": found["problems"]}


def _is_meant(one: dict[str, Any], name: str) -> bool:
    keys = ("device_id", "node", "connector", "output", "edid_id", "monitor_name", "name")
    return any(name.lower() in str(one[key]).lower() for key in keys if one.get(key))


def _camera(found: FoundCamera, usb: Sequence[FoundUsbDevice], finders: Finders) -> dict[str, Any]:
    """A camera with what it can do, or with the error that asking it gave."""
    one: dict[str, Any] = {**_plain(found), "error": None, "warnings": _usb_warnings(found, usb), "known_as": None}
    facts = facts_of(found)
    if facts is not None:
        one["known_as"] = f"{facts.maker} {facts.model}"
    try:
        able = finders.describe(found.node)
    except (RigError, OSError) as error:
        said = _advice(error, found)
        return {**one, "error": said, "formats": [], "controls": [], "exposure_range_s": None, "profile": []}
    range_s = exposure_range_s(able.controls)
    one |= {
        "formats": [_plain(each) for each in able.formats],
        "controls": [_plain(each) for each in able.controls],
        "exposure_range_s": None if range_s is None else list(range_s),
        "profile": _camera_lines(found, able, facts),
    }
    if range_s is None:
        one["warnings"].append("has no control of its exposure time")
    if not one["profile"]:
        one["warnings"].append("has no pixel format that a rig can use")
    return one


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


def _camera_lines(found: FoundCamera, able: CameraAbilities, facts: CameraFile | None) -> list[str]:
    mode = best_camera_mode(able.formats, facts.facts if facts else None)
    if mode is None:
        return []
    keys: dict[str, Any] = {
        "driver": "v4l2",
        "device_id": found.device_id,
        "pixel_format": mode.pixel_format,
        "width_px": mode.width_px,
        "height_px": mode.height_px,
        "bit_depth": mode.bit_depth,
        "frame_rate_hz": mode.frame_rate_hz,
        "exposure_range_s": exposure_range_s(able.controls),
    }
    return _toml_lines("camera", keys)


def _toml_lines(table: str, keys: dict[str, Any]) -> list[str]:
    known = (f"{key} = {toml_value(value)}" for key, value in keys.items() if value is not None)
    return [f"[[{table}]]", f"name = {toml_value(table)}", *known]


def _output(found: FoundOutput, outputs: Sequence[FoundOutput], finders: Finders) -> dict[str, Any]:
    from rig.devices.kms.find import paste_name

    output = paste_name(found, list(outputs))
    one: dict[str, Any] = {**_plain(found), "name": found.connector, "output": output, "error": None, "warnings": []}
    try:
        one["master_free"] = finders.master_is_free(found.card)
    except (RigError, OSError) as error:
        one |= {"master_free": None, "error": str(error)}
    if one["master_free"] is False and found.status == "connected":
        one["warnings"].append('a desktop or another program drives this card: use driver = "window", or stop it')
    mode = best_output_mode(found.modes) if found.status == "connected" else None
    one["profile"] = _display_lines("kms", output, mode)
    return one


def _monitor(found: FoundMonitor) -> dict[str, Any]:
    return {**_plain(found), "output": found.name, "profile": _display_lines("window", found.name, found)}


def _display_lines(driver: str, output: str, mode: Any) -> list[str]:
    if mode is None:
        return []
    keys = {
        "driver": driver,
        "output": output,
        "width_px": mode.width_px,
        "height_px": mode.height_px,
        "refresh_rate_hz": mode.refresh_rate_hz or None,
    }
    return _toml_lines("projector", keys)


def _controllers(usb: Sequence[FoundUsbDevice]) -> list[dict[str, Any]]:
    """USB devices that a projector of ours is controlled by."""
    models = {usb_id: file for file in known_projectors() if file.facts.usb_ids for usb_id in file.facts.usb_ids.value}
    return [
        {
            "name": f"{models[usb_id].maker} {models[usb_id].model}",
            "usb_id": usb_id,
            "serial": one.serial,
            "bus_path": one.bus_path,
            "node": str(one.node),
        }
        for one in usb
        if (usb_id := usb_id_of(one.vendor_id, one.product_id)) in models and usb_id is not None
    ]


def _plain(found: Any) -> dict[str, Any]:
    """A dataclass as JSON can hold it."""
    return {key: _plain_value(value) for key, value in asdict(found).items()}


def _plain_value(value: Any) -> Any:
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, dict):
        return {str(key): _plain_value(one) for key, one in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [_plain_value(one) for one in value]
    return value
