"""Writes the profile of a real rig from what is plugged in and what is publicly known of it: verb `profile new`."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from rig.errors import DeviceError, DeviceLost, SettingRefused, UsageError
from rig.files.atomic import write_bytes
from rig.inventory.choose import CameraMode, best_camera_mode, best_output_mode
from rig.inventory.list import THIS_MACHINE, Finders, facts_of
from rig.inventory.profile_text import PlannedBusCamera, PlannedCamera, PlannedDisplay, PlannedStill, profile_text
from rig.profile.apply import guessed_keys
from rig.profile.hardware_facts import (
    CameraFacts,
    CameraFile,
    ProjectorFacts,
    by_model,
    known_cameras,
    known_projectors,
)
from rig.profile.schema import Profile
from rig.records import Record

if TYPE_CHECKING:
    from rig.devices.kms.find import FoundOutput
    from rig.devices.v4l2.describe import CameraAbilities
    from rig.devices.v4l2.find import FoundCamera
    from rig.devices.window.find import FoundMonitor

Device = TypeVar("Device")


@dataclass(frozen=True, slots=True, kw_only=True)
class ProfileRequest:
    """What was asked for; None is decided by what is plugged in."""

    path: Path
    camera: str | None = None
    """Device id."""
    output: str | None = None
    """Connector, ``edid:…``, or a monitor's name."""
    camera_model: str | None = None
    projector_model: str | None = None
    name: str | None = None
    force: bool = False


@dataclass(frozen=True, kw_only=True)
class NewProfile(Record):
    """What was written."""

    path: Path
    name: str
    camera: str
    """Its device id."""
    output: str
    driver: str
    """The projector's."""
    facts: tuple[str, ...]
    """Models of which cited facts are in it."""
    to_measure: tuple[str, ...]
    """Keys that are only guessed."""


def write_profile(request: ProfileRequest, finders: Finders = THIS_MACHINE) -> NewProfile:
    """Write a complete profile; what could not be found out is a guess and is named in the result.

    Raises
    ------
    UsageError
        The file is there already, or several devices could be meant; the message lists them.
    DeviceError
        There is no camera or no display, or it cannot be asked.
    """
    if request.path.exists() and not request.force:
        raise UsageError(f"{request.path} is there already; give another name, or --force to replace it")
    camera = (
        _planned_bus_camera(request, finders) or _planned_still(request, finders) or _planned_camera(request, finders)
    )
    display = _planned_display(request, finders)
    text = profile_text(request.name or _name_of(request.path), camera, display)
    profile = Profile.parse(text.encode(), request.path)
    write_bytes(request.path, profile.raw)
    return NewProfile(
        path=request.path,
        name=profile.name,
        camera=camera.device_id,
        output=display.output,
        driver=display.driver,
        facts=tuple(one for one in (camera.facts_of, display.facts_of) if one),
        to_measure=guessed_keys(text),
    )


def _name_of(path: Path) -> str:
    return re.sub(r"[^A-Za-z0-9._-]+", "-", path.stem).lstrip("._-") or "rig"


def _planned_bus_camera(request: ProfileRequest, finders: Finders) -> PlannedBusCamera | None:
    """The GigE or USB3 camera that is meant: by its id or address, or because there is no other camera."""
    wanted = request.camera
    if wanted is None and finders.cameras():
        return None
    there = [one for one in finders.genicam() if wanted in (None, one.device_id, one.address, one.serial)]
    if not there:
        return None
    found = _only("camera", there, wanted, lambda one: (one.device_id, one.address, one.serial))
    able = finders.describe_genicam(found)
    if not able.pixel_formats:
        raise SettingRefused(f"{found.device_id}: none of its pixel formats can be used; take another camera")
    file = by_model(request.camera_model, known_cameras()) if request.camera_model else None
    return PlannedBusCamera(
        found=found,
        able=able,
        facts=file.facts if file else CameraFacts(),
        facts_of=f"{file.maker} {file.model}" if file else "",
    )


