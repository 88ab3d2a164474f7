"""The gain of an open GenICam camera, for looking."""

from __future__ import annotations

from collections.abc import Callable

from rig.devices.genicam.features import Feature, Features
from rig.devices.protocols import Gain
from rig.devices.refusals import check_gain

GAIN = "Gain"
"""In dB."""


class GenicamGain:
    """Changes the gain, and what the camera is held to.

    Parameters
    ----------
    features
        Of the open camera.
    held
        What is looked at before each exposure; changed here.
    on_change
        Told that frames from now on have another gain.
    """

    def __init__(self, features: Features, held: list[Feature], on_change: Callable[[], None]):
        self._features, self._held, self._on_change = features, held, on_change

    def now(self) -> Gain:
        """Read it. Raises DeviceLost."""
        return Gain(self._features.number(GAIN), *self._features.bounds(GAIN), "dB")

    def change(self, value: float) -> Gain:
        """Set it, and read what the camera took. Raises SettingRefused, DeviceLost."""
        check_gain(value, self.now())
        got = self._features.set_number(GAIN, value)
        self._held[:] = [*(one for one in self._held if one.name != GAIN), Feature(GAIN, got)]
        self._on_change()
        return self.now()

    def profile_lines(self) -> str:
        """Return the line of [camera.options.features]."""
        return f"[camera.options.features] {GAIN} = {self.now().value:g}"
