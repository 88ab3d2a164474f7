"""The replication of the paper as tables on the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from rig.paper.experiments import SHOWN
from rig.paper.records import (
    ConfigurationResult,
    Ends,
    MeanError,
    PaperResult,
    PictureScores,
    PublishedFigures,
    StrategyScores,
)
from sim.light.criteria import Spread

_WIDTH = 128
"""Characters: narrower than this the table cannot be read."""
TABLE_COLUMNS = (
    "configuration",
    "lit",
    "indirect light",
    "once",
    "needed E'",
    "without",
    "paper",
    "exact",
    "bounded",
)


def print_paper(result: PaperResult) -> None:
    """Print the six configurations, the published figures under each; not narrower than it can be read."""
    console = Console(width=max(Console().width, _WIDTH))
    console.print(paper_table(result))
    console.print(strategies_table(result.configurations))
    for name, text in result.conventions.items():
        print(f"{name}: {text}")
    for text in result.exceptions:
        print(f"exception: {text}")


def paper_table(result: PaperResult) -> Table:
    """The table of ours, and under each row the published figures."""
    table = Table(title="Dehos et al. 2014 again, grey levels of 255", title_justify="left", box=SIMPLE_HEAD)
    for column in TABLE_COLUMNS:
        table.add_column(column, no_wrap=True, justify="left" if column == TABLE_COLUMNS[0] else "right")
    for configuration in result.configurations:
        strategies = configuration.strategies
        table.add_row(
            configuration.title,
            f"{100 * configuration.coverage:.0f} %",
            _range(configuration.indirect),
            f"{100 * configuration.share_white:.0f} %",
            _range(configuration.required_emission),
            _error(configuration.error_uncompensated),
            *(_error(strategies[name]) for name in SHOWN),
        )
        table.add_row(*_published_row(configuration.published), style="dim", end_section=True)
    return table


def _published_row(published: PublishedFigures) -> list[str]:
    share = published.share_white
    return [
        "  published",
        "",
        _range(published.indirect),
        "" if share is None else f"{100 * share:.0f} %",
        _range(published.required_emission),
        _error(published.error_uncompensated),
        _error(published.error_compensated),
        "",
        "",
    ]


def _range(values: Spread | Ends | None) -> str:
    if values is None:
        return ""
    return " / ".join(f"{value:.0f}" for value in asdict(values).values())


def _error(error: MeanError | PictureScores | None) -> str:
    if error is None:
        return ""
    spread_text = "" if error.sd is None else f" ± {error.sd:.0f}"
    return f"{error.mean:.1f}{spread_text}"


def strategies_table(configurations: Sequence[ConfigurationResult]) -> Table:
    """Mean error and deviation of every strategy; a star where ``direct`` is better and the strategy says so."""
    table = Table(title="Every strategy: mean error ± deviation, grey levels", title_justify="left", box=SIMPLE_HEAD)
    table.add_column("strategy", no_wrap=True)
    for configuration in configurations:
        table.add_column(configuration.title, justify="right")
    for name in configurations[0].strategies:
        table.add_row(name, *(_cell(configuration.strategies[name]) for configuration in configurations))
    table.caption = "* worse than direct, clamped"
    return table


def _cell(score: StrategyScores) -> str:
    star = "*" if score.worse_than_direct else ""
    return f"{star}{score.mean:.1f} ± {score.sd:.1f}"
