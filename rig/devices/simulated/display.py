"""A display that is not there but keeps time: for trying live pictures without hardware."""

from __future__ import annotations

import math

import numpy as np

from rig.devices.protocols import Clock, Codes, Shown
from rig.errors import DeviceLost, SettingRefused


class ClockedDisplay:
    """Takes a picture as a real output does, by copying it, and shows it at its next refresh.

    Parameters
    ----------
    shape
        (height, width), in pixels.
    refresh_rate_hz
        Its refreshes are at multiples of its period on the clock.
    clock
        The machine's; a virtual one for tests.
    """

    def __init__(self, shape: tuple[int, int], refresh_rate_hz: float, clock: Clock):
        self.picture = np.zeros((*shape, 3), np.uint8)
        """(H, W, 3) codes that are on screen."""
        self.is_open = False
        self.is_plugged = True
        """Tests pull the cable here."""
        self._shape = shape
        self._period_s = 1 / refresh_rate_hz
        self._clock = clock

    @property
    def shape(self) -> tuple[int, int]:
        """(height, width), in pixels."""
        return self._shape

    def open(self) -> None:
        """Show black. Raises DeviceLost while unplugged."""
        self._check_plug()
        if not self.is_open:
            self.is_open = True
            self.picture[:] = 0

    def close(self) -> None:
        """Go black."""
        self.is_open = False
        self.picture[:] = 0

    def check_on_screen(self) -> None:
        """Raise DeviceLost when closed or unplugged."""
        self._check_plug()
        if not self.is_open:
            raise DeviceLost("the simulated display is closed: open it before showing a picture")

    def show(self, codes: Codes, *, name: str) -> Shown:
        """Copy codes, (H, W) or (H, W, 3), and wait until they are on screen. Raises DeviceLost, SettingRefused."""
        self.check_on_screen()
        if codes.dtype != np.uint8 or codes.shape not in (self._shape, (*self._shape, 3)):
            raise SettingRefused(
                f"the display shows uint8 codes of shape {self._shape}, not {codes.dtype} of {codes.shape}; "
                "make the picture in exactly its size"
            )
        np.copyto(self.picture, codes if codes.ndim == 3 else codes[..., None])
        on_screen_s = math.ceil(self._clock.now_s() / self._period_s + 1e-9) * self._period_s
        self._clock.wait_until_s(on_screen_s)
        return Shown(on_screen_s, name)

    def _check_plug(self) -> None:
        if not self.is_plugged:
            raise DeviceLost("the simulated display is unplugged, as simulation.projector.unplugged_s says")
