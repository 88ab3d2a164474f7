"""Work against precision, the pages of docs/benchmarks: python benchmarks/work_precision.py [NAME ...].

Runs the benches of ``rig bench`` (all without a name) and writes NAME.csv, NAME.svg and their part of index.md.
"""

from __future__ import annotations

import argparse
import math
import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("svg")
os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # as the command ``rig`` does, before the kernel is loaded

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter

from rig.benchmark import BENCHES, run_bench
from rig.benchmark.tables import duration

Record = Mapping[str, Any]
FOLDER = Path(__file__).parents[1] / "docs" / "benchmarks"
STYLE = {
    "svg.hashsalt": "procam-rig",
    "svg.fonttype": "none",
    "font.size": 8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
}
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#444444", "#7a5195", "#8c564b", "#999933")
NARROW = 3.0
"""Errors within this factor are drawn on a linear axis."""
FLOOR = 1e-17
"""Errors below are drawn here: a logarithm has no 0."""


@dataclass(frozen=True)
class Drawing:
    """How the points of a bench become panels."""

    panel: Callable[[Record], str | None]
    """Title of the panel that a point belongs to; none: it is not drawn."""
    series: Callable[[Record], str]
    """Points of one series are joined and share a colour."""
    label: Callable[[Record], str]
    """What is written at a point."""
    error: str
    size: tuple[float, float] = (3.6, 2.9)
    """Of a panel, inches."""
    columns: tuple[str, ...] = ()
    """Of a table of all points; none: no table."""


def _room_or_problem(point: Record) -> str | None:
    if point["problem"] == "threads":
        return None
    return f"{point['problem']}, N = {point['n']}"


def _one_size(point: Record) -> str | None:
    return f"{point['problem'].removeprefix('solve, ')}, N = {point['n']}" if point["n"] <= 2304 else None


DRAWINGS: Mapping[str, Drawing] = {
    "form-factors": Drawing(_room_or_problem, lambda p: p["method"], lambda p: p["method"], "relative error"),
    "solve": Drawing(_one_size, lambda p: p["method"], lambda p: p["method"], "error / largest radiosity"),
    "image": Drawing(
        lambda p: p["problem"],
        lambda p: p["method"],
        lambda p: f"{p['method']}, {p['pitch_m']:g} m" if "pitch_m" in p else p["method"],
        "relative rms of blocks (Mitsuba: of pixels)",
    ),
    "plan": Drawing(
        lambda p: p["problem"], lambda p: p["problem"], lambda p: f"{p['tolerance']:g} %, {p['n']}", "error, % of white"
    ),
    "compensate": Drawing(
        panel=lambda p: p["problem"] if p["problem"].startswith("reference") else None,
        series=lambda p: p["method"],
        label=lambda p: p["method"].replace("_", " "),
        error="mean error, grey levels",
        size=(5.2, 4.4),
    ),
    "decode": Drawing(
        panel=lambda p: p["problem"] if p["problem"].startswith("closed room") else None,
        series=lambda p: p["method"],
        label=lambda p: p["method"],
        error="median error, projector px",
        columns=("images", "ms", "valid", "error", "wrong"),
    ),
    "live": Drawing(lambda p: p["problem"], lambda p: p["method"], lambda p: p["method"], "rms error, grey levels"),
}


def draw(answer: Mapping[str, Any], file: Path) -> None:
    """Error against seconds, a panel a problem, each point labelled."""
    drawing = DRAWINGS[answer["bench"]]
    drawn = [p for p in answer["points"] if p["seconds"] and p["error"] is not None and drawing.panel(p)]
    panels = list(dict.fromkeys(drawing.panel(point) for point in drawn))
    if not panels:
        return
    columns = min(len(panels), 2 if len(panels) in (2, 4) else 3)
    rows = math.ceil(len(panels) / columns)
    with plt.rc_context(STYLE):
        width, height = drawing.size
        size = (width * columns, height * rows) if columns > 1 else (6.0, 4.0)
        figure, axes = plt.subplots(rows, columns, figsize=size, squeeze=False, layout="constrained")
        for place in axes.flat[len(panels) :]:
            place.set_visible(False)
        for place, title in zip(axes.flat, panels, strict=False):
            _panel(place, str(title), drawing, [p for p in drawn if drawing.panel(p) == title])
        for place in axes[:, 0]:
            place.set_ylabel(drawing.error)
        for place in axes[-1]:
            place.set_xlabel("seconds")
        figure.savefig(file, metadata={"Date": None, "Creator": None})
        plt.close(figure)


def _panel(axes: Axes, title: str, drawing: Drawing, points: list[Record]) -> None:
    series = list(dict.fromkeys(map(drawing.series, points)))
    for number, name in enumerate(series):
        here = sorted((p for p in points if drawing.series(p) == name), key=lambda p: p["seconds"])
        x, y = [p["seconds"] for p in here], [max(p["error"], FLOOR) for p in here]
        axes.plot(x, y, marker="o", markersize=4, linewidth=1, color=COLOURS[number % len(COLOURS)])
    errors = [max(p["error"], FLOOR) for p in points]
    scales = {"x": "log", "y": "log" if max(errors) > NARROW * min(errors) else "linear"}
    axes.set(xscale=scales["x"], yscale=scales["y"], title=title)
    for name, axis in (("x", axes.xaxis), ("y", axes.yaxis)):
        if scales[name] == "log":
            axis.set_major_locator(LogLocator(numticks=7))
            axis.set_minor_formatter(NullFormatter())
    axes.margins(x=0.12, y=0.15)
    axes.grid(color="#dddddd", linewidth=0.5)
    axes.set_axisbelow(True)
    _label(axes, drawing, points, {name: COLOURS[k % len(COLOURS)] for k, name in enumerate(series)})


