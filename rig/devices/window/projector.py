"""A projector that is a monitor of a desktop: a borderless window that fills it."""

from __future__ import annotations

import atexit
from collections.abc import Callable

import cv2
import numpy as np

from rig.devices.driver_settings import ProjectorSettings
from rig.devices.protocols import Clock, Codes, Shown
from rig.devices.refusals import check_codes
from rig.devices.window.link import ScreenLink
from rig.devices.window.monitor import check_mode, choose_monitor
from rig.errors import DeviceError, DeviceLost


class WindowProjector:
    """Shows codes on one monitor of an X11 or Wayland desktop, pixel for pixel.

    A desktop proves nothing about time: a picture counts as on screen when the desktop has presented it, which may
    be refreshes before its light. `rig check` measures the rest.

    Parameters
    ----------
    output
        The monitor's name, or ``monitor:INDEX``.
    shape
        (height, width) of the mode that the monitor has to be in, in pixels.
    refresh_rate_hz
        Of that mode.
    clock
        The rig's.
    """

    def __init__(self, output: str, *, shape: tuple[int, int], refresh_rate_hz: float, clock: Clock):
        self._output = output
        self._shape = shape
        self._refresh_rate_hz = refresh_rate_hz
        self._clock = clock
        self._link: ScreenLink | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """(height, width), in pixels."""
        return self._shape

    def open(self) -> None:
        """Fill the monitor with black; no-op when open.

        Raises DeviceError without a desktop, DeviceLost without the monitor, SettingRefused in another mode.
        """
        if self._link is None:
            height, width = self._shape
            self._link = ScreenLink(4 * height * width)
            atexit.register(self.close)
            try:
                self._fill_monitor(self._link)
            except DeviceError:
                self.close()
                raise

    def close(self) -> None:
        """Show black and take the window away; any number of times, from any state."""
        atexit.unregister(self.close)
        link, self._link = self._link, None
        if link is not None:
            link.close()

    def show(self, codes: Codes, *, name: str) -> Shown:
        """Show uint8 codes of exactly its shape, (H, W) or (H, W, 3); returns when they were presented.

        Raises DeviceLost when it is closed, unplugged or covered, SettingRefused for other codes or another mode.
        """
        if self._link is None:
            raise DeviceLost(f"the projector on monitor {self._output!r} is closed: open the rig first")
        check_codes(codes, self._shape)
        self._draw(self._link, codes)
        return Shown(self._clock.now_s(), name)

    def _fill_monitor(self, link: ScreenLink) -> None:
        monitor = choose_monitor(link.monitors, self._output)
        check_mode(monitor, self._shape, self._refresh_rate_hz)
        self._named(lambda: link.open_window(monitor.index))

    def _draw(self, link: ScreenLink, codes: Codes) -> None:
        canvas = np.frombuffer(link.picture, np.uint8).reshape(*self._shape, 4)
        to_rgba = cv2.COLOR_RGB2RGBA if codes.ndim == 3 else cv2.COLOR_GRAY2RGBA
        cv2.cvtColor(codes[::-1], to_rgba, dst=canvas)
        try:
            self._named(link.show)
        except DeviceError:
            self.close()
            raise

    def _named(self, action: Callable[[], None]) -> None:
        """Do something; its error names the monitor."""
        try:
            action()
        except DeviceError as error:
            raise type(error)(f"the projector on monitor {self._output!r}: {error}") from error


def from_profile(settings: ProjectorSettings, clock: Clock) -> WindowProjector:
    """Make the projector of a profile's table [[projector]], closed: driver ``window``."""
    return WindowProjector(
        settings.output or "", shape=settings.shape, refresh_rate_hz=settings.refresh_rate_hz, clock=clock
    )
