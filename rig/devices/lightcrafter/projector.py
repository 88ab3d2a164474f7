"""A projector whose light engine is a LightCrafter: the display shows pictures, the controller makes them linear."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack, suppress

from rig.devices.driver_settings import LightCrafterSettings
from rig.devices.lightcrafter.controller import LightCrafter, LightCrafterState, open_lightcrafter
from rig.devices.protocols import Clock, Codes, Projector, Shown, check_on_screen
from rig.errors import DeviceError


class LightCrafterProjector:
    """Prepares the controller when the display opens, puts back what it found when it closes.

    Parameters
    ----------
    display
        Shows pictures on the output that the LightCrafter is plugged into.
    connect
        Opens the controller.
    led_currents
        Red, green, blue, in steps; None leaves them.
    """

    def __init__(
        self, display: Projector, connect: Callable[[], LightCrafter], led_currents: tuple[int, int, int] | None
    ):
        self._display = display
        self._connect = connect
        self._led_currents = led_currents
        self._controller: LightCrafter | None = None
        self._found: LightCrafterState | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """(height, width), in pixels."""
        return self._display.shape

    def open(self) -> None:
        """Prepare the controller, then the display; no-op when open. Raises DeviceError, SettingRefused."""
        if self._controller is not None:
            return
        with ExitStack() as undo:
            controller = self._connect()
            undo.callback(controller.close)
            controller.wake()
            controller.check_hardware()
            found = controller.state()
            undo.callback(_restore, controller, found)
            controller.prepare_video(self._led_currents)
            self._display.open()
            undo.pop_all()
        self._controller, self._found = controller, found

    def close(self) -> None:
        """Show black, put the controller's settings back and let go; any number of times, from any state."""
        controller, self._controller = self._controller, None
        with ExitStack() as each:
            if controller is not None and self._found is not None:
                each.callback(controller.close)
                each.callback(_restore, controller, self._found)
            each.callback(self._display.close)

    def show(self, codes: Codes, *, name: str) -> Shown:
        """Show codes on the display. Raises DeviceLost, SettingRefused."""
        return self._display.show(codes, name=name)

    def check_on_screen(self) -> None:
        """Ask the display, where it can tell. Raises DeviceLost."""
        check_on_screen(self._display)


def _restore(controller: LightCrafter, found: LightCrafterState) -> None:
    with suppress(DeviceError):  # it is gone, and its settings with it
        controller.restore(found)


def from_profile(display: Projector, settings: LightCrafterSettings, clock: Clock) -> LightCrafterProjector:
    """Make a projector whose light engine its table [projector.lightcrafter] describes, closed."""
    return LightCrafterProjector(display, lambda: open_lightcrafter(settings.serial, clock), settings.led_currents)
