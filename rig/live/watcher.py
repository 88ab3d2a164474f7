"""Who watches a live show beside the person at the terminal: a page that charts its frames."""

from __future__ import annotations

from typing import Protocol

from rig.live.show.loop import LiveLoop, ShownFrame
from rig.live.sources.reader import Reader


class ShowWatcher(Protocol):
    """Told of a show; each method is called in the show's own thread, and has to be quick."""

    def shown(self, frame: ShownFrame) -> None:
        """Take note of a picture that is on screen; its memory is good until the next one."""
        ...

    def follow(self, loop: LiveLoop, reader: Reader, dropped: int) -> None:
        """Look after each step what there is to tell."""
        ...
