"""Sentences for people: folded at words where somebody reads them on a terminal, whole lines where a program does."""

from __future__ import annotations

import shutil
import sys
import textwrap
from typing import TextIO

_LEAST_WIDTH = 30
"""A narrower terminal folds lines itself: words would be broken anyway."""
_INDENT = "  "


def say(text: str, stream: TextIO | None = None) -> None:
    """Print text, each of its lines folded to the width of a terminal.

    Parameters
    ----------
    text
        Lines of words; what a line begins with (spaces) is kept below it.
    stream
        Default: standard output.
    """
    stream = stream or sys.stdout
    print(folded(text, _width(stream)), file=stream, flush=True)


def folded(text: str, width: int | None) -> str:
    """Return text whose lines are no longer than a width, as far as words allow; None: as it is."""
    if width is None:
        return text
    return "\n".join(_folded_line(line, width) for line in text.split("\n"))


def _folded_line(line: str, width: int) -> str:
    own = line[: len(line) - len(line.lstrip())]
    return textwrap.fill(
        line,
        width,
        subsequent_indent=own + _INDENT,
        break_long_words=False,  # paths and numbers stay whole: they are copied
        break_on_hyphens=False,
        drop_whitespace=True,
    )


def _width(stream: TextIO) -> int | None:
    if not stream.isatty():
        return None
    columns = shutil.get_terminal_size().columns
    return columns if columns >= _LEAST_WIDTH else None
