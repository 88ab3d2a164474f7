"""Controls: everything automatic off, then the profile's own, each set, read back, and compared again later."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass

from rig.devices.protocols import ExposureRange
from rig.devices.v4l2 import abi
from rig.devices.v4l2.describe import ControlAbility, query_control
from rig.devices.v4l2.node import STALLED, Node
from rig.errors import SettingRefused

EXPOSURE_ABSOLUTE = 0x009A0902
"""In steps of 100 µs."""
EXPOSURE_STEP_S = 100e-6
EXPOSURE_OF_UNKNOWN_UNIT = 0x00980911
_MANUAL, _SHUTTER_PRIORITY = 1, 2
_LOWEST = None

AUTOMATICS: tuple[tuple[int, tuple[int, ...] | None], ...] = (
    (0x009A0901, (_MANUAL, _SHUTTER_PRIORITY)),  # auto_exposure; both leave the exposure time to us
    (0x009A0903, (0,)),  # exposure_dynamic_framerate
    (0x009A0918, (0,)),  # iso_sensitivity_auto
    (0x009A091A, (0,)),  # scene_mode
    (0x009A0915, (0,)),  # wide_dynamic_range
    (0x009A0924, (0,)),  # hdr_sensor_mode
    (0x009A0916, (0,)),  # image_stabilization
    (0x009A090C, (0,)),  # focus_automatic_continuous
    (0x0098090C, (0,)),  # white_balance_automatic
    (0x00980912, (0,)),  # gain_automatic
    (0x00980919, (0,)),  # hue_automatic
    (0x00980920, (0,)),  # brightness_automatic
    (0x0098091D, (0,)),  # chroma_agc
    (0x0098091C, _LOWEST),  # backlight_compensation
    (0x0098091B, _LOWEST),  # sharpness
    (0x0098091F, (0,)),  # color_effects
    (0x00980918, (0,)),  # power_line_frequency
    (0x00980910, (100,)),  # gamma: 1.00
    (0x009F0903, (0,)),  # test_pattern of a sensor
)
"""What has to stand still, in the order in which it is set: control, and values by preference (None: its lowest).

