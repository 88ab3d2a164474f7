"""The page of a study, its table for spreadsheets, and what the terminal shows."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from rig.errors import UsageError
from rig.files.atomic import write_bytes
from rig.records import Json
from rig.report.render import Headline, TextTable, rendered
from rig.sweeps.columns import Columns
from rig.sweeps.figures import SweepChart, charts_of
from rig.sweeps.records import FigureSpread, PointLine, SweepResult
from rig.sweeps.study import StudyPage
from rig.terminal import print_table, say
from rig.terminal.line import counted
from rig.version import __version__

_ROWS = 100
"""Of the page's table of points; all are in points.csv."""
_SPREAD_HEAD = ("figure", "points", "min", "10 %", "median", "90 %", "max")


@dataclass(frozen=True, kw_only=True)
class _SweepPage:
    """What the template shows."""

    title: str
    subtitle: str
    met: bool
    word: str
    verdict: str
    headline: Sequence[Headline]
    warnings: Sequence[str]
    charts: Sequence[SweepChart]
    spreads: TextTable
    points: TextTable
    points_text: str
    failures: TextTable | None
    footer: str


def sweep_page(path: Path, result: SweepResult, wishes: StudyPage, columns: Columns) -> None:
    """Write the study's page, one self-contained HTML file.

    Raises
    ------
    UsageError
        The study wants a figure on its page that no point has.
    SessionError
        The disk refuses.
    """
    _check_wishes(wishes, columns)
    failed = result.refused + result.killed
    page = _SweepPage(
        title=result.title,
        subtitle=f"Study of {result.subject}, version {result.version}; folder {result.folder}.",
        met=failed == 0 and result.left == 0,
        word=f"{result.points - result.left - failed} of {counted(result.points, 'point')}",
        verdict=f"{result.refused} refused, {result.killed} lost their workers, {result.left} not computed yet",
        headline=[Headline(f"{sum(_seconds(columns)):.0f}", "s", "of processor time in all points")],
        warnings=result.warnings,
        charts=charts_of(columns, wishes),
        spreads=TextTable(_SPREAD_HEAD, [_spread_row(spread) for spread in result.spreads]),
        points=_points_table(columns),
        points_text=f"The first {min(_ROWS, len(columns.ids))} of {len(columns.ids)}; all of them, with all their "
        "inputs, are in points.csv.",
        failures=_failures_table(result.failures) if result.failures else None,
        footer=f"Written {datetime.now(UTC):%Y-%m-%d %H:%M} UTC by procam-rig {__version__}.",
    )
    write_bytes(path, rendered("sweeps/sweep.html", page).encode())


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
    rows = [
        (one.figure, one.points, one.min, one.tenth, one.median, one.ninetieth, one.max) for one in result.spreads
    ]
    print_table(result.title, _SPREAD_HEAD, rows)
    for line in result.failures:
        say(f"{line.status}: {_words(line.inputs)}: {line.error}")
    for text in result.warnings:
        say(f"note: {text}")
    say(
        f"{counted(result.points, 'point')}: {result.computed_now} computed now, {result.computed_before} before; "
        f"{result.refused} refused, {result.killed} lost their workers"
    )
    print(f"table: {result.table}")
    print(f"page: {result.report}")


def _check_wishes(wishes: StudyPage, columns: Columns) -> None:
    unknown = [name for name in wishes.figures if name not in columns.figures]
    unknown += [name for name in wishes.against if name not in columns.inputs]
    if unknown and columns.ids:
        raise UsageError(
            f"[page]: no point has {', '.join(unknown)}; figures are {', '.join(columns.figures)}, inputs "
            f"{', '.join(columns.inputs)}. All points are kept: correct [page] and run the same command again"
        )


def _seconds(columns: Columns) -> list[float]:
    return [float(cell) for cell in columns.outcome["seconds"] if isinstance(cell, int | float)]


def _spread_row(spread: FigureSpread) -> list[str]:
    numbers = (spread.min, spread.tenth, spread.median, spread.ninetieth, spread.max)
    return [spread.figure, str(spread.points), *(_cell(number) for number in numbers)]


def _points_table(columns: Columns) -> TextTable:
    shown = {name: columns.inputs[name] for name in columns.varied()} | dict(columns.figures)
    rows = [
        [columns.ids[k][:8], *(_cell(cells[k]) for cells in shown.values())] for k in range(min(_ROWS, len(columns.ids)))
    ]
    return TextTable(["point", *shown], rows)


def _failures_table(failures: Sequence[PointLine]) -> TextTable:
    rows = [[line.id[:8], line.status, str(line.tries), line.error or "", _words(line.inputs)] for line in failures]
    return TextTable(["point", "what", "tries", "why", "inputs"], rows)


def _words(inputs: dict[str, Json]) -> str:
    return ", ".join(f"{name} {_cell(value)}" for name, value in inputs.items())


def _cell(value: Json) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list):
        return " ".join(_cell(one) for one in value)
    return "" if value is None else str(value)
