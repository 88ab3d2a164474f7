"""Making an open node do what a profile says: format, frame rate, controls, each read back."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

from rig.devices.v4l2 import abi
from rig.devices.v4l2.controls import (
    EXPOSURE_ABSOLUTE,
    EXPOSURE_OF_UNKNOWN_UNIT,
    EXPOSURE_STEP_S,
    Setting,
    apply_settings,
    changed_settings,
    mismatch,
    offer_settings,
    plan_settings,
    read_control,
)
from rig.devices.v4l2.describe import ControlAbility, list_controls, list_formats
from rig.devices.v4l2.formats import PixelFormat
from rig.devices.v4l2.node import BUSY, Node
from rig.errors import DeviceLost, SettingRefused

_SAME_RATE = 0.005
"""Relative; 30 and 29.97 Hz are the same."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RequestedSettings:
    """What a profile asks of a camera."""

    shape: tuple[int, int, int]
    pixel_format: PixelFormat
    frame_rate_hz: float
    exposure_range_s: tuple[float, float]
    controls: dict[str, int]


def check_identity(node: Node, bus_path: str) -> None:
    """Raise DeviceLost unless this node is the camera that was looked for: numbers are given again and again."""
    found = node.call(abi.QUERYCAP, abi.Capability(), "asking what it is")
    if found.bus_info.decode() != bus_path:
        raise DeviceLost(f"{node.path} is {found.bus_info.decode()} now, not {bus_path}; plug the camera in again")


def set_format(node: Node, wishes: RequestedSettings) -> abi.PixFormat:
    """Set pixel format and size. Raises SettingRefused, with what there is, when the camera chose another."""
    height_px, width_px, _ = wishes.shape
    wanted = abi.Format(type=abi.VIDEO_CAPTURE)
    pix = wanted.fmt.pix
    pix.width, pix.height, pix.pixelformat = width_px, height_px, abi.fourcc_of(wishes.pixel_format.name)
    pix.field = abi.FIELD_NONE
    asked = f"{wishes.pixel_format.name} {width_px} x {height_px}"
    set_to: abi.PixFormat = node.call(abi.S_FMT, wanted, f"setting the format {asked}", BUSY).fmt.pix
    got = f"{abi.name_of(set_to.pixelformat)} {set_to.width} x {set_to.height}"
    if got != asked:
        raise SettingRefused(f"asked for {asked}, the camera set {got}; it offers {_offers(node, wishes)}")
    if set_to.field not in (abi.FIELD_ANY, abi.FIELD_NONE):
        raise SettingRefused(f"{asked} is interlaced (field {set_to.field}); take a progressive mode")
    return set_to


def _offers(node: Node, wishes: RequestedSettings) -> str:
    """Sizes of the wanted format, or the formats when there is none of it."""
    formats = list(list_formats(node))
    sizes = [f"{one.width_px} x {one.height_px}" for one in formats if one.pixel_format == wishes.pixel_format.name]
    if sizes:
        return f"{wishes.pixel_format.name} in {', '.join(sizes)}"
    return ", ".join(dict.fromkeys(one.pixel_format for one in formats)) or "no format"


def set_frame_rate(node: Node, wishes: RequestedSettings) -> float:
    """Set the frame rate, and return its period in s. Raises SettingRefused, with what there is.

    Where a driver knows no frame rates, the profile is believed.
    """
    wanted = Fraction(wishes.frame_rate_hz).limit_denominator(1001)
    parameters = abi.StreamParameters(type=abi.VIDEO_CAPTURE)
    if not node.ask(abi.G_PARM, parameters) or not parameters.capability & abi.CAP_TIMEPERFRAME:
        return 1 / wishes.frame_rate_hz
    parameters.timeperframe = abi.Fraction(wanted.denominator, wanted.numerator)
    got = node.call(abi.S_PARM, parameters, f"setting {wishes.frame_rate_hz:g} Hz", BUSY).timeperframe
    period_s = float(got.numerator / max(1, got.denominator))
    if not abs(period_s * wishes.frame_rate_hz - 1) <= _SAME_RATE:
        rates = sorted({f"{rate_hz:g}" for one in _same_mode(node, wishes) for rate_hz in one}, key=float)
        raise SettingRefused(
            f"asked for {wishes.frame_rate_hz:g} Hz, the camera set {1 / period_s if period_s else 0:g} Hz; "
            f"in this format it offers {', '.join(rates) or 'no choice'} Hz"
        )
    return period_s


def _same_mode(node: Node, wishes: RequestedSettings) -> list[tuple[float, ...]]:
    mode = (wishes.pixel_format.name, wishes.shape[1], wishes.shape[0])
    return [f.frame_rates_hz for f in list_formats(node) if (f.pixel_format, f.width_px, f.height_px) == mode]


def set_controls(node: Node, wishes: RequestedSettings) -> tuple[list[Setting], ControlAbility | None]:
    """Automatics off, the profile's controls; returns all of them, and the exposure control if there is one.

    What the camera does not keep before it streams, :func:`hold_controls` insists on.
    """
    controls = list(list_controls(node))
    settings = plan_settings(controls, wishes.controls)
    offer_settings(node, settings)
    return settings, next((control for control in controls if control.id == EXPOSURE_ABSOLUTE), None)


def hold_controls(node: Node, settings: list[Setting]) -> None:
    """Set again what has changed by itself; some cameras take controls only while they stream.

    Raises SettingRefused when a control does not keep its value even then.
    """
    apply_settings(node, changed_settings(node, settings))
    for setting in changed_settings(node, settings):
        raise mismatch(setting.control, setting.value, read_control(node, setting.control))


def check_exposure_range(
    node: Node, exposure: ControlAbility | None, wishes: RequestedSettings, period_s: float
) -> None:
    """Raise SettingRefused unless the camera has the profile's exposures."""
    shortest_s, longest_s = wishes.exposure_range_s
    if exposure is not None:
        ends_s = exposure.minimum * EXPOSURE_STEP_S, exposure.maximum * EXPOSURE_STEP_S
        if shortest_s < ends_s[0] - EXPOSURE_STEP_S / 2 or longest_s > ends_s[1] + EXPOSURE_STEP_S / 2:
            raise SettingRefused(
                f"camera.exposure_range_s {shortest_s:g} … {longest_s:g} s is outside what the camera has: "
                f"{ends_s[0]:g} … {ends_s[1]:g} s; give a range within it"
            )
        return
    if node.ask(abi.QUERY_EXT_CTRL, abi.ControlQuery(id=EXPOSURE_OF_UNKNOWN_UNIT)):
        raise SettingRefused(
            "the camera's exposure control has no unit, so its exposures are not known; "
            "take a camera with exposure_time_absolute"
        )
    if not all(abs(end_s / period_s - 1) <= _SAME_RATE for end_s in wishes.exposure_range_s):
        raise SettingRefused(
            f"the camera has no exposure control: it exposes for its whole frame period; camera.exposure_range_s "
            f"has to be [{period_s:g}, {period_s:g}], not [{shortest_s:g}, {longest_s:g}]"
        )
