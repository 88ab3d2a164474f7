"""Ending in order whoever asks for it: Ctrl-C, `kill`, a terminal that is closed."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType, TracebackType
from typing import Any

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Interrupted(KeyboardInterrupt):
    """A signal came while something waited that cannot be asked to stop."""


class EndSignals:
    """Notes signals that ask the process to end, instead of ending it; in a ``with`` statement, in the main thread."""

    def __init__(self) -> None:
        self.received: int | None = None
        """The first signal that came."""
        self._raises = False
        self._before: dict[int, Any] = {}

    def __enter__(self) -> EndSignals:
        self._before = {number: signal.signal(number, self._note) for number in _SIGNALS}
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        outer = getattr(self._before.get(signal.SIGINT), "__self__", None)
        if isinstance(outer, EndSignals) and outer.received is None:
            outer.received = self.received  # who asked this listener to end asked the process, and so the outer one

    @property
    def name(self) -> str:
        """The first signal's name; empty before there was one."""
        return "" if self.received is None else signal.Signals(self.received).name

    def _note(self, number: int, _frame: FrameType | None) -> None:
        is_first = self.received is None
        self.received = number if is_first else self.received
        if self._raises and is_first:
            raise Interrupted

    @contextmanager
    def interrupting(self) -> Iterator[None]:
        """Let the first signal end a long wait by raising Interrupted."""
        if self.received is not None:
            raise Interrupted
        self._raises = True
        try:
            yield
        finally:
            self._raises = False
