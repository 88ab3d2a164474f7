"""A search on the page and on the terminal."""

from __future__ import annotations

from dataclasses import dataclass

from matplotlib.figure import Figure

from rig.plan.search.records import Design, SearchResult
from rig.plan.search.words import UNITS, said
from rig.report.figures import style
from rig.report.pictures import png_figure
from rig.report.render import TextTable
from rig.terminal import print_table, say

MOST_ROWS = 12
"""Of a front on the page; the JSON has all."""
_BLUE, _ORANGE, _SOFT = "#2557a7", "#c4561c", "#aab2bf"


@dataclass(frozen=True, kw_only=True)
class DesignsSection:
    """What the template shows of a search."""

    words: tuple[str, ...]
    best: TextTable
    sensitivity: TextTable
    sensitivity_text: str
    front: str
    """A figure; empty with one goal."""


def designs_section(result: SearchResult) -> DesignsSection:
    """Return the page's section."""
    return DesignsSection(
        words=result.words,
        best=designs_table(result),
        sensitivity=sensitivity_table(result),
        sensitivity_text="Each parameter moved alone from the best design: by a twentieth of its range, or to another "
        "choice. 'weight' compares the worst change of each; '-' cannot be.",
        front=_front_figure(result),
    )


def print_search(result: SearchResult) -> None:
    """Print the best designs and why."""
    table = designs_table(result)
    print_table("Designs", list(table.head), [tuple(row) for row in table.rows])
    for sentence in result.words:
        say(f"- {sentence}")


def designs_table(result: SearchResult) -> TextTable:
    """Return the given design, the best, and the front."""
    keys = list(result.best.values)
    step = max(1, -(-len(result.front) // MOST_ROWS))
    shown = [("as given", result.given), ("best", result.best)]
    shown += [(f"front {k + 1}", one) for k, one in enumerate(result.front[::step])] if len(result.front) > 1 else []
    rows = [
        (name, *(said(one.values[key]) for key in keys), *(_cell(one, goal) for goal in result.goals))
        for name, one in shown
    ]
    return TextTable(("design", *keys, *(f"{goal} {UNITS.get(goal, '')}".strip() for goal in result.goals)), rows)


def _cell(design: Design, goal: str) -> str:
    return f"{design.measures[goal]:.3g}" if design.measures else "-"


def sensitivity_table(result: SearchResult) -> TextTable:
    """Return what each parameter does to the goals."""
    rows = []
    for one in sorted(result.sensitivity, key=lambda one: -one.share):
        changed = ", ".join(said(value) for value in one.changed_to)
        goals = (
            ", ".join(f"{measures[goal]:.3g}" if measures else "-" for measures in one.measures)
            for goal in result.goals
        )
        rows.append((one.key, f"{one.share:.2f}", said(result.best.values[one.key]), changed, *goals))
    return TextTable(("parameter", "weight", "best at", "changed to", *result.goals), rows)


def _front_figure(result: SearchResult) -> str:
    """All designs in the plane of the first two goals."""
    if len(result.front) < 2 or len(result.goals) < 2:
        return ""
    x, y = result.goals[:2]
    figure = Figure(figsize=(7.4, 4.2))
    axes = figure.add_subplot()
    for designs, colour, size, label in (
        ([one for one in result.tried if one.allowed], _SOFT, 12, "designs tried"),
        (result.front, _BLUE, 26, "none beats these"),
        ((result.best,), _ORANGE, 70, "best by the weights"),
    ):
        axes.scatter(
            [one.measures[x] for one in designs],
            [one.measures[y] for one in designs],
            s=size,
            color=colour,
            label=label,
        )
    axes.legend(fontsize=8, frameon=False)
    style(axes, f"{x} {UNITS.get(x, '')}".strip(), f"{y} {UNITS.get(y, '')}".strip())
    return png_figure(figure)
