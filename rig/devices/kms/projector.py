"""A projector on a display output of its own, without a desktop."""

from __future__ import annotations

import atexit

from rig.devices.driver_settings import ProjectorSettings
from rig.devices.kms.find import choose_output, find_outputs, list_outputs
from rig.devices.kms.flips import Flip, FlipLog
from rig.devices.kms.screen import Screen
from rig.devices.protocols import Clock, Codes, Shown
from rig.devices.refusals import check_codes
from rig.errors import DeviceLost


class KmsProjector:
    """Shows codes on one connector, pixel by pixel, and knows from the kernel when they were on screen.

    Nobody but this program may show pictures on the same graphics card meanwhile. When the program ends, in
    whatever way, the output goes dark: by this class, or by the kernel.

    Parameters
    ----------
    output
        ``HDMI-A-1``; with several cards ``card1:HDMI-A-1``; or ``edid:MAKER-MODEL-SERIAL``.
    shape
        (height, width) of the mode, in pixels.
    refresh_rate_hz
        Of the mode; the nearest within 0.5 Hz is taken.
    clock
        Of the rig; has to be the machine's monotonic one, as the kernel's time stamps are.
    """

    def __init__(self, output: str, *, shape: tuple[int, int], refresh_rate_hz: float, clock: Clock):
        self._output = output
        self._shape = shape
        self._refresh_rate_hz = refresh_rate_hz
        self._clock = clock
        self._screen: Screen | None = None
        self._flips = FlipLog(1.0 / refresh_rate_hz)

    @property
    def shape(self) -> tuple[int, int]:
        """(height, width), in pixels."""
        return self._shape

    @property
    def flips(self) -> FlipLog:
        """When each picture since the last opening was on screen."""
        return self._flips

    def open(self) -> None:
        """Take the output, set its mode, show black; no-op when open.

        Raises
        ------
        DeviceLost
            There is no such output, or nothing is plugged into it.
        DeviceBusy
            Another program shows pictures on the card.
        DeviceForbidden
            The user may not open the card.
        SettingRefused
            The output has no such mode, or its name is ambiguous.
        """
        if self._screen is not None:
            return
        outputs = find_outputs() if self._output.startswith("edid:") else list_outputs()
        found = choose_output(self._output, outputs)
        self._screen = Screen(found, self._shape, self._refresh_rate_hz, self._clock)
        self._flips = FlipLog(1.0 / self._screen.refresh_rate_hz)
        atexit.register(self.close)

    def close(self) -> None:
        """Show black, switch the output off, and let it go; any number of times, from any state."""
        screen, self._screen = self._screen, None
        if screen is not None:
            screen.close()
            atexit.unregister(self.close)

    def flip(self, codes: Codes) -> Flip:
        """Show uint8 codes of exactly its shape at the next vertical blank; returns once they are on screen.

        Raises
        ------
        DeviceLost
            It is closed, or the connector, its mode or the card is gone.
        DeviceBusy
            Another program took the card over.
        SettingRefused
            The codes are no bytes, or of another shape.
        """
        screen = self._opened()
        check_codes(codes, self._shape)
        flip = screen.flip(codes)
        self._flips.append(flip)
        return flip

    def show(self, codes: Codes, *, name: str) -> Shown:
        """Show codes, (H, W) or (H, W, 3), and say when the kernel put them on screen; raises as `flip` does."""
        return Shown(self.flip(codes).time_s, name)

    def check_on_screen(self) -> None:
        """Raise DeviceLost when nobody can see what is shown: it is closed, or cable, mode or link are gone."""
        self._opened().check()

    def _opened(self) -> Screen:
        if self._screen is None:
            raise DeviceLost(f"the projector on {self._output} is closed: open it before showing a picture")
        return self._screen


def from_profile(settings: ProjectorSettings, clock: Clock) -> KmsProjector:
    """Make the projector of a profile's table [[projector]], closed: driver ``kms``."""
    return KmsProjector(
        settings.output or "", shape=settings.shape, refresh_rate_hz=settings.refresh_rate_hz, clock=clock
    )
