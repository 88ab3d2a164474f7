"""One operator at a time: whoever holds the lease works the rig, all others watch."""

from __future__ import annotations

import threading
from dataclasses import dataclass

from rig.devices.protocols import Clock
from rig.errors import RigError
from rig.records import Record

HOLD_S = 20.0
"""A page that was closed or fell silent holds the rig no longer; pages say that they are there every 5 s."""
_LONGEST_ID = 64


class RigHeld(RigError):
    """Another operator holds the rig."""


@dataclass(frozen=True, kw_only=True)
class LeaseState(Record):
    """Who works the rig."""

    holder: str
    """Id that a page or program has given itself; empty when the rig is free."""
    label: str
    """What people call it: where it asks from."""


_FREE = LeaseState(holder="", label="")


class Lease:
    """The right to work the rig; it runs out when its holder falls silent.

    Parameters
    ----------
    clock
        By which it runs out.
    """

    def __init__(self, clock: Clock):
        self._clock = clock
        self._state = _FREE
        self._until_s = 0.0
        self._lock = threading.Lock()

    @property
    def state(self) -> LeaseState:
        """Who holds it now."""
        with self._lock:
            return self._now()

    def take(self, client: str, label: str, *, by_force: bool = False) -> LeaseState:
        """Take it, or keep it for longer.

        Raises
        ------
        RigHeld
            Another client holds it, and ``by_force`` was not said; or the client has no id.
        """
        if not 0 < len(client) <= _LONGEST_ID:
            raise RigHeld(f"say who asks: a header X-Rig-Client of 1 to {_LONGEST_ID} signs")
        with self._lock:
            now = self._now()
            if now.holder not in ("", client) and not by_force:
                raise RigHeld(f"{now.label} works the rig; watch, or take it over")
            self._state = LeaseState(holder=client, label=label)
            self._until_s = self._clock.now_s() + HOLD_S
            return self._state

    def keep(self, client: str) -> LeaseState:
        """Say that its holder is still there; changes nothing for others."""
        with self._lock:
            if self._now().holder == client != "":
                self._until_s = self._clock.now_s() + HOLD_S
            return self._now()

    def release(self, client: str) -> LeaseState:
        """Give it back."""
        with self._lock:
            if self._now().holder == client:
                self._state = _FREE
            return self._now()

    def _now(self) -> LeaseState:
        if self._clock.now_s() >= self._until_s:
            self._state = _FREE
        return self._state
