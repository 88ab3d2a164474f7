"""Tables on stdout that fold to the terminal's width: words stay whole, and columns that do not fit go below."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from rich import box
from rich.cells import cell_len
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from rig.terminal.sentences import say

_FRAME, _BETWEEN = 4, 3
"""Characters that a table's two edges take, and each line between two columns."""
_LEAST_TEXT = 12
"""Width to which a column of words may shrink before others go below, if its longest word allows it."""

_BEGINS_NUMBER = "+-−.≤≥*"


@dataclass(frozen=True, slots=True)
class _Column:
    """One column: its cells as text, and how wide it may become."""

    cells: tuple[str, ...]
    """The head is the first."""
    is_text: bool

    @property
    def natural(self) -> int:
        return max(cell_len(cell) for cell in self.cells)

    @property
    def least(self) -> int:
        """Of the longest word: numbers and words are never broken."""
        words = [word for cell in self.cells for word in cell.split()]
        longest = max((cell_len(word) for word in words), default=1)
        return max(longest, min(_LEAST_TEXT, self.natural)) if self.is_text else longest


def print_table(title: str, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Print a table on stdout, numbers to the right, words to the left; as wide as the terminal at most.

    Where the columns do not fit beside each other even with their words below each other, the later ones follow in a
    table of their own, with the columns repeated that name a row: the first, and the second where the first alone does
    not tell rows apart.

    Parameters
    ----------
    title
        Above it.
    columns
        Their heads.
    rows
        Cells: numbers, words, None for an empty one.
    """
    console = Console()
    texts = [list(columns), *([_text(cell) for cell in row] for row in rows)]
    made = [_column([row[k] for row in texts], is_first=k == 0) for k in range(len(columns))]
    say(title)  # not the table's own: that would be folded to the table's width
    for group in _groups(made, console.width):
        console.print(_table(group, console.width))


def _column(cells: Sequence[str], *, is_first: bool) -> _Column:
    """The first column names its row; another is of words where no cell begins as a number does."""
    numbers = any(cell[:1].isdigit() or cell[:1] in _BEGINS_NUMBER for cell in cells[1:] if cell)
    return _Column(tuple(cells), is_first or not numbers)


def _groups(columns: Sequence[_Column], width: int) -> list[list[_Column]]:
    """Columns that fit beside each other, those that name a row in each group."""
    names, others = _names(columns)
    groups, left = [list(names)], _left(names, width)
    for column in others:
        if column.least + _BETWEEN > left and len(groups[-1]) > len(names):
            groups.append(list(names))
            left = _left(names, width)
        groups[-1].append(column)
        left -= column.least + _BETWEEN
    return groups


def _names(columns: Sequence[_Column]) -> tuple[Sequence[_Column], Sequence[_Column]]:
    """The columns that name a row, and the others."""
    first = columns[0].cells[1:]
    alike = "" in first or len(set(first)) < len(first)
    count = 2 if alike and len(columns) > 2 else 1
    return columns[:count], columns[count:]


def _left(names: Sequence[_Column], width: int) -> int:
    return width - _FRAME + _BETWEEN - sum(column.least + _BETWEEN for column in names)


def _widths(columns: Sequence[_Column], width: int) -> list[int]:
    """Natural widths, the widest made narrower until all fit, none below its longest word."""
    widths = [column.natural for column in columns]
    available = width - _FRAME - _BETWEEN * (len(columns) - 1)
    while sum(widths) > available:
        able = [k for k, column in enumerate(columns) if widths[k] > column.least]
        if not able:
            break
        widths[max(able, key=lambda k: widths[k])] -= 1
    return widths


def _table(columns: Sequence[_Column], width: int) -> Table:
    table = Table(box=box.SQUARE)
    for column, wide in zip(columns, _widths(columns, width), strict=True):
        justify = "left" if column.is_text else "right"
        table.add_column(escape(column.cells[0]), justify=justify, overflow="fold", width=wide)  # type: ignore[arg-type]
    for cells in zip(*(column.cells[1:] for column in columns), strict=True):
        table.add_row(*map(escape, cells))
    return table


def _text(cell: object) -> str:
    if isinstance(cell, float):
        return f"{cell:.3g}" if 0 < abs(cell) < 0.1 else f"{cell:.2f}"
    return "" if cell is None else str(cell)
