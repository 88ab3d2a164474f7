"""Bars of characters, and one line that is written over."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from types import TracebackType

from rich.console import Console


def bar(share: float, length: int) -> str:
    """Return a bar of at most so many characters for a share 0 … 1."""
    return "█" * round(length * min(max(share, 0.0), 1.0))


def counted(number: int, noun: str, plural: str = "") -> str:
    """Return a number with its noun: ``1 event``, ``2 events``."""
    return f"{number} {noun if number == 1 else plural or noun + 's'}"


def first_of(items: Sequence[str], most: int) -> list[str]:
    """Return the first of what is to be listed, and where there is more, how much, as the last."""
    more = [f"… and {len(items) - most} more"] if len(items) > most else []
    return [*items[:most], *more]


def in_words(seconds: float) -> str:
    """Return a time as people say it: no finer than it is known."""
    if seconds < 45:
        return "less than a minute"
    minutes = round(seconds / 60)
    if minutes < 90:
        return f"about {max(minutes, 1)} min"
    return f"about {minutes / 60:.1f} h"


class OverwrittenLine:
    """A line on stderr that each next one replaces; where stderr is no terminal, only lines that are not the last."""

    def __init__(self) -> None:
        self._console = Console(stderr=True)
        self._is_written = False
        self._last = ""

    def __enter__(self) -> OverwrittenLine:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._is_written:
            print(file=sys.stderr, flush=True)

    def __call__(self, line: str) -> None:
        """Show a line, cut to the terminal's width."""
        if not self._console.is_terminal:
            if line != self._last:
                print(line, file=sys.stderr, flush=True)
            self._last = line
            return
        self._is_written = True
        print(f"\r\x1b[2K{line[: self._console.width - 1]}", end="", file=sys.stderr, flush=True)
