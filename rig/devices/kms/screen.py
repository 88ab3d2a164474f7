"""One output in our hands: its mode is set, and pictures are flipped in with the display's own time stamps."""

from __future__ import annotations

import errno
from contextlib import ExitStack, suppress

import numpy as np

from rig.devices.kms import abi
from rig.devices.kms.buffers import DumbBuffer
from rig.devices.kms.card import Card, Change
from rig.devices.kms.find import FoundOutput, offers, status_of
from rig.devices.kms.flips import Flip
from rig.devices.kms.settings import (
    choose_mode,
    choose_path,
    earlier_values,
    neutral_changes,
    required_changes,
    switched_off,
)
from rig.devices.protocols import Clock, Codes
from rig.errors import DeviceBusy, DeviceError, DeviceLost

_FLIP_TIMEOUT_S = 3.0
"""Many refreshes of the slowest display: without a flip by then there is none."""
_MASTER_TIMEOUT_S = 0.5
"""A program that only looks at a card holds it for a moment."""
_RETRY_S = 0.02
"""About a refresh."""
_LINK_BAD = 1


class Screen:
    """An output that shows our pictures, black at first, until it is closed."""

    def __init__(self, found: FoundOutput, shape: tuple[int, int], refresh_rate_hz: float, clock: Clock):
        self.found = found
        self._shape = shape
        self._clock = clock
        self._flips_asked = 0
        self._next = 0
        with ExitStack() as undo:
            self._card = _open_as_master(found, clock)
            undo.callback(self._card.close)
            try:
                self._set_up(refresh_rate_hz, undo)
            except OSError as error:
                raise self._card.named(error, f"setting up {found.connector}") from error
            undo.pop_all()

    def _set_up(self, refresh_rate_hz: float, undo: ExitStack) -> None:
        connector = self._card.connector(self.found.connector)
        self._check_plugged()
        mode = choose_mode(connector.modes, self._shape, refresh_rate_hz, self.found.connector)
        self.refresh_rate_hz = mode.refresh_rate_hz
        self._path = choose_path(self._card, connector)
        self._frame_property = self._path.plane_properties["FB_ID"].id
        self._link = self._path.connector_properties.get("link-status")
        self._buffers: list[DumbBuffer] = []
        undo.callback(self._destroy_buffers)
        black = np.zeros(self._shape, np.uint8)
        for _ in range(2):
            self._buffers.append(DumbBuffer(self._card, *self._shape))
            self._buffers[-1].fill(black)
        blob = self._card.make_blob(mode.timings)
        self._set_mode(required_changes(self._path, mode, blob, self._buffers[1].id))

    def _set_mode(self, required: list[Change]) -> None:
        """Set the mode, and as much else to neutral as the driver allows."""
        chosen: list[Change] = []
        for change in neutral_changes(self._path):
            with suppress(OSError):
                self._card.commit([*required, *chosen, change], abi.TEST_ONLY | abi.ALLOW_MODESET)
                chosen.append(change)
        self._restore = earlier_values(self._path, chosen)
        self._card.commit([*required, *chosen], abi.ALLOW_MODESET)

    def flip(self, codes: Codes) -> Flip:
        """Show codes at the next vertical blank; returns when they are on screen.

        Raises DeviceLost when the connector, its mode or the card is gone, DeviceBusy when another program took over.
        """
        try:
            flip = self._flip(codes)
        except OSError as error:
            self.check()
            raise self._card.named(error, f"showing a picture on {self.found.connector}") from error
        self.check()
        return flip

    def _flip(self, codes: Codes) -> Flip:
        back = self._buffers[self._next]
        back.fill(codes)
        self._flips_asked += 1
        asked_s = self._clock.now_s()
        change = Change(self._path.plane, self._frame_property, back.id)
        self._commit_when_free(change, asked_s + _FLIP_TIMEOUT_S)
        event = self._wait_for_flip(asked_s + _FLIP_TIMEOUT_S)
        self._next = 1 - self._next
        return Flip(asked_s, event.seconds + event.microseconds * 1e-6, event.sequence)

    def _commit_when_free(self, change: Change, until_s: float) -> None:
        """Commit; while an earlier flip is still to come, wait for it."""
        while True:
            try:
                self._card.commit([change], abi.NONBLOCKING | abi.WITH_EVENT, self._flips_asked)
                return
            except OSError as error:
                if error.errno != errno.EBUSY or self._clock.now_s() >= until_s:
                    raise
            self._card.events(_RETRY_S)

    def _wait_for_flip(self, until_s: float) -> abi.FlipEvent:
        while (remaining_s := until_s - self._clock.now_s()) > 0:
            for event in self._card.events(remaining_s):
                if event.user_data == self._flips_asked:
                    return event
        self.check()
        raise DeviceLost(
            f"{self.found.full_name} did not show a picture within {_FLIP_TIMEOUT_S:g} s; "
            "check the cable and the kernel's log"
        )

    def check(self) -> None:
        """Raise DeviceLost when nobody can see what is shown: cable, mode or link are gone."""
        self._check_plugged()
        height, width = self._shape
        if not offers(self.found.folder, width, height):
            raise DeviceLost(
                f"{self.found.full_name} no longer offers {width} x {height} px; was another display plugged in?"
            )
        if self._link is not None and self._link_is_bad(self._link.id):
            raise DeviceLost(f"{self.found.full_name}: its link has failed; check the cable, open the projector again")

    def _check_plugged(self) -> None:
        if status_of(self.found.folder) == "disconnected":
            raise DeviceLost(f"{self.found.full_name} is disconnected; check the cable and the projector's power")

    def _link_is_bad(self, property_id: int) -> bool:
        try:
            return self._card.values(self._path.connector).get(property_id) == _LINK_BAD
        except OSError as error:
            raise self._card.named(error, f"looking at {self.found.connector}") from error

    def close(self) -> None:
        """Flip to black, switch the signal off, let the card go; each step even if those before it fail."""
        with ExitStack() as steps:
            steps.callback(self._card.close)
            steps.callback(self._destroy_buffers)
            steps.callback(self._switch_off)
            steps.callback(self._go_black)

    def _go_black(self) -> None:
        with suppress(OSError, DeviceError):
            self._flip(np.zeros(self._shape, np.uint8))

    def _switch_off(self) -> None:
        off = switched_off(self._path)
        for changes in ([*off, *self._restore], off):
            with suppress(OSError):
                self._card.commit(changes, abi.ALLOW_MODESET)
                return

    def _destroy_buffers(self) -> None:
        for buffer in self._buffers:
            with suppress(OSError):
                buffer.destroy()


def _open_as_master(found: FoundOutput, clock: Clock) -> Card:
    """Open a card to change what it shows; opened anew for each attempt, which is what the kernel asks of users."""
    until_s = clock.now_s() + _MASTER_TIMEOUT_S
    while True:
        card = Card(found.card)
        try:
            card.become_master()
            return card
        except DeviceBusy:
            card.close()
            if clock.now_s() >= until_s:
                raise
        clock.wait_until_s(clock.now_s() + _RETRY_S)
