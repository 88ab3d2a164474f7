"""What exists while a camera is open, and what is known of frames that may still be on their way."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, field

from rig.devices.genicam.clock_map import ClockMap, TriggerAnswers
from rig.devices.genicam.features import Feature, Features
from rig.devices.genicam.stream import GenicamStream


@dataclass(slots=True, kw_only=True)
class OpenGenicam:
    """Everything that exists while the camera is open."""

    device: int
    camera: int
    features: Features
    stream: GenicamStream
    exposure: str
    """The feature's name."""
    exposure_s: float
    held: list[Feature]
    packet_bytes: int | None
    """None of a USB camera."""
    undo: ExitStack
    clock_map: ClockMap = field(default_factory=ClockMap)
    answers: TriggerAnswers = field(default_factory=TriggerAnswers)
    valid_from_s: float = 0.0
    """Frames that began earlier have another exposure."""
    quiet_until_s: float = 0.0
    """Until then a frame that nobody asks for any more may still come; no other is triggered."""
    is_waiting: bool = False
    """A trigger was sent, and its frame has not come."""
    missed: int = 0
    """Frames that came incomplete since the last good one."""

    def stay_quiet(self, until_s: float) -> None:
        """Trigger nothing until then, or until the later time that was asked for before."""
        self.quiet_until_s = max(self.quiet_until_s, until_s)
