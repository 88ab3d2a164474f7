"""What went wrong with devices and was put right."""

from __future__ import annotations

from dataclasses import dataclass

from rig.devices.protocols import Clock


@dataclass(frozen=True, slots=True)
class Event:
    """Something that went wrong and was put right, or what the rig gave up on."""

    time_s: float
    """On the rig's clock."""
    kind: str
    """stale, ahead, repeated, lost, malformed, exposure or timeout: it asked again;
    failed: streaming did; reopened, reset: it did so to a camera that gave no good frame;
    unplugged, replugged: it waited for a device."""
    detail: str


MENDED = ("reopened", "reset", "unplugged", "replugged")
"""Kinds of events that are no frame's fault."""


class EventLog:
    """The events of a rig, in their order."""

    def __init__(self, clock: Clock):
        self.events: list[Event] = []
        self._clock = clock

    def note(self, kind: str, detail: str) -> None:
        """Add one that happens now."""
        self.events.append(Event(self._clock.now_s(), kind, detail))