def _planned_still(request: ProfileRequest, finders: Finders) -> PlannedStill | None:
    """The still camera that is meant: by its port or model, or because there is no other camera."""
    wanted = request.camera
    if wanted is None and finders.cameras():
        return None
    there = [one for one in finders.stills() if wanted in (None, one.port, one.model)]
    if not there:
        return None
    found = _only("camera", there, wanted, lambda one: (one.port, one.model))
    file = by_model(request.camera_model, known_cameras()) if request.camera_model else _facts_of_still(found.model)
    return PlannedStill(
        found=found,
        able=finders.describe_still(found),
        facts=file.facts if file else CameraFacts(),
        facts_of=f"{file.maker} {file.model}" if file else "",
    )


def _facts_of_still(model: str) -> CameraFile | None:
    """What is publicly known of a model, by its name: all words of the facts' name are in it."""
    words = set(model.lower().split())
    return next((one for one in known_cameras() if words >= set(f"{one.maker} {one.model}".lower().split())), None)


def _planned_camera(request: ProfileRequest, finders: Finders) -> PlannedCamera:
    found = _chosen_camera(finders.cameras(), request.camera)
    able = finders.describe(found.node)
    file = by_model(request.camera_model, known_cameras()) if request.camera_model else facts_of(found)
    return PlannedCamera(
        found=found,
        mode=_mode_of(found, able, file.facts if file else None),
        controls=tuple(able.controls),
        facts=file.facts if file else CameraFacts(),
        facts_of=f"{file.maker} {file.model}" if file else "",
    )


def _chosen_camera(cameras: Sequence[FoundCamera], wanted: str | None) -> FoundCamera:
    if not cameras:
        raise DeviceLost("there is no camera; plug one in, and look with `rig devices`")
    return _only("camera", cameras, wanted, lambda one: (one.device_id, str(one.node), one.name))


def _only(what: str, there: Sequence[Device], wanted: str | None, names: Callable[[Device], tuple[str, ...]]) -> Device:
    """The one that is meant: by any of its names, or because it is the only one."""
    meant = [one for one in there if wanted is None or wanted in names(one)]
    if len(meant) == 1:
        return meant[0]
    listed = "; ".join(" = ".join(dict.fromkeys(names(one))) for one in there)
    if wanted is None:
        raise UsageError(f"{len(there)} of them could be the {what}; choose with --{what}: {listed}")
    what_is = f"names {len(meant)} of them" if meant else "is none of them"
    raise UsageError(f"--{what} {wanted} {what_is}; there are: {listed}")


def _mode_of(found: FoundCamera, able: CameraAbilities, facts: CameraFacts | None) -> CameraMode:
    mode = best_camera_mode(able.formats, facts)
    if mode is None:
        formats = ", ".join(sorted({one.pixel_format for one in able.formats})) or "none"
        raise SettingRefused(
            f"{found.device_id}: none of its pixel formats can be used ({formats}); take another camera"
        )
    return mode


def _planned_display(request: ProfileRequest, finders: Finders) -> PlannedDisplay:
    """A monitor where there is a desktop, else an output of a graphics card."""
    file = by_model(request.projector_model, known_projectors()) if request.projector_model else None
    facts = file.facts if file else ProjectorFacts()
    known = f"{file.maker} {file.model}" if file else ""
    monitors = _monitors(finders)
    if monitors:
        one = _only("output", monitors, request.output, lambda monitor: (monitor.name, f"monitor:{monitor.index}"))
        return PlannedDisplay(driver="window", output=one.name, mode=one, facts=facts, facts_of=known)
    from rig.devices.kms.find import paste_name

    outputs = [output for output in finders.outputs() if output.status == "connected"]
    if not outputs:
        raise DeviceLost("no display output is connected; switch the projector on, and look with `rig devices`")
    output = _only("output", outputs, request.output, _names_of)
    mode = best_output_mode(output.modes, facts)
    if mode is None:
        raise DeviceLost(f"{output.connector} offers no mode; switch the projector on, or use another cable")
    return PlannedDisplay(driver="kms", output=paste_name(output, outputs), mode=mode, facts=facts, facts_of=known)


def _monitors(finders: Finders) -> Sequence[FoundMonitor]:
    """The desktop's monitors; none where the desktop does not answer and a graphics card is free for us."""
    try:
        return finders.monitors()
    except DeviceError:
        if any(one.status == "connected" and finders.master_is_free(one.card) for one in finders.outputs()):
            return ()
        raise


def _names_of(output: FoundOutput) -> tuple[str, ...]:
    edid = (f"edid:{output.edid_id}",) if output.edid_id else ()
    return (output.connector, output.full_name, *edid)
