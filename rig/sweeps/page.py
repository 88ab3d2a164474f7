"""The page of a study."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from rig.errors import UsageError
from rig.files.atomic import write_bytes
from rig.report.render import Headline, TextTable, rendered
from rig.sweeps.columns import Columns
from rig.sweeps.figures import SweepChart, charts_of
from rig.sweeps.records import FigureSpread, PointLine, SweepResult
from rig.sweeps.study import StudyPage
from rig.sweeps.tables import SPREAD_HEAD, cell_of, words_of
from rig.terminal.line import counted
from rig.version import __version__

_ROWS = 100
"""Of the page's table of points; all are in points.csv."""


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
        spreads=TextTable(SPREAD_HEAD, [_spread_row(spread) for spread in result.spreads]),
        points=_points_table(columns),
        points_text=f"The first {min(_ROWS, len(columns.ids))} of {len(columns.ids)}; all of them, with all their "
        "inputs, are in points.csv.",
        failures=_failures_table(result.failures) if result.failures else None,
        footer=f"Written {datetime.now(UTC):%Y-%m-%d %H:%M} UTC by procam-rig {__version__}.",
    )
    write_bytes(path, rendered("sweeps/sweep.html", page).encode())


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
    return [spread.figure, str(spread.points), *(cell_of(number) for number in numbers)]


def _points_table(columns: Columns) -> TextTable:
    shown = {name: columns.inputs[name] for name in columns.varied()} | dict(columns.figures)
    rows = [
        [point[:8], *(cell_of(cells[k]) for cells in shown.values())] for k, point in enumerate(columns.ids[:_ROWS])
    ]
    return TextTable(["point", *shown], rows)


def _failures_table(failures: Sequence[PointLine]) -> TextTable:
    rows = [[line.id[:8], line.status, str(line.tries), line.error or "", words_of(line.inputs)] for line in failures]
    return TextTable(["point", "what", "tries", "why", "inputs"], rows)
