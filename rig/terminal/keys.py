"""Keys as they are pressed, without waiting for them; the terminal is left as it was."""

from __future__ import annotations

import os
import select
import sys
import termios
import tty
from pathlib import Path
from types import TracebackType
from typing import Any

_TERMINAL = Path("/dev/tty")
_MOST_KEYS = 64


class Keyboard:
    """The terminal's keys; none where there is no terminal. Use it in a ``with`` statement.

    Parameters
    ----------
    descriptor
        Of a terminal; default: standard input, or the controlling terminal when that is a pipe.
    """

    def __init__(self, descriptor: int | None = None):
        self._given = descriptor
        self._descriptor: int | None = None
        self._own: int | None = None
        self._before: list[Any] = []

    def __enter__(self) -> Keyboard:
        self._descriptor = self._terminal()
        if self._descriptor is not None:
            self._before = termios.tcgetattr(self._descriptor)
            tty.setcbreak(self._descriptor, termios.TCSADRAIN)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._descriptor is not None:
            termios.tcsetattr(self._descriptor, termios.TCSADRAIN, self._before)
            self._descriptor = None
        if self._own is not None:
            os.close(self._own)
            self._own = None

    def _terminal(self) -> int | None:
        """A terminal that this process may read without being stopped for it."""
        if self._given is not None:
            return self._given
        descriptor = 0 if sys.stdin is not None and os.isatty(0) else self._controlling()
        if descriptor is None or os.tcgetpgrp(descriptor) != os.getpgrp():
            return None
        return descriptor

    def _controlling(self) -> int | None:
        try:
            self._own = os.open(_TERMINAL, os.O_RDONLY | os.O_NOCTTY)
        except OSError:
            return None
        return self._own

    def pressed(self) -> str:
        """Keys since the last call, a character each."""
        if self._descriptor is None or not select.select([self._descriptor], [], [], 0)[0]:
            return ""
        try:
            data = os.read(self._descriptor, _MOST_KEYS)
        except OSError:  # the terminal was closed
            data = b""
        if not data:
            self._descriptor = None
        return data.decode(errors="ignore").lower()
