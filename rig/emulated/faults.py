"""What can go wrong with a camera, to be switched on by a test or a command while it runs."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from typing import Literal

Counter = Literal["error_frames", "short_frames", "dropped_frames", "duplicate_frames"]


@dataclass(slots=True, kw_only=True)
class Faults:
    """Faults of an emulated camera; every field may be set at any time, from any thread.

    The counters say how many of the next frames have the fault; each frame has at most one.
    """

    error_frames: int = 0
    """Marked with the stream's error bit: whole, but not to be trusted."""
    short_frames: int = 0
    """Only the first half is sent."""
    dropped_frames: int = 0
    """Exposed and never sent; the host's counter does not see it."""
    duplicate_frames: int = 0
    """The picture of the frame before is sent again as a new frame."""
    frozen: bool = False
    """Sends nothing, and says nothing."""
    frozen_until_reset: bool = False
    """As frozen, until the host resets the device."""
    stalled_controls: set[tuple[int, int]] = field(default_factory=set)
    """(unit, selector) of controls that refuse every request."""
    stall_error: int = 0
    """The reason that such a control gives: a :class:`rig.emulated.uvc.controls.RequestError`."""
    control_delay_s: float = 0.0
    """How long each control request takes; the stream waits too."""
    _lock: threading.Lock = field(default_factory=threading.Lock, init=False, repr=False, compare=False)

    def take(self, counter: Counter) -> bool:
        """Return whether the next frame has this fault; counts it down."""
        with self._lock:
            left: int = getattr(self, counter)
            if left > 0:
                setattr(self, counter, left - 1)
            return left > 0
