"""The sensitivity of an open still camera, for looking: it keeps its setting, so it is put back."""

from __future__ import annotations

import math
from contextlib import suppress

from rig.devices.gphoto2.port import StillPort
from rig.devices.protocols import Gain
from rig.devices.refusals import check_gain
from rig.errors import DeviceError

ISO = "iso"


class StillGain:
    """Changes the sensitivity by the camera's own steps.

    Parameters
    ----------
    port
        Of the open camera.
    steps
        ISO of each entry that can be chosen.
    """

    def __init__(self, port: StillPort, steps: dict[str, float]):
        self._port, self._steps = port, steps
        self._first: str | None = None

    def now(self) -> Gain:
        """Read it; an automatic one is the least. Raises DeviceLost."""
        values = self._steps.values()
        value = self._steps.get(self._port.value(ISO) or "", min(values))
        return Gain(value, min(values), max(values), "ISO")

    def change(self, value: float) -> Gain:
        """Choose the step that is nearest in its logarithm. Raises SettingRefused, DeviceLost."""
        check_gain(value, self.now())
        if self._first is None:
            self._first = self._port.value(ISO)
        self._port.hold(ISO, min(self._steps, key=lambda one: abs(math.log(self._steps[one] / value))))
        return self.now()

    def put_back(self) -> None:
        """Leave the camera as it was found, as far as it is still there."""
        if self._first is not None:
            with suppress(DeviceError):
                self._port.hold(ISO, self._first)

    def profile_lines(self) -> str:
        """Return the line of [camera.options.settings]."""
        return f'[camera.options.settings] {ISO} = "{self._port.value(ISO)}"'


def still_gain(port: StillPort) -> StillGain | None:
    """Return the sensitivity of an open camera; None where it offers no numbers."""
    steps: dict[str, float] = {}
    for text in port.choices(ISO):
        with suppress(ValueError):
            if (value := float(text)) > 0:
                steps[text] = value
    return StillGain(port, steps) if steps else None
