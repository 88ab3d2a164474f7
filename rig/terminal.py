"""What people see on a terminal: progress on stderr, tables on stdout."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from types import TracebackType

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table

OnStep = Callable[[str, int, int], None]
"""Called with (what is being done, how many are done, of how many)."""


def silent(label: str, done: int, total: int) -> None:
    """Progress for callers that want none."""


class TerminalProgress:
    """A bar a step on stderr; plain lines when stderr is not a terminal."""

    def __init__(self) -> None:
        self._console = Console(stderr=True)
        columns = (
            TextColumn("{task.description:<34}"),
            BarColumn(bar_width=32),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
        )
        self._progress = Progress(*columns, console=self._console)
        self._tasks: dict[str, TaskID] = {}
        self._line = ""
        """What is to be printed when the next step begins: a step may grow while it runs."""

    def __enter__(self) -> TerminalProgress:
        if self._console.is_terminal:
            self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._console.is_terminal:
            self._progress.stop()
        elif self._line:
            self._console.out(self._line, highlight=False)

    def __call__(self, label: str, done: int, total: int) -> None:
        """Show that `done` of `total` parts of the step `label` are there."""
        if not self._console.is_terminal:
            if self._line and not self._line.startswith(f"{label}: "):
                self._console.out(self._line, highlight=False)
            self._line = f"{label}: {done} of {total} done"
            return
        if label not in self._tasks:
            self._tasks[label] = self._progress.add_task(label, total=total)
        self._progress.update(self._tasks[label], completed=done, total=total)


def print_table(title: str, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """A table on stdout; numbers to the right."""
    table = Table(title=escape(title), title_justify="left")
    for k, column in enumerate(columns):
        table.add_column(escape(column), justify="left" if k == 0 else "right", overflow="fold")
    for row in rows:
        table.add_row(*(_text(cell) for cell in row))
    Console().print(table)


def _text(cell: object) -> str:
    if isinstance(cell, float):
        return f"{cell:.3g}" if 0 < abs(cell) < 0.1 else f"{cell:.2f}"
    return "" if cell is None else escape(str(cell))
