"""A wire from a projector's sync output to a camera's trigger input, and what feeds the emulated camera by it."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable

from rig.devices.protocols import Clock


class PulseWire:
    """Pulses at the beginning of each refresh of a display.

    Parameters
    ----------
    rate_hz
        Pulses a second.
    clock
        The machine's; a pulse comes at each of its whole multiples of the period.
    """

    def __init__(self, rate_hz: float, clock: Clock):
        self.rate_hz = rate_hz
        self._clock = clock

    def wait_for_pulse(self) -> float:
        """Return when the next pulse comes, with its time in seconds."""
        next_s = (math.floor(self._clock.now_s() * self.rate_hz) + 1) / self.rate_hz
        self._clock.wait_until_s(next_s)
        return next_s


class Feeder:
    """Calls something at a rate, in a thread of its own, between :meth:`start` and :meth:`stop`.

    Parameters
    ----------
    rate_hz
        How often.
    call
        What is called.
    """

    def __init__(self, rate_hz: float, call: Callable[[], None]):
        self._period_s, self._call = 1 / rate_hz, call
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Begin; no-op while it runs."""
        if self._thread is None:
            self._ended.clear()
            self._thread = threading.Thread(target=self._run, daemon=True)
            self._thread.start()

    def stop(self) -> None:
        """End, and wait until the last call is over; any number of times."""
        thread, self._thread = self._thread, None
        if thread is not None:
            self._ended.set()
            thread.join()

    def _run(self) -> None:
        while not self._ended.wait(self._period_s):
            self._call()