def _label(axes: Axes, drawing: Drawing, points: list[Record], colours: Mapping[str, str]) -> None:
    """Write each label on the side with more room, moved down past those that are written already."""
    axes.figure.draw_without_rendering()
    to_screen = axes.transData.transform
    left, right = axes.bbox.x0, axes.bbox.x1
    taken: list[tuple[float, float, float]] = []
    for point in sorted(points, key=lambda p: -p["error"]):
        x, y = to_screen((point["seconds"], max(point["error"], FLOOR)))
        text, before = drawing.label(point), x > (left + right) / 2
        width = 4.2 * len(text) * axes.figure.dpi / 72
        start = x - width if before else x
        low = y
        while any(abs(low - other) < 12 and start < end and begin < start + width for begin, end, other in taken):
            low -= 3
        taken.append((start, start + width, low))
        offset = ((-5 if before else 5), (low - y) * 72 / axes.figure.dpi)
        axes.annotate(
            text,
            (point["seconds"], max(point["error"], FLOOR)),
            offset,
            textcoords="offset points",
            ha="right" if before else "left",
            va="center",
            fontsize=7,
            color=colours[drawing.series(point)],
        )


def page_part(answer: Mapping[str, Any]) -> Iterator[str]:
    """Lines of index.md between the bench's marks."""
    size = "" if answer["size"] == "default" else f" --{answer['size']}"
    machine, peers = answer["machine"], ", ".join(f"{k} {v}" for k, v in answer["peers"].items() if v)
    yield f"`python benchmarks/work_precision.py {answer['bench']}{size}` on {machine['processor']},"
    yield f"{machine['processors']} processors, {machine['threads']} threads, {machine['system']},"
    yield f"Python {machine['python']}; {peers}."
    yield f"Points: [{answer['bench']}.csv]({answer['bench']}.csv)."
    yield ""
    if any(DRAWINGS[answer["bench"]].panel(point) for point in answer["points"]):
        yield f"![Error against seconds]({answer['bench']}.svg)"
        yield ""
    yield "| bar | value | limit | |"
    yield "|---|---:|---:|---|"
    for bar in answer["criteria"]:
        sign, verdict = "≥" if bar.get("at_least") else "≤", "met" if bar["met"] else "**missed**"
        value, limit = (_shown(bar[key], bar.get("unit", "")) for key in ("value", "limit"))
        yield f"| {bar['what']} | {value} | {sign} {limit} | {verdict} |"
    yield from _points_table(answer["points"], DRAWINGS[answer["bench"]].columns)
    for note in answer["notes"]:
        yield ""
        yield f"{note[0].upper()}{note[1:]}."


def _points_table(points: list[Record], columns: tuple[str, ...]) -> Iterator[str]:
    """Lines of a table, a row a point; a bar where a point lacks a number."""
    if not columns:
        return
    yield ""
    yield f"| problem | method | {' | '.join(columns)} |"
    yield "|---|---|" + "---:|" * len(columns)
    for point in points:
        values = (point.get(column) for column in columns)
        cells = ("–" if value is None or value != value else f"{value:.3g}" for value in values)
        yield f"| {point['problem']} | {point['method']} | {' | '.join(cells)} |"


def _shown(value: float, unit: str) -> str:
    return duration(value) if unit == "s" else f"{value:.3g} {unit}".strip()


def insert(page: Path, name: str, lines: list[str]) -> None:
    """Replace what stands between a bench's marks."""
    text = page.read_text(encoding="utf-8")
    begin, end = f"<!-- begin {name} -->", f"<!-- end {name} -->"
    if begin not in text:
        raise SystemExit(f"{page} has no {begin}")
    body = "\n".join([begin, "", *lines, "", end])
    new = re.sub(f"{re.escape(begin)}.*?{re.escape(end)}", lambda _: body, text, flags=re.DOTALL)
    page.write_text(new, encoding="utf-8")


def progress(label: str, done: int, total: int) -> None:
    """One line a step on stderr."""
    print(f"{done}/{total} {label}", file=sys.stderr, flush=True)


def main() -> None:
    """Run and write."""
    parser = argparse.ArgumentParser(description="Write the work-precision pages of docs/benchmarks.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(BENCHES)}; all without a name")
    parser.add_argument("--quick", dest="size", action="store_const", const="quick", default="default")
    parser.add_argument("--full", dest="size", action="store_const", const="full")
    parser.add_argument("--out", type=Path, default=FOLDER)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    for name in options.names or BENCHES:
        answer = run_bench(name, options.size, options.out / f"{name}.csv", progress).as_json()
        draw(answer, options.out / f"{name}.svg")
        page = options.out / "index.md"
        if page.is_file():
            insert(page, name, list(page_part(answer)))


if __name__ == "__main__":
    main()
