"""Which monitors the desktop has."""

from __future__ import annotations

from rig.devices.window.link import ScreenLink
from rig.devices.window.monitor import FoundMonitor

__all__ = ["FoundMonitor", "find_monitors"]


def find_monitors() -> list[FoundMonitor]:
    """Every monitor that is switched on, in the desktop's order.

    Raises DeviceError when there is no desktop, or the packages of the extra ``window`` are not installed.
    """
    link = ScreenLink()
    link.close()
    return link.monitors
