"""Hands pictures to the projector: in the caller's thread, or in one of its own while the next is computed."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import Protocol

from rig.devices.protocols import Projector, Shown, check_on_screen
from rig.live.sources.source import Pixels

_NAME = "live"


class Output(Protocol):
    """One picture at a time on its way to the screen."""

    @property
    def is_concurrent(self) -> bool:
        """Whether it shows while the caller does something else."""
        ...

    def start(self, codes: Pixels, *, check: bool) -> None:
        """Begin to show (H, W, 3) codes, which stay as they are until :meth:`finish`.

        ``check``: ask first whether the picture before is still on screen.
        """
        ...

    def finish(self) -> Shown:
        """Wait until what was started is on screen. Raises what the projector's ``show`` raises."""
        ...


class DirectOutput:
    """Shows in the caller's thread, which waits."""

    is_concurrent = False

    def __init__(self, projector: Projector):
        self._projector = projector
        self._show: Callable[[], Shown] | None = None

    def start(self, codes: Pixels, *, check: bool) -> None:
        """Keep the codes."""
        self._show = partial(_shown, self._projector, codes, check)

    def finish(self) -> Shown:
        """Show them."""
        if self._show is None:
            raise RuntimeError("nothing was started")
        return self._show()


class ThreadedOutput:
    """Shows in a thread of its own; to be closed."""

    is_concurrent = True

    def __init__(self, projector: Projector):
        self._projector = projector
        self._thread = ThreadPoolExecutor(1, "live output")
        self._shown: Future[Shown] | None = None

    def start(self, codes: Pixels, *, check: bool) -> None:
        """Let the thread show the codes."""
        self._shown = self._thread.submit(_shown, self._projector, codes, check)

    def finish(self) -> Shown:
        """Wait for the thread."""
        if self._shown is None:
            raise RuntimeError("nothing was started")
        return self._shown.result()

    def close(self) -> None:
        """Wait until what was started is on screen, or has failed, and end the thread."""
        self._thread.shutdown()


def _shown(projector: Projector, codes: Pixels, check: bool) -> Shown:
    if check:
        check_on_screen(projector)
    return projector.show(codes, name=_NAME)
