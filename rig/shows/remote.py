"""Commands of show control for a running show, by Open Sound Control (OSC 1.0, over UDP)."""

from __future__ import annotations

import logging
import math
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from types import TracebackType

from rig.errors import UsageError
from rig.live.show.controls import GAIN_RANGE, Controls, RemoteControl

log = logging.getLogger("rig.shows")

ADDRESSES = {
    "/rig/black": "1: black, 0: picture",
    "/rig/freeze": "1: freeze, 0: go on",
    "/rig/gain": "times the target's brightness",
    "/rig/compensation": "1: on, 0: off",
    "/rig/source/next": "the next source",
}
"""What is listened to."""
_MOST_WAITING = 100
"""Commands between two frames; a flood of them drops the oldest."""
Change = Callable[[Controls], Controls]


class Remote:
    """Holds commands between the thread that listens and the loop that obeys."""

    def __init__(self) -> None:
        self._changes: deque[Change] = deque(maxlen=_MOST_WAITING)
        self._keys: deque[str] = deque(maxlen=_MOST_WAITING)

    def command(self, address: str, *values: object) -> None:
        """Take a command; one that makes no sense is told to the log and changes nothing.

        Parameters
        ----------
        address
            One of ``ADDRESSES``.
        values
            What came with it.
        """
        if address == "/rig/source/next":
            self._keys.append("n")
            return
        change = _change(address, values)
        if change is None:
            log.warning("OSC %s %s: not understood; there are %s", address[:80], str(values)[:80], ", ".join(ADDRESSES))
            return
        log.info("OSC %s %s", address, values[0])
        self._changes.append(change)

    def adjusted(self, controls: Controls) -> Controls:
        """Return settings after all commands that wait."""
        while self._changes:
            controls = self._changes.popleft()(controls)
        return controls

    def pressed(self) -> str:
        """Return keys that commands stand for."""
        keys = ""
        while self._keys:
            keys += self._keys.popleft()
        return keys


class Desk:
    """All places from which a show is told something; what was set stays set when the show begins again.

    Parameters
    ----------
    remotes
        In the order in which they are asked.
    """

    def __init__(self, *remotes: RemoteControl):
        self._remotes = remotes
        self._set: Controls | None = None
        self._begins = False

    def begin(self) -> None:
        """Note that the show begins, or begins again: black that somebody ordered stays black."""
        self._begins = True

    def adjusted(self, controls: Controls) -> Controls:
        """Return settings after all commands that wait."""
        if self._begins and self._set is not None:
            controls = self._set
        self._begins = False
        for remote in self._remotes:
            controls = remote.adjusted(controls)
        self._set = controls
        return controls

    def pressed(self) -> str:
        """Return keys that commands stand for."""
        return "".join(remote.pressed() for remote in self._remotes)


def _change(address: str, values: tuple[object, ...]) -> Change | None:
    """What a command does; None where it is not understood."""
    if len(values) != 1 or not isinstance(values[0], bool | int | float) or not math.isfinite(values[0]):
        return None
    value = float(values[0])
    if address == "/rig/gain":
        low, high = GAIN_RANGE
        return (lambda controls: replace(controls, gain=value)) if low <= value <= high else None
    if value not in (0.0, 1.0):
        return None
    on = value == 1.0
    switches: dict[str, Change] = {
        "/rig/black": lambda controls: replace(controls, black=on),
        "/rig/freeze": lambda controls: replace(controls, frozen=on),
        "/rig/compensation": lambda controls: replace(controls, compensating=on),
    }
    return switches.get(address)


class OscListener:
    """Listens in a thread of its own; use it in a ``with`` statement.

    Parameters
    ----------
    remote
        Takes the commands.
    host, port
        To listen on; port 0: any that is free.
    """

    def __init__(self, remote: Remote, host: str, port: int):
        try:
            from pythonosc.dispatcher import Dispatcher
            from pythonosc.osc_server import BlockingOSCUDPServer
        except ImportError as error:
            raise UsageError("OSC needs python-osc: pip install 'procam-rig[osc]', or remove [osc]") from error
        dispatcher = Dispatcher()
        dispatcher.set_default_handler(remote.command)
        try:
            self._server = BlockingOSCUDPServer((host, port), dispatcher)
        except (OSError, OverflowError) as error:
            raise UsageError(
                f"OSC cannot listen on {host}:{port}: {error}; choose another [osc] host or port"
            ) from error
        self._thread = threading.Thread(target=self._server.serve_forever, name="osc", daemon=True)

    @property
    def port(self) -> int:
        """That it listens on."""
        return int(self._server.server_address[1])

    def __enter__(self) -> OscListener:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._server.shutdown()
        self._server.server_close()
