"""The answer of ``rig bench`` as tables on the terminal."""

from __future__ import annotations

from rig.benchmark.records import BenchResult, Criterion, Point
from rig.terminal import print_table, say

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
    _print_points(answer)
    criteria = [_criterion_row(criterion) for criterion in answer.criteria]
    print_table("Criteria", ("what", "value", "limit", ""), criteria)
    for note in answer.notes:
        say(note)
    here, absent = answer.machine, ", ".join(answer.absent)
    say(f"{here.processor}, {here.processors} processors, {here.threads} threads, {here.system}")
    peers = ", ".join(f"{name} {version}" for name, version in answer.peers.items() if version)
    say(f"peers: {peers}" + (f"; absent: {absent} (pip install --group peers)" if absent else ""))


def _print_points(answer: BenchResult) -> None:
    rows, before = [], None
    for point in answer.points:
        problem = "" if point.problem == before else point.problem
        before = point.problem
        numbers = (point.n or "", duration(point.seconds), _number(point.error), _number(point.peak_mb))
        rows.append((problem, point.method, *map(str, numbers), _further(point)))
    head = ("problem", "method", "N", "time", "error", "peak MB", "further")
    print_table(f"rig bench {answer.bench}", head, rows)


def _further(point: Point) -> str:
    parts = [f"{word} {_number(point.detail[key])}".strip() for key, word in _SHOWN.items() if key in point.detail]
    return ", ".join(parts)


def _criterion_row(criterion: Criterion) -> tuple[str, ...]:
    limit = f"{'≥' if criterion.at_least else '≤'} {_with_unit(criterion.limit, criterion.unit)}"
    return criterion.what, _with_unit(criterion.value, criterion.unit), limit, _verdict(criterion)


def _with_unit(value: float | None, unit: str) -> str:
    return duration(value) if unit == "s" else f"{_number(value)} {unit}".strip()


def _verdict(criterion: Criterion) -> str:
    if criterion.met:
        return "met"
    return "MISSED" if criterion.kind == "accuracy" else "missed"


def duration(seconds: float | None) -> str:
    """Seconds in the unit that leaves few digits."""
    if seconds is None:
        return ""
    return f"{_number(1000 * seconds)} ms" if seconds < 1 else f"{_number(seconds)} s"


def _number(value: object) -> str:
    if isinstance(value, bool) or not isinstance(value, float):
        return "" if value is None else str(value)
    return f"{value:.1e}" if 0 < abs(value) < 1e-3 else f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"
