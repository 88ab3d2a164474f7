"""The answer of ``rig bench`` as tables on the terminal."""

from __future__ import annotations

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from rig.benchmark.records import BenchResult, Criterion, Point

_WIDTH = 118
_SHOWN = {
    "samples": "samples",
    "threads": "threads",
    "matvecs": "products",
    "closure_max": "closure",
    "row_sum_error": "row sums",
    "bias": "bias",
    "gave_up": "",
    "valid": "valid",
    "wrong": "wrong",
    "sigmas": "sigmas",
}
"""Further numbers of a point that the table has room for."""


def print_bench(answer: BenchResult) -> None:
    """Points, criteria met and missed, and what the numbers were measured on."""
    console = Console(width=max(Console().width, _WIDTH), highlight=False)
    console.print(_points(answer))
    console.print(_criteria(answer))
    for note in answer.notes:
        console.print(escape(note))
    here, absent = answer.machine, ", ".join(answer.absent)
    console.print(f"{here.processor}, {here.processors} processors, {here.threads} threads, {here.system}")
    peers = ", ".join(f"{name} {version}" for name, version in answer.peers.items() if version)
    console.print(f"peers: {peers}" + (f"; absent: {absent} (pip install --group peers)" if absent else ""))


def _points(answer: BenchResult) -> Table:
    table = Table(title=f"rig bench {answer.bench}", title_justify="left", box=SIMPLE_HEAD)
    for heading in ("problem", "method"):
        table.add_column(heading)
    for heading in ("N", "time", "error", "peak MB"):
        table.add_column(heading, justify="right")
    table.add_column("further")
    before = None
    for point in answer.points:
        if before is not None and point.problem != before:
            table.add_section()
        problem = "" if point.problem == before else escape(point.problem)
        before = point.problem
        numbers = (point.n or "", duration(point.seconds), _number(point.error), _number(point.peak_mb))
        table.add_row(problem, escape(point.method), *map(str, numbers), _further(point))
    return table


def _further(point: Point) -> str:
    parts = [f"{word} {_number(point.detail[key])}".strip() for key, word in _SHOWN.items() if key in point.detail]
    return escape(", ".join(parts))


def _criteria(answer: BenchResult) -> Table:
    table = Table(title="Criteria", title_justify="left", box=SIMPLE_HEAD)
    table.add_column("what")
    for heading in ("value", "limit", ""):
        table.add_column(heading, justify="right")
    for criterion in answer.criteria:
        sign = "≥" if criterion.at_least else "≤"
        limit = f"{sign} {_with_unit(criterion.limit, criterion.unit)}"
        table.add_row(escape(criterion.what), _with_unit(criterion.value, criterion.unit), limit, _verdict(criterion))
    return table


def _with_unit(value: float | None, unit: str) -> str:
    return duration(value) if unit == "s" else f"{_number(value)} {unit}".strip()


def _verdict(criterion: Criterion) -> str:
    if criterion.met:
        return "met"
    return "[red]MISSED[/red]" if criterion.kind == "accuracy" else "missed"


def duration(seconds: float | None) -> str:
    """Seconds in the unit that leaves few digits."""
    if seconds is None:
        return ""
    return f"{_number(1000 * seconds)} ms" if seconds < 1 else f"{_number(seconds)} s"


def _number(value: object) -> str:
    if isinstance(value, bool) or not isinstance(value, float):
        return "" if value is None else str(value)
    return f"{value:.1e}" if 0 < abs(value) < 1e-3 else f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"
