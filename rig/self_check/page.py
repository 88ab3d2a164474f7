"""What `rig check` prints, and its page with charts."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path

from rig.errors import UsageError
from rig.profile.apply import AppliedValues
from rig.records import Verdict
from rig.report.links import link_pages
from rig.report.render import rendered
from rig.self_check.figures import check_figures
from rig.self_check.results import SelfCheck
from rig.terminal import print_table, say


def print_check(result: SelfCheck, applied: AppliedValues | None = None) -> None:
    """Value, limit and status of every row; what to do about those that fail; profile values to paste."""
    rows, part = [], ""
    for name, verdict in result.rows:
        shown, part = ("" if name == part else name), name
        rows.append((shown, verdict.what, number(verdict.value), limit_of(verdict), verdict.unit, verdict.status))
    print_table(f"{result.profile}: self-test", ("part", "what", "value", "limit", "unit", "status"), rows)
    transport = result.parts.get("transport")
    remarks = [] if transport is None else [verdict for verdict in transport.verdicts if verdict.value]
    for verdict in (*result.broken, *remarks):
        say(f"{verdict.what}: {verdict.advice}")
    print(f"values for the profile, measured:\n{toml_of(result.suggested)}")
    if applied is not None:
        print(applied.diff or f"{applied.path}: has these values already")
    if result.report is not None:
        print(f"report: {result.report}")


def number(value: float | None) -> str:
    """Four digits; a dash for what was not measured."""
    if value is None:
        return "-"
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value if abs(value) > 1e-6 else 0:.4g}"


def limit_of(verdict: Verdict) -> str:
    """Bound and number; empty for a row without limit."""
    if verdict.limit is None:
        return ""
    return f"{'≥' if verdict.at_least else '≤'} {number(verdict.limit)}"


def toml_of(suggested: Mapping[str, float]) -> str:
    """``table.key`` values as lines of a profile, grouped by table."""
    tables: dict[str, list[str]] = {}
    for name, value in suggested.items():
        table, key = name.split(".")
        tables.setdefault(table, []).append(f"{key} = {value!r}")
    return "\n".join("\n".join([f"[{table}]", *lines]) for table, lines in sorted(tables.items()))


def write_check_page(result: SelfCheck, path: Path) -> Path:
    """Write one self-contained HTML file. Raises UsageError when it cannot be written."""
    rows, broken = result.rows, result.broken
    context = {
        "title": f"Check of {result.profile}",
        "subtitle": f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC; {result.device_s:.0f} s of the rig's time; "
        f"working exposure {1e3 * result.exposure_s:.3f} ms.",
        "met": result.within_limits,
        "verdict": f"{len(rows) - len(broken)} of {len(rows)} rows without objection",
        "rows": [
            {"part": part, "verdict": verdict, "value": number(verdict.value), "limit": limit_of(verdict)}
            for part, verdict in rows
        ],
        "failed": broken,
        "toml": toml_of(result.suggested),
        "figures": check_figures(result),
    }
    try:
        path.write_text(rendered("self_check/check.html", context), encoding="utf-8")
        link_pages(path.parent)
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror}; give a file in a folder that exists") from error
    return path
