"""Which of the things that a device can do a rig wants: pixel format, size, rate, exposure, display mode."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rig.devices.v4l2.formats import PIXEL_FORMATS
from rig.profile.hardware_facts import CameraFacts, ProjectorFacts

if TYPE_CHECKING:
    from rig.devices.kms.find import OutputMode
    from rig.devices.v4l2.describe import ControlAbility, FormatAbility

PREFERRED_FORMATS = (
    *("Y16", "Y14", "Y12", "Y12P", "Y10", "Y10P", "Y10B", "GREY"),
    *("YUYV", "UYVY", "YVYU", "VYUY", "NV12"),
    *("RG16", "GB16", "GR16", "BYR2", "RG12", "GB12", "BA12", "BG12"),
    *("RG10", "GB10", "BA10", "BG10", "RGGB", "GRBG", "GBRG", "BA81"),
    *("MJPG", "JPEG"),
)
"""Pixel formats that a rig can use, best first: raw grey, brightness beside colour, mosaic, compressed."""
LEAST_RATE_HZ = 5.0
"""A larger picture is not worth waiting longer than this for."""
MOST_RATE_HZ = 60.0
"""More frames a second than a projector shows are thrown away."""
AT_MINIMUM = frozenset({"gain", "sharpness", "backlight_compensation", "power_line_frequency"})
"""Controls that add noise or process pictures: least of them."""
AT_DEFAULT = frozenset({"brightness", "contrast", "saturation", "hue", "zoom_absolute"})
LINEAR_GAMMA = 100
"""UVC counts gamma in hundredths."""
AS_THEY_ARE = frozenset({"focus_absolute", "white_balance_temperature"})
"""Controls whose right value depends on the scene."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraMode:
    """A way to run a camera."""

    pixel_format: str
    bit_depth: int
    width_px: int
    height_px: int
    frame_rate_hz: float | None
    """None when the driver names no rate."""


def best_camera_mode(formats: Iterable[FormatAbility], facts: CameraFacts | None = None) -> CameraMode | None:
    """The best format first, then the largest size that comes at a usable rate; None when none can be used."""
    modes = [_camera_mode(one, facts) for one in formats if one.pixel_format.strip() in PREFERRED_FORMATS]
    return max(
        modes,
        key=lambda mode: (
            -PREFERRED_FORMATS.index(mode.pixel_format),
            mode.frame_rate_hz is None or mode.frame_rate_hz >= LEAST_RATE_HZ,
            mode.width_px * mode.height_px,
        ),
        default=None,
    )


def _camera_mode(one: FormatAbility, facts: CameraFacts | None) -> CameraMode:
    name = one.pixel_format.strip()
    slow = [rate for rate in one.frame_rates_hz if rate <= MOST_RATE_HZ + 0.5]
    rate = max(slow) if slow else min(one.frame_rates_hz, default=None)
    bits = PIXEL_FORMATS[name].bits
    if bits == 16 and facts is not None and facts.bit_depth is not None:
        bits = facts.bit_depth.value
    return CameraMode(
        pixel_format=name, bit_depth=bits, width_px=one.width_px, height_px=one.height_px, frame_rate_hz=rate
    )


def fixed_controls(controls: Iterable[ControlAbility]) -> dict[str, tuple[int, str]]:
    """Values, and why, for controls that change the picture, so that they are the same in every session."""
    fixed: dict[str, tuple[int, str]] = {}
    for control in (one for one in controls if one.is_settable):
        if control.name == "gamma":
            fixed[control.name] = (_nearest(control, LINEAR_GAMMA), "linear, or nearest to it")
        elif control.name in AT_MINIMUM:
            fixed[control.name] = (control.minimum, "the least")
        elif control.name in AT_DEFAULT:
            fixed[control.name] = (control.default, "the camera's default")
        elif control.name in AS_THEY_ARE and control.value is not None:
            fixed[control.name] = (control.value, "as it is now; set it for your scene")
    return fixed


def _nearest(control: ControlAbility, value: int) -> int:
    """The value that a control takes which is nearest to one, from below."""
    inside = min(max(value, control.minimum), control.maximum)
    return inside - (inside - control.minimum) % max(1, control.step)


def best_output_mode(modes: Iterable[OutputMode], facts: ProjectorFacts | None = None) -> OutputMode | None:
    """The projector's native mode: its data sheet's, else the one the display prefers, else the first."""
    known = list(modes)
    if facts is not None and facts.width_px is not None and facts.height_px is not None:
        size = (facts.width_px.value, facts.height_px.value)
        known = [mode for mode in known if (mode.width_px, mode.height_px) == size] or known
    return next((mode for mode in known if mode.preferred), known[0] if known else None)
