"""A monitor of a desktop, and how a profile names one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rig.errors import DeviceLost, SettingRefused


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundMonitor:
    """A monitor that is switched on, in its present mode."""

    name: str
    """X11: the output's (``HDMI-1``). Wayland: the connector's (``HDMI-A-1``), of old compositors maker and model."""
    index: int
    """Its place in the desktop's list, for ``output = "monitor:INDEX"``."""
    x_px: int
    """Place of its left edge on the desktop."""
    y_px: int
    """Place of its upper edge on the desktop."""
    width_px: int
    height_px: int
    refresh_rate_hz: float
    """Rounded by the desktop; 0 when that does not know."""


def choose_monitor(monitors: Sequence[FoundMonitor], output: str) -> FoundMonitor:
    """The monitor that a profile names: ``monitor:INDEX``, or its name.

    Raises DeviceLost, with the known ones, when it is not there; SettingRefused when two have the name.
    """
    fitting = [monitor for monitor in monitors if output in (monitor.name, f"monitor:{monitor.index}")]
    if not fitting:
        raise DeviceLost(
            f"no monitor {output!r} on this desktop; it has {_listed(monitors)}. "
            "Correct projector.output, or switch the monitor on"
        )
    if len(fitting) > 1:
        raise SettingRefused(f"{len(fitting)} monitors are named {output!r}; choose one of {_listed(fitting)}")
    return fitting[0]


def check_mode(monitor: FoundMonitor, shape: tuple[int, int], refresh_rate_hz: float) -> None:
    """Refuse a monitor whose mode is not the profile's: (height, width) in pixels, and refreshes a second."""
    mode = (monitor.height_px, monitor.width_px)
    if mode != shape:
        raise SettingRefused(
            f"monitor {monitor.name!r} is at {mode[1]} x {mode[0]} px, the profile says {shape[1]} x {shape[0]} px; "
            "set the projector's own mode in the desktop's display settings, or correct the profile"
        )
    if monitor.refresh_rate_hz and abs(monitor.refresh_rate_hz - refresh_rate_hz) > 1:
        raise SettingRefused(
            f"monitor {monitor.name!r} is refreshed at {monitor.refresh_rate_hz:g} Hz, the profile says "
            f"{refresh_rate_hz:g} Hz; set it in the desktop's display settings, or correct the profile"
        )


def _listed(monitors: Sequence[FoundMonitor]) -> str:
    known = [
        f"{monitor.name!r} (monitor:{monitor.index}, {monitor.width_px} x {monitor.height_px} px at "
        f"{monitor.x_px}, {monitor.y_px})"
        for monitor in monitors
    ]
    return ", ".join(known) or "none"
