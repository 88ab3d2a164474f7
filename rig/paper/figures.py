"""Figures like the paper's 5 to 16: images side by side, and bars beside the published ones."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rig.paper.records import ConfigurationResult, MeanError, PaperImages, PictureScores, PublishedFigures

FloatArray = NDArray[np.float64]

OURS, PUBLISHED = "#2b6cb0", "#c8c8c8"
STRATEGY_TITLES = {"paper": "paper", "exact": "exact", "bounded": "bounded"}
DPI = 130


def write_paper_figures(
    configurations: Sequence[ConfigurationResult], images: Sequence[PaperImages], directory: Path
) -> list[Path]:
    """Write all figures as PNG.

    Parameters
    ----------
    configurations : sequence of ConfigurationResult
        What ``run_paper`` finds.
    images : sequence of PaperImages
        One a configuration, in the same order.
    directory : Path
        Exists.

    Returns
    -------
    list of Path
        The files written.
    """
    paths = []
    for configuration, shown in zip(configurations, images, strict=True):
        paths.append(_save(_images_figure(configuration, shown), directory / f"images-{shown.name}.png"))
    paths.append(_save(_share_figure(images[0]), directory / "once-reflected.png"))
    for name, draw in _BARS.items():
        paths.append(_save(draw(configurations), directory / f"{name}.png"))
    return paths


def _save(figure: Figure, path: Path) -> Path:
    figure.savefig(path, dpi=DPI)
    return path


def _images_figure(configuration: ConfigurationResult, shown: PaperImages) -> Figure:
    """Above what is seen, below what is projected."""
    figure = Figure(figsize=(13.0, 5.6), layout="constrained")
    figure.suptitle(f"{shown.title}: seen in the room (above), sent to the projector (below)")
    axes = figure.subplots(2, 4)
    _picture(axes[0, 0], shown.uncompensated, _caption("without", configuration.error_uncompensated))
    _picture(axes[1, 0], shown.desired, "desired image")
    for column, (name, title) in enumerate(STRATEGY_TITLES.items(), 1):
        _picture(axes[0, column], shown.visible[name], _caption(title, configuration.strategies[name]))
        _picture(axes[1, column], shown.projected[name], f"compensation: {title}")
    return figure


def _caption(title: str, error: PictureScores) -> str:
    return f"{title}: error {error.mean:.1f} ± {error.sd:.1f}"


def _picture(axes: Axes, image: FloatArray, title: str) -> None:
    axes.imshow(image, cmap="gray", vmin=0, vmax=255, interpolation="nearest")
    axes.set_title(title, fontsize=10)
    axes.set_axis_off()


def _share_figure(shown: PaperImages) -> Figure:
    figure = Figure(figsize=(6.4, 4.6), layout="constrained")
    axes = figure.subplots()
    picture = axes.imshow(100 * shown.once_reflected_share, cmap="viridis", vmin=0, vmax=100)
    axes.set_title("Reference, white projected: light reflected only once")
    axes.set_axis_off()
    figure.colorbar(picture, ax=axes, label="share of the light seen [%]", shrink=0.85)
    return figure


@dataclass(frozen=True)
class _Quantity:
    """What a chart of bars shows: ours, and what the paper publishes of it."""

    title: str
    unit: str
    ours: Callable[[ConfigurationResult], float]
    published: Callable[[PublishedFigures], float | None]


def _bars(axes: Axes, configurations: Sequence[ConfigurationResult], quantity: _Quantity) -> None:
    """Draw a pair of bars a configuration; none where the paper gives no figure."""
    places = np.arange(len(configurations))
    heights = [quantity.ours(configuration) for configuration in configurations]
    known = [quantity.published(configuration.published) for configuration in configurations]
    given = [(place + 0.2, value) for place, value in zip(places, known, strict=True) if value is not None]
    axes.bar(places - 0.2, heights, 0.38, color=OURS, label="here")
    axes.bar([x for x, _ in given], [y for _, y in given], 0.38, color=PUBLISHED, label="published")
    top = max(np.abs([*heights, *(value for _, value in given)]))
    for place, value, colour in [(x - 0.2, y, "white") for x, y in zip(places, heights, strict=True)] + [
        (x, y, "black") for x, y in given
    ]:
        inside = abs(value) > 0.08 * top
        at = np.sign(value) * top * 0.04 if inside else value + np.sign(value) * top * 0.03
        axes.text(
            place,
            at,
            f"{value:.0f}",
            ha="center",
            va="center",
            color=colour if inside else "black",
            fontsize=9,
        )
    axes.set_xticks(places, [configuration.title for configuration in configurations], rotation=20, ha="right")
    axes.set_title(quantity.title)
    axes.set_ylabel(quantity.unit)
    axes.axhline(0, color="black", linewidth=0.8)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False)


def _indirect_figure(configurations: Sequence[ConfigurationResult]) -> Figure:
    figure = Figure(figsize=(9.0, 4.6), layout="constrained")
    axes = figure.subplots()
    quantity = _Quantity(
        "Indirect radiosity of the visible patches (bar: mean; whisker: min ... max)",
        "grey levels of 255",
        lambda c: c.indirect.mean,
        lambda p: p.indirect.mean,
    )
    _bars(axes, configurations, quantity)
    for place, configuration in enumerate(configurations):
        ours, theirs = configuration.indirect, configuration.published.indirect
        for offset, values in ((-0.2, ours), (0.2, theirs)):
            below, above = values.mean - values.min, values.max - values.mean
            axes.errorbar(place + offset, values.mean, [[below], [above]], color="black", capsize=3, linewidth=0.9)
    return figure


def _share_bars(configurations: Sequence[ConfigurationResult]) -> Figure:
    figure = Figure(figsize=(9.0, 4.6), layout="constrained")
    quantity = _Quantity(
        "Light reflected only once when white is projected",
        "share of the light seen [%]",
        lambda c: 100 * c.share_white,
        lambda p: None if p.share_white is None else 100 * p.share_white,
    )
    _bars(figure.subplots(), configurations, quantity)
    return figure


def _emission_figure(configurations: Sequence[ConfigurationResult]) -> Figure:
    figure = Figure(figsize=(13.0, 4.6), layout="constrained")
    smallest, largest = figure.subplots(1, 2)
    _emission_bars(configurations, "min", "Emission required, smallest (E' of eq. 13)", smallest)
    _emission_bars(configurations, "max", "Emission required, largest (E' of eq. 13)", largest)
    return figure


def _emission_bars(configurations: Sequence[ConfigurationResult], end: str, title: str, axes: Axes) -> None:
    quantity = _Quantity(
        title,
        "grey levels of 255",
        lambda c: float(getattr(c.required_emission, end)),
        lambda p: None if p.required_emission is None else float(getattr(p.required_emission, end)),
    )
    _bars(axes, configurations, quantity)


def _error_figure(configurations: Sequence[ConfigurationResult]) -> Figure:
    figure = Figure(figsize=(13.0, 4.6), layout="constrained")
    without, compensated = figure.subplots(1, 2, sharey=True)
    unit = "mean |visible - desired| [grey levels]"
    quantity = _Quantity(
        "Error without compensation",
        unit,
        lambda c: c.error_uncompensated.mean,
        lambda p: _mean_of(p.error_uncompensated),
    )
    _bars(without, configurations, quantity)
    quantity = _Quantity(
        "Error with the paper's compensation",
        unit,
        lambda c: c.strategies["paper"].mean,
        lambda p: _mean_of(p.error_compensated),
    )
    _bars(compensated, configurations, quantity)
    return figure


def _strategies_figure(configurations: Sequence[ConfigurationResult]) -> Figure:
    """A panel a configuration, a bar a strategy; hatched where ``direct`` is better."""
    figure = Figure(figsize=(13.0, 8.6), layout="constrained")
    figure.suptitle("Error by strategy: bar mean, dot root mean square; hatched: worse than direct, clamped")
    panels = figure.subplots(2, 3, sharey=True)
    for axes, configuration in zip(panels.flat, configurations, strict=True):
        _strategies_panel(axes, configuration)
    for axes in panels[-1]:
        axes.set_xlabel("|visible - desired| [grey levels]")
    panels[0, 0].invert_yaxis()
    return figure


def _strategies_panel(axes: Axes, configuration: ConfigurationResult) -> None:
    strategies = configuration.strategies
    places = np.arange(len(strategies))
    means = [score.mean for score in strategies.values()]
    colours = [OURS if name == "bounded" else "#a9bcd6" for name in strategies]
    bars = axes.barh(places, means, 0.7, color=colours)
    axes.plot([score.rms for score in strategies.values()], places, "o", color="black", markersize=3)
    for bar, place, score in zip(bars, places, strategies.values(), strict=True):
        bar.set_hatch("///" if score.worse_than_direct else "")
        axes.annotate(
            f"{score.mean:.1f}", (score.rms, place), (6, 0), textcoords="offset points", va="center", fontsize=8
        )
    axes.set_yticks(places, [name.replace("_", " ") for name in strategies])
    axes.set_title(configuration.title)
    axes.spines[["top", "right"]].set_visible(False)
    axes.margins(x=0.12)


def _mean_of(error: MeanError | None) -> float | None:
    return None if error is None else error.mean


_BARS: Mapping[str, Callable[[Sequence[ConfigurationResult]], Figure]] = {
    "indirect": _indirect_figure,
    "share-once-reflected": _share_bars,
    "required-emission": _emission_figure,
    "error-published": _error_figure,
    "error-strategies": _strategies_figure,
}
