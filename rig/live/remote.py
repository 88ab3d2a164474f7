"""A remote control of a live show: what a page or another program does in place of the terminal's keys."""

from __future__ import annotations

from typing import Protocol

from rig.live.show.controls import Controls
from rig.live.show.loop import LiveLoop, ShownFrame
from rig.live.sources.reader import Reader


class Remote(Protocol):
    """Steers a show from elsewhere; each method is called in the show's own thread, and has to be quick."""

    def adjusted(self, controls: Controls) -> Controls:
        """Return the settings as they are wanted; asked before each refresh."""
        ...

    def shown(self, frame: ShownFrame) -> None:
        """Take note of a picture that is on screen; its memory is good until the next one."""
        ...

    def follow(self, loop: LiveLoop, reader: Reader, dropped: int) -> bool:
        """Look after each step what there is to tell; True ends the show."""
        ...
