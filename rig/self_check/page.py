"""What `rig check` prints, and its page with charts."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from rig.errors import UsageError
from rig.report.render import rendered
from rig.self_check.figures import check_figures

_WIDTH = 116


def print_check(result: Mapping[str, Any]) -> None:
    """Value, limit and verdict of every row; what to do about those that fail; profile values to paste."""
    table = Table(title=escape(f"{result['profile']}: self-test"), title_justify="left")
    for name, side in (("part", "left"), ("what", "left"), ("value", "right"), ("limit", "right"), ("unit", "left")):
        table.add_column(name, justify="left" if side == "left" else "right", overflow="fold")
    table.add_column("verdict")
    part = ""
    for row in result["checks"]:
        table.add_section() if row["part"] != part else None
        shown_part, part = ("" if row["part"] == part else row["part"]), row["part"]
        cells = (shown_part, row["what"], number(row["value"]), limit_of(row), row["unit"], row["verdict"])
        table.add_row(*map(escape, cells), style="" if row["passed"] else "bold")
    console = Console()
    Console(width=max(console.width, _WIDTH)).print(table)
    for row in failures(result):
        print(f"{row['what']}: {row['advice']}")
    print(f"values for the profile, measured:\n{toml_of(result['suggested'])}")
    if "report" in result:
        print(f"report: {result['report']}")


def number(value: float | None) -> str:
    """Four digits; a dash for what was not measured."""
    if value is None:
        return "-"
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value if abs(value) > 1e-6 else 0:.4g}"


def limit_of(row: Mapping[str, Any]) -> str:
    """Bound and number; empty for a row without verdict."""
    if row["limit"] is None:
        return ""
    return f"{'≥' if row['at_least'] else '≤'} {number(row['limit'])}"


def failures(result: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Rows outside their limits."""
    return [row for row in result["checks"] if not row["passed"]]


def toml_of(suggested: Mapping[str, Any]) -> str:
    """``table.key`` values as lines of a profile, grouped by table."""
    tables: dict[str, list[str]] = {}
    for name, value in suggested.items():
        table, key = name.split(".")
        tables.setdefault(table, []).append(f"{key} = {value!r}")
    return "\n".join("\n".join([f"[{table}]", *lines]) for table, lines in sorted(tables.items()))


def write_check_page(result: Mapping[str, Any], path: Path) -> Path:
    """Write one self-contained HTML file. Raises UsageError when it cannot be written."""
    failed = len(failures(result))
    context = {
        "title": f"Check of {result['profile']}",
        "subtitle": f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC; {result['device_s']:.0f} s of the rig's time; "
        f"working exposure {1e3 * result['exposure_s']:.3f} ms.",
        "passed": result["within_limits"],
        "verdict": f"{len(result['checks']) - failed} of {len(result['checks'])} rows without objection",
        "rows": [
            {**row, "value": number(row["value"]), "limit": limit_of(row), "failed": not row["passed"]}
            for row in result["checks"]
        ],
        "failures": failures(result),
        "toml": toml_of(result["suggested"]),
        "figures": check_figures(result["numbers"]),
    }
    try:
        path.write_text(rendered("self_check/check.html", context), encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror}; give a file in a folder that exists") from error
    return path
