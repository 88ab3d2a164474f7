"""The replication of the paper as tables on the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

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
from rig.terminal import print_table, say
from sim.light.criteria import Spread

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
    """Print the six configurations, the published figures under each."""
    print_table("Dehos et al. 2014 again, grey levels of 255", TABLE_COLUMNS, paper_rows(result))
    head = ("strategy", *(configuration.title for configuration in result.configurations))
    print_table("Every strategy: mean error ± deviation, grey levels", head, strategies_rows(result.configurations))
    print("* worse than direct, clamped")
    for name, text in result.conventions.items():
        say(f"{name}: {text}")
    for text in result.exceptions:
        say(f"exception: {text}")


def paper_rows(result: PaperResult) -> list[list[str]]:
    """Return a row of ours, and under each the published figures."""
    rows = []
    for configuration in result.configurations:
        strategies = configuration.strategies
        own = [
            configuration.title,
            f"{100 * configuration.coverage:.0f} %",
            _range(configuration.indirect),
            f"{100 * configuration.share_white:.0f} %",
            _range(configuration.required_emission),
            _error(configuration.error_uncompensated),
            *(_error(strategies[name]) for name in SHOWN),
        ]
        rows += [own, _published_row(configuration.published)]
    return rows


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


def strategies_rows(configurations: Sequence[ConfigurationResult]) -> list[list[str]]:
    """Return mean error and deviation of every strategy; a star where ``direct`` is better and the strategy says so."""
    return [
        [name, *(_cell(configuration.strategies[name]) for configuration in configurations)]
        for name in configurations[0].strategies
    ]


def _cell(score: StrategyScores) -> str:
    star = "*" if score.worse_than_direct else ""
    return f"{star}{score.mean:.1f} ± {score.sd:.1f}"
