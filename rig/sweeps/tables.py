"""A study's points as a table for spreadsheets, and what the terminal shows; draws nothing."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from pathlib import Path

from rig.files.atomic import write_bytes
from rig.records import Json
from rig.sweeps.columns import Columns
from rig.sweeps.records import SweepResult
from rig.terminal import print_table, say
from rig.terminal.line import counted

_SHOWN = 12
"""Figures in the terminal's table: those that [page] names come first."""
SPREAD_HEAD = ("figure", "points", "min", "10 %", "median", "90 %", "max")


def write_table(path: Path, columns: Columns) -> None:
    """Write all points as CSV, a row each; raises SessionError when the disk refuses."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    values = columns.values
    writer.writerow(["point", *values])
    writer.writerows(zip(columns.ids, *values.values(), strict=True))
    write_bytes(path, text.getvalue().encode())


def print_sweep(result: SweepResult) -> None:
    """Print how the figures are distributed, what failed, and where everything lies."""
    shown = result.spreads[:_SHOWN]
    rows = [(one.figure, one.points, one.min, one.tenth, one.median, one.ninetieth, one.max) for one in shown]
    print_table(result.title, SPREAD_HEAD, rows)
    if len(result.spreads) > len(shown):
        say(f"{len(result.spreads) - len(shown)} more figures are on the page and in the table")
    for line in result.failures:
        say(f"{line.status}: {words_of(line.inputs)}: {line.error}")
    for text in result.warnings:
        say(f"note: {text}")
    say(
        f"{counted(result.points, 'point')}: {result.computed_now} computed now, {result.computed_before} before; "
        f"{result.refused} refused, {result.killed} lost their workers"
    )
    print(f"table: {result.table}")
    print(f"page: {result.report}")


def words_of(inputs: Mapping[str, Json]) -> str:
    """Return inputs in one line."""
    return ", ".join(f"{name} {cell_of(value)}" for name, value in inputs.items())


def cell_of(value: Json) -> str:
    """Return a value as a table shows it."""
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list):
        return " ".join(cell_of(one) for one in value)
    return "" if value is None else str(value)
