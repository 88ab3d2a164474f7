"""A device went away: let go of it, wait for it, open it again; all of that within a limit."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Protocol

from rig.devices.protocols import Clock
from rig.errors import CaptureTimeout, DeviceBusy, DeviceError, DeviceForbidden, DeviceLost

_FIRST_PAUSE_S = 0.1
_LONGEST_PAUSE_S = 1.0
_PAUSE_GROWTH = 1.5
_REFUSALS_S = 2.0
"""A device that was just plugged in belongs to root, and desktop services look into it, for about a second."""

Note = Callable[[str, str], None]
"""Takes the kind of an event and its detail."""


class Openable(Protocol):
    """A camera or a projector."""

    def open(self) -> None:
        """Make it ready; raises DeviceError."""
        ...

    def close(self) -> None:
        """Let it go."""
        ...


class Gone(Exception):
    """A device went away."""

    def __init__(self, device: Openable, loss: DeviceLost):
        super().__init__(str(loss))
        self.device = device
        self.loss = loss


@contextmanager
def talking_to(device: Openable) -> Iterator[None]:
    """Remember which device it was that went away. Raises Gone in the place of DeviceLost."""
    try:
        yield
    except DeviceLost as loss:
        raise Gone(device, loss) from loss


def close_quietly(device: Openable) -> None:
    """Close a device that may be gone."""
    with suppress(DeviceError):
        device.close()


class Recovery:
    """Brings devices back during one shot; its waiting together, from the first loss on, is limited.

    Parameters
    ----------
    clock
        To wait with.
    limit_s
        How long, from the first loss on, a device is waited for.
    note
        Called for every event: unplugged, replugged.
    """

    def __init__(self, clock: Clock, limit_s: float, note: Note):
        self._clock = clock
        self._limit_s = limit_s
        self._note = note
        self._deadline_s: float | None = None
        self._pause_s = _FIRST_PAUSE_S
        self._refused_s: float | None = None
        """When a device that had come back first refused to be opened."""

    def bring_back(self, device: Openable, name: str, loss: DeviceLost, restore: Callable[[], None]) -> None:
        """Close a device, wait until it opens again, and ``restore`` its settings.

        Raises
        ------
        DeviceLost
            It did not come back in time.
        DeviceBusy, DeviceForbidden
            It came back, but belongs to somebody else for more than a moment.
        SettingRefused
            It came back as another: it cannot do what it did before.
        """
        lost_s = self._clock.now_s()
        if self._deadline_s is None:
            self._deadline_s = lost_s + self._limit_s
        self._note("unplugged", f"{name}: {loss}")
        close_quietly(device)
        tries = 0
        last: DeviceError = loss
        while self._pause(self._deadline_s):
            tries += 1
            again = self._open(device, restore)
            if again is None:
                self._note("replugged", f"{name}: back after {self._clock.now_s() - lost_s:.1f} s")
                return
            last = again
        raise DeviceLost(
            f"{name} did not come back within {self._limit_s:g} s (timing.replug_timeout_s), {tries} attempts to open "
            f"it: {loss}; last: {last}; check plug, cable and power, then run the same command again"
        ) from last

    def _pause(self, deadline_s: float) -> bool:
        """Wait a little longer than the last time; False when the time is up."""
        now_s = self._clock.now_s()
        if now_s >= deadline_s:
            return False
        self._clock.wait_until_s(min(now_s + self._pause_s, deadline_s))
        self._pause_s = min(_PAUSE_GROWTH * self._pause_s, _LONGEST_PAUSE_S)
        return True

    def _open(self, device: Openable, restore: Callable[[], None]) -> DeviceError | None:
        """Open and restore; returns the reason when it is still, or again, away, or not awake yet."""
        try:
            device.open()
            restore()
        except (DeviceLost, CaptureTimeout) as loss:
            close_quietly(device)
            # Kept as a value: with its traceback it would hold this frame, which holds it, and the whole show with it.
            return loss.with_traceback(None)
        except (DeviceBusy, DeviceForbidden) as refusal:
            close_quietly(device)
            if self._is_refused_for_long():
                raise
            return DeviceLost(str(refusal))
        self._refused_s = None
        return None

    def _is_refused_for_long(self) -> bool:
        """Count a refusal as away for a moment; then it is the error."""
        now_s = self._clock.now_s()
        self._refused_s = now_s if self._refused_s is None else self._refused_s
        return now_s - self._refused_s >= _REFUSALS_S
