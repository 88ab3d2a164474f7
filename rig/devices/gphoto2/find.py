"""Still cameras that are plugged in."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass
from importlib.util import find_spec
from typing import NamedTuple

from rig.devices.gphoto2.camera import SHUTTER_SPEED, raw_entries, seconds
from rig.devices.gphoto2.port import StillPort, library, named
from rig.devices.protocols import ExposureRange


class FoundStill(NamedTuple):
    """A camera that gphoto2 knows."""

    model: str
    port: str
    """``usb:001,004``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StillAbilities:
    """What a rig wants to know of a camera, as far as it says so without a picture."""

    serial: str | None
    """None of a camera that does not tell."""
    has_raw: bool
    exposure_range_s: ExposureRange | None
    """Of its steps; None where its dial lets none be chosen."""


def list_stills() -> list[FoundStill]:
    """List what is plugged in; nothing where gphoto2 is not installed. Raises DeviceError."""
    if find_spec("gphoto2") is None:
        return []
    gphoto2 = library()
    with named("still cameras", "looking for them"):
        found = gphoto2.Camera.autodetect()
        return [FoundStill(found.get_name(k), found.get_value(k)) for k in range(found.count())]


def describe_still(found: FoundStill) -> StillAbilities:
    """Ask a camera what it can do, and let it go; no picture is taken. Raises DeviceLost, DeviceBusy, DeviceError."""
    with closing(StillPort(found.port, f"camera {found.model}")) as port:
        known = [one for text in port.choices(SHUTTER_SPEED) if (one := seconds(text)) is not None]
        return StillAbilities(
            serial=port.value("serialnumber") or None,
            has_raw=bool(raw_entries(port)),
            exposure_range_s=ExposureRange(min(known), max(known)) if known else None,
        )