What decides over other controls comes first. A control that has none of the values is left as it is, but for the first.
"""


@dataclass(frozen=True, slots=True)
class Setting:
    """A control and the value that it has to have."""

    control: ControlAbility
    value: int
    asked_for: bool = True
    """The profile names it; what is ours is left alone while another control makes it inactive."""


def plan_settings(controls: Iterable[ControlAbility], wanted: Mapping[str, int]) -> list[Setting]:
    """Return what to set, in order: automatics off where the profile does not name them, then the profile's controls.

    Raises SettingRefused with a line for each control that is unknown or cannot have its value.
    """
    by_name = {control.name: control for control in controls}
    problems = [problem for name, value in wanted.items() if (problem := _problem(by_name, name, value))]
    if problems:
        raise SettingRefused("\n".join(problems))
    by_id = {control.id: control for control in by_name.values()}
    automatic = [
        Setting(by_id[control_id], value, asked_for=False)
        for control_id, values in AUTOMATICS
        if control_id in by_id and by_id[control_id].name not in wanted
        for value in _first_possible(by_id[control_id], values)
    ]
    return automatic + [Setting(by_name[name], value) for name, value in wanted.items()]


def _problem(by_name: Mapping[str, ControlAbility], name: str, value: int) -> str | None:
    control = by_name.get(name)
    if control is None:
        return f"the camera has no control {name!r}; {_near(name, by_name)}"
    if control.id == EXPOSURE_ABSOLUTE:
        return f"control {name}: the rig sets it; give camera.exposure_s and camera.exposure_range_s instead"
    if not control.is_settable:
        return f"control {name} cannot be set: it is a {control.kind} ({', '.join(control.flags) or 'no flags'})"
    refusal = control.refusal(value)
    return f"control {name}: asked for {value}, but {refusal}; change camera.controls.{name}" if refusal else None


def _near(name: str, by_name: Mapping[str, ControlAbility]) -> str:
    settable = [known for known, control in by_name.items() if control.is_settable]
    near = difflib.get_close_matches(name, settable, 3, 0.5)
    if near:
        return f"did you mean {' or '.join(near)}?"
    return f"it has {', '.join(sorted(settable)) or 'none that can be set'}"


def _first_possible(control: ControlAbility, values: tuple[int, ...] | None) -> list[int]:
    """At most one value. Raises SettingRefused when the exposure cannot be made manual."""
    possible = [value for value in values or (control.minimum,) if control.refusal(value) is None]
    if possible and control.is_settable:
        return possible[:1]
    if control.id == AUTOMATICS[0][0] and control.value not in (AUTOMATICS[0][1] or ()):
        raise SettingRefused(
            f"control {control.name} cannot be made manual: {control.refusal(_MANUAL) or ', '.join(control.flags)}; "
            "a camera that exposes as it likes cannot measure"
        )
    return []


def apply_settings(node: Node, settings: Iterable[Setting]) -> None:
    """Set each control and read it back. Raises SettingRefused on the first that has another value then."""
    for setting in settings:
        control = setting.control
        if "inactive" not in query_control(node, control.id).flags:
            set_control(node, control, setting.value)
        elif setting.asked_for:
            raise SettingRefused(
                f"control {control.name} is inactive: another control decides over it; "
                f"switch that off in camera.controls, or remove {control.name} there"
            )


def offer_settings(node: Node, settings: Iterable[Setting]) -> None:
    """Set what can be set already; some cameras keep controls only while they stream."""
    for setting in settings:
        with suppress(SettingRefused):  # asked for again, and insisted on, when frames come
            apply_settings(node, [setting])


def changed_settings(node: Node, settings: Iterable[Setting]) -> list[Setting]:
    """Those that do not have their value, or that another control decides over although the profile asked for them.

    Volatile ones may have any value, and inactive ones that nobody asked for.
    """
    changed = []
    for setting in settings:
        now = query_control(node, setting.control.id)
        is_free = bool({"inactive", "volatile", "write-only"} & set(now.flags))
        is_overruled = setting.asked_for and "inactive" in now.flags
        if is_overruled or (now.value != setting.value and not is_free):
            changed.append(setting)
    return changed


def set_control(node: Node, control: ControlAbility, value: int) -> None:
    """Set one control and read it back. Raises SettingRefused when it has another value then."""
    asked = f"setting control {control.name} to {value}"
    node.call(abi.S_CTRL, abi.ControlValue(id=control.id, value=value), asked, STALLED)
    if not {"write-only", "volatile"} & set(control.flags) and (got := read_control(node, control)) != value:
        raise mismatch(control, value, got)


def read_control(node: Node, control: ControlAbility) -> int:
    """Return what a control has now. Raises DeviceError."""
    asked = abi.ControlValue(id=control.id)
    value = int(node.call(abi.G_CTRL, asked, f"reading control {control.name}", STALLED).value)
    return value & 0xFFFFFFFF if control.kind == "bitmask" else value


def mismatch(control: ControlAbility, asked: int, got: int) -> SettingRefused:
    """The error for a control that took another value than asked for."""
    return SettingRefused(
        f"control {control.name}: asked for {asked}, the camera has {got} "
        f"(range {control.minimum} … {control.maximum}, step {control.step}); "
        f"give a value that it keeps in camera.controls.{control.name}"
    )


def exposure_range_of(controls: Iterable[ControlAbility]) -> ExposureRange | None:
    """Return the exposures that a camera's control takes; None when it has no control in seconds."""
    for control in controls:
        if control.id == EXPOSURE_ABSOLUTE:
            return ExposureRange(max(control.minimum, 1) * EXPOSURE_STEP_S, control.maximum * EXPOSURE_STEP_S)
    return None
