"""The gain of an open V4L2 camera, for looking: the camera keeps it when it is closed, so it is put back."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import replace

from rig.devices.protocols import Gain
from rig.devices.refusals import check_gain
from rig.devices.v4l2.controls import Setting, read_control, set_control
from rig.devices.v4l2.describe import ControlAbility, list_controls
from rig.devices.v4l2.node import Node
from rig.errors import DeviceError

_GAINS = (0x00980913, 0x009E0903)
"""gain; analogue_gain of a bare sensor."""
_UNUSABLE = {"inactive", "read-only", "disabled"}


class V4l2Gain:
    """Changes the gain, and what the camera is held to.

    Parameters
    ----------
    node
        Of the open camera.
    control
        Its gain.
    settings
        What is set again when the camera forgets it; changed here.
    on_change
        Told that frames of a while from now have another gain.
    """

    def __init__(self, node: Node, control: ControlAbility, settings: list[Setting], on_change: Callable[[], None]):
        self._node, self._control, self._settings, self._on_change = node, control, settings, on_change
        self._first: int | None = None

    def now(self) -> Gain:
        """Read it. Raises DeviceError."""
        control = self._control
        return Gain(read_control(self._node, control), control.minimum, control.maximum, "steps")

    def change(self, value: float) -> Gain:
        """Set the nearest step, and read it back. Raises SettingRefused, DeviceLost."""
        now, control = self.now(), self._control
        check_gain(value, now)
        if self._first is None:
            self._first = int(now.value)
        step = max(1, control.step)
        chosen = control.minimum + round((value - control.minimum) / step) * step
        self._set(min(chosen, control.maximum - (control.maximum - control.minimum) % step))
        return self.now()

    def put_back(self) -> None:
        """Leave the camera as it was found, as far as it is still there."""
        if self._first is not None:
            with suppress(DeviceError):
                self._set(self._first)

    def _set(self, value: int) -> None:
        set_control(self._node, self._control, value)
        self._settings[:] = [
            replace(one, value=value) if one.control.id == self._control.id else one for one in self._settings
        ]
        self._on_change()

    def profile_lines(self) -> str:
        """Return the line of [camera.controls]."""
        return f"[camera.controls] {self._control.name} = {self.now().value:g}"


def gain_ability(controls: Iterable[ControlAbility]) -> ControlAbility | None:
    """Return the control of a camera's gain that can be set now; None when there is none."""
    usable = {one.id: one for one in controls if one.is_settable and not _UNUSABLE & set(one.flags)}
    return next((usable[one] for one in _GAINS if one in usable), None)


def gain_of(node: Node, settings: list[Setting], on_change: Callable[[], None]) -> V4l2Gain | None:
    """Return the gain of an open camera; None when it has none."""
    control = gain_ability(list_controls(node))
    return None if control is None else V4l2Gain(node, control, settings, on_change)
