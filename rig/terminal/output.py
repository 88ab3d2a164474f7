"""Progress on stderr: one bar at a time, finished steps above it."""

from __future__ import annotations

import time
from collections.abc import Callable
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Column

from rig.terminal.line import in_words

OnStep = Callable[[str, int, int], None]
"""Called with (what is being done, how many are done, of how many)."""
_PACE_AFTER_S = 5.0
"""Before, a step's first part, which loads what the others share, is most of its pace."""
_SAID_EVERY_S = 60.0
"""Where there is no terminal: a line in a log for work that takes long."""
_LEAST_FOR_BAR = 70
"""Columns of a terminal that has room for a bar beside the words."""


def silent(label: str, done: int, total: int) -> None:
    """Progress for callers that want none."""


def time_left(done: int, left: int, began_s: float) -> str:
    """Return about how long the rest takes, at the pace so far, as people say it; nothing while that is a guess.

    Parameters
    ----------
    done
        Parts since it began.
    left
        Parts that are not done.
    began_s
        When, by :func:`time.monotonic`.
    """
    passed_s = time.monotonic() - began_s
    return in_words(passed_s * left / done) if done > 0 and left > 0 and passed_s > _PACE_AFTER_S else ""


def part_of(on_step: OnStep, before: int, total: int) -> OnStep:
    """Return progress for a part of a step, so that the whole step has one count.

    Parameters
    ----------
    on_step
        Of the whole step.
    before
        How many were to be done in the parts before.
    total
        How many are to be done in all parts.
    """
    return lambda label, done, _: on_step(label, before + done, total)


def in_percent(label: str, on_step: OnStep) -> Callable[[float], None]:
    """Return what a computation tells the share to that it has done, shown as percent of a step."""
    return lambda share: on_step(label, int(100 * share), 100)


class TerminalProgress:
    """A bar on stderr while a step is at work, a line for each that is finished; plain lines without a terminal.

    The first line is there at once, before anything heavy is imported. A bar never goes backwards.
    """

    def __init__(self) -> None:
        self._console = Console(stderr=True)
        # One line, whatever the width: a bar that wraps would be drawn over what stands above it.
        columns = (
            SpinnerColumn(finished_text=" "),
            TextColumn("{task.description}", table_column=Column(no_wrap=True, overflow="ellipsis", ratio=2)),
            *([BarColumn(bar_width=None, table_column=Column(ratio=2))] if self._has_room else []),
            TextColumn("{task.fields[count]}", justify="right", table_column=Column(no_wrap=True)),
            TimeElapsedColumn(),
        )
        self._progress = Progress(*columns, console=self._console, transient=True, expand=True)
        self._task: TaskID | None = None
        self._label = ""
        self._done, self._total = 0, 1
        self._began_s = self._said_s = 0.0
        self._done_at_first: int | None = None

    @property
    def _has_room(self) -> bool:
        return self._console.width >= _LEAST_FOR_BAR

    def __enter__(self) -> TerminalProgress:
        if self._console.is_terminal:
            self._progress.start()
        self("start", 0, 0)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._finish_line()
        if self._console.is_terminal:
            self._progress.stop()

    def __call__(self, label: str, done: int, total: int) -> None:
        """Show that `done` of `total` parts of the step `label` are there."""
        if label != self._label:
            self._finish_line()
            self._begin(label)
        if done * self._total >= self._done * total:  # a step may learn how much it has to do
            self._done, self._total = done, total
        self._done_at_first = self._done if self._done_at_first is None else self._done_at_first
        if self._task is not None:
            self._progress.update(self._task, completed=self._done, total=self._total or None, count=self._count())
        elif label != "start" and time.monotonic() - self._said_s > _SAID_EVERY_S:
            self._said_s = time.monotonic()
            self._print(f"{label}: {self._count()}")

    def _begin(self, label: str) -> None:
        self._label, self._done, self._total = label, 0, 1
        self._began_s = self._said_s = time.monotonic()
        self._done_at_first = None
        if self._console.is_terminal:
            self._task = self._progress.add_task(label, total=None, count="")
        elif label == "start":
            self._print("starting")

    def _finish_line(self) -> None:
        """Leave a line behind for the step that was at work."""
        if self._task is not None:
            self._progress.remove_task(self._task)
            self._task = None
        if self._label in ("", "start"):
            return
        seconds = f"  {time.monotonic() - self._began_s:.1f} s" if self._console.is_terminal else ""
        self._print(f"{self._label}: {self._done} of {self._total} done{seconds}")
        self._label = ""

    def _count(self) -> str:
        left = time_left(self._done - (self._done_at_first or 0), self._total - self._done, self._began_s)
        return f"{self._done}/{self._total}{f', {left} left' if left else ''}" if self._total else ""

    def _print(self, line: str) -> None:
        self._console.print(line, highlight=False, markup=False, soft_wrap=True)
