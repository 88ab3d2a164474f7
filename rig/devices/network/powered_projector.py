"""A projector that is switched on over the network before it is used."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable
from pathlib import Path

from rig.devices.driver_settings import PjlinkSettings
from rig.devices.network.pjlink import Pjlink, Power
from rig.devices.protocols import Clock, Codes, Projector, Shown, check_on_screen
from rig.errors import DeviceBusy, DeviceError, DeviceLost, ProfileError, SettingRefused

_PERIOD_S = 1.0
"""Between two questions whether it is ready."""


class PoweredProjector:
    """Any projector, with its network control: open switches on, close makes dark.

    Closing mutes the picture and leaves the lamp lit: a lamp that is switched off has to cool down before it starts
    again, drifts in colour for half an hour, and wears most when it starts. Whoever ends the day switches it off.

    Parameters
    ----------
    projector
        The display output that the projector hangs on.
    control
        The projector's network control.
    input_code
        Which input that output is plugged into; None leaves the projector's input alone.
    warm_up_timeout_s
        For all of opening: cooling down from before, warming up, finding the signal.
    clock
        The rig's.
    """

    def __init__(
        self,
        projector: Projector,
        control: Pjlink,
        *,
        input_code: str | None,
        warm_up_timeout_s: float,
        clock: Clock,
    ):
        self._projector = projector
        self._control = control
        self._input_code = input_code
        self._warm_up_timeout_s = warm_up_timeout_s
        self._clock = clock
        self._may_be_lit = False

    @property
    def shape(self) -> tuple[int, int]:
        """(height, width), in pixels."""
        return self._projector.shape

    def open(self) -> None:
        """Switch on, wait for the lamp, choose the input, show; no-op when open.

        Raises DeviceLost, DeviceForbidden, SettingRefused; DeviceError when the time is up.
        """
        if self._may_be_lit:
            self._projector.open()
            return
        was_lit = self._control.power() is Power.ON  # who cannot be reached is not waited for
        self._may_be_lit = True
        try:
            self._start(was_lit, self._clock.now_s() + self._warm_up_timeout_s)
        except DeviceError:
            self.close()
            raise

    def close(self) -> None:
        """Show black, let go and mute; the lamp stays lit. Any number of times, from any state."""
        self._projector.close()
        if self._may_be_lit:
            self._may_be_lit = False
            with contextlib.suppress(DeviceError):  # it is black already
                self._control.set_mute(True)

    def show(self, codes: Codes, *, name: str) -> Shown:
        """Show uint8 codes of exactly its shape. Raises DeviceLost, SettingRefused."""
        return self._projector.show(codes, name=name)

    def check_on_screen(self) -> None:
        """Ask the display, where it can tell. Raises DeviceLost."""
        check_on_screen(self._projector)

    def _start(self, was_lit: bool, until_s: float) -> None:
        self._wait_for(self._is_lit, until_s)
        self._wait_for(self._is_on_its_input, until_s)
        if was_lit:
            self._projector.open()
        else:
            self._wait_for(self._is_open, until_s)  # its monitor appears some time after its light
        self._wait_for(self._is_visible, until_s)

    def _wait_for(self, step: Callable[[], bool], until_s: float) -> None:
        problem: DeviceError | None = None
        while self._clock.now_s() < until_s:
            try:
                if step():
                    return
            except (DeviceBusy, DeviceLost) as error:  # the network and the signal drop while it starts
                problem = error
            self._clock.wait_until_s(min(self._clock.now_s() + _PERIOD_S, until_s))
        raise DeviceError(
            f"{self._control.where} was not ready within {self._warm_up_timeout_s:g} s "
            f"({problem or 'it is still warming up or cooling down'}); does it need a longer "
            "projector.pjlink.warm_up_timeout_s?"
        ) from problem

    def _is_lit(self) -> bool:
        power = self._control.power()
        if power is Power.STANDBY:
            self._control.switch_on()
        return power is Power.ON

    def _is_on_its_input(self) -> bool:
        if self._input_code is None or self._control.input() == self._input_code:
            return True
        try:
            self._control.select_input(self._input_code)
        except SettingRefused as error:
            known = ", ".join(self._control.inputs())
            raise SettingRefused(f"{error}; projector.pjlink.input may be one of {known}") from error
        return False

    def _is_open(self) -> bool:
        self._projector.open()
        return True

    def _is_visible(self) -> bool:
        if not self._control.mute().picture:
            return True
        self._control.set_mute(False)
        return False


def from_profile(display: Projector, settings: PjlinkSettings, path: Path, clock: Clock) -> PoweredProjector:
    """Make a projector that its table [projector.pjlink], of the profile in a file, switches on; closed.

    Raises what :func:`control_of` raises.
    """
    return PoweredProjector(
        display,
        control_of(settings, path),
        input_code=settings.input,
        warm_up_timeout_s=settings.warm_up_timeout_s,
        clock=clock,
    )


def control_of(settings: PjlinkSettings, path: Path) -> Pjlink:
    """Return what speaks to the projector of a table [projector.pjlink], of the profile in a file.

    A profile holds no secrets: it names the environment variable that does. Raises ProfileError when that is not set.
    """
    name = settings.password_variable
    if name is not None and name not in os.environ:
        raise ProfileError(f"{path}: projector.pjlink.password_variable: the variable {name} is not set; export it")
    return Pjlink(settings.host, settings.port, os.environ[name] if name else None)
