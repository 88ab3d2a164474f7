"""A projector whose display is a piece of memory; an emulated camera looks at it. Driver ``virtual``."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from rig.devices.driver_settings import ProjectorSettings
from rig.devices.protocols import Clock, Codes, Shown
from rig.devices.refusals import check_codes
from rig.devices.virtual.memory import DisplayMemory, path_of
from rig.errors import DeviceLost


class VirtualProjector:
    """Writes pictures into memory; they are on screen at once.

    Parameters
    ----------
    name
        Of the display: what looks at it is given the same.
    shape
        (height, width), in pixels.
    """

    def __init__(self, name: str, *, shape: tuple[int, int], clock: Clock):
        self._name, self._shape, self._clock = name, shape, clock
        self._memory: DisplayMemory | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """(height, width), in pixels."""
        return self._shape

    def open(self) -> None:
        """Make the display, black; no-op when open."""
        if self._memory is None:
            self._memory = DisplayMemory(self._name, self._shape)

    def close(self) -> None:
        """Go black and let go; any number of times."""
        memory, self._memory = self._memory, None
        if memory is not None:
            memory.write(np.zeros(self._shape, np.uint8))
            memory.close()
            with suppress(FileNotFoundError):
                path_of(self._name).unlink()

    def check_on_screen(self) -> None:
        """Raise DeviceLost when closed."""
        self._open_memory()

    def _open_memory(self) -> DisplayMemory:
        if self._memory is None:
            raise DeviceLost("the virtual projector is closed: open the rig before showing a picture")
        return self._memory

    def show(self, codes: Codes, *, name: str) -> Shown:
        """Show codes of exactly its shape, (H, W) or (H, W, 3)."""
        memory = self._open_memory()
        check_codes(codes, self._shape)
        memory.write(codes)
        return Shown(self._clock.now_s(), name)


class VirtualDisplay:
    """What looks at a virtual projector; black while there is none."""

    def __init__(self, name: str):
        self._name = name
        self._memory: DisplayMemory | None = None

    def open(self) -> None:
        """Nothing to do: it is looked for whenever it is looked at."""

    def close(self) -> None:
        """Let it go; any number of times."""
        if self._memory is not None:
            self._memory.close()
            self._memory = None

    def shape(self) -> tuple[int, int]:
        """(height, width). Raises DeviceLost when there is none."""
        return self._current().shape

    def picture(self) -> Codes:
        """(H, W, 3) codes that are on screen now. Raises DeviceLost when there is none."""
        return self._current().read()

    def _current(self) -> DisplayMemory:
        """The memory of the display that has the name now: it may have been made again."""
        if self._memory is not None and not self._memory.is_current:
            self.close()
        if self._memory is None:
            self._memory = DisplayMemory(self._name)
        return self._memory


def from_profile(settings: ProjectorSettings, clock: Clock) -> VirtualProjector:
    """Make the projector of a profile's table [[projector]], closed: driver ``virtual``."""
    return VirtualProjector(settings.output or "", shape=settings.shape, clock=clock)
