"""Still cameras that are plugged in."""

from __future__ import annotations

from importlib.util import find_spec
from typing import NamedTuple

from rig.devices.gphoto2.port import library, named


class FoundStill(NamedTuple):
    """A camera that gphoto2 knows."""

    model: str
    port: str
    """``usb:001,004``."""


def list_stills() -> list[FoundStill]:
    """List what is plugged in; nothing where gphoto2 is not installed. Raises DeviceError."""
    if find_spec("gphoto2") is None:
        return []
    gphoto2 = library()
    with named("still cameras", "looking for them"):
        found = gphoto2.Camera.autodetect()
        return [FoundStill(found.get_name(k), found.get_value(k)) for k in range(found.count())]
