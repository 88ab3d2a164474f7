"""Charts of a study: each figure against each parameter that varies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import islice

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rig.report.pictures import png_figure
from rig.sweeps.columns import Cells, Columns, numbers_of
from rig.sweeps.study import StudyPage

FloatArray = NDArray[np.float64]
_INK, _SOFT, _BLUE = "#1d2330", "#5d6678", "#2557a7"
_MOST_FIGURES, _MOST_PARAMETERS = 6, 6
"""That are drawn unless a study names others."""
_DISCRETE = 16
"""Values of a parameter up to which each has its own place; with more, the axis is divided."""
_PARTS = 12
_DOTS = 2000
"""Points of a chart: more only make it black."""


@dataclass(frozen=True, kw_only=True)
class SweepChart:
    """A figure against the parameters."""

    title: str
    text: str
    src: str


def charts_of(columns: Columns, wishes: StudyPage) -> list[SweepChart]:
    """Return a chart a figure, with a panel a parameter; line: median, band: from the 10 % to the 90 % quantile."""
    asked = [name for name in wishes.figures or columns.figures if name in columns.figures]
    numbers = ((name, numbers_of(columns.figures[name])) for name in asked)  # one at a time: most are not drawn
    known = ((name, found) for name, found in numbers if found is not None)
    shown = islice(known, len(wishes.figures) or _MOST_FIGURES)
    against = wishes.against or columns.varied()[:_MOST_PARAMETERS]
    places = {name: _places(columns.inputs[name]) for name in against}
    panels = _Panels(places) if places else None
    return [panels.chart(name, values) for name, values in shown] if panels else []


@dataclass(frozen=True, eq=False)
class _Places:
    """Where each point stands on a parameter's axis, and the parts that are summed up together."""

    at: FloatArray
    part: NDArray[np.intp]
    middles: FloatArray
    words: tuple[str, ...]
    """Of the parts; none: the axis has numbers."""


def _places(cells: Cells) -> _Places:
    numbers = numbers_of(cells)
    if numbers is not None and len(np.unique(numbers)) > _DISCRETE:
        edges = np.quantile(numbers, np.linspace(0, 1, _PARTS + 1))
        part = np.clip(np.searchsorted(edges, numbers, side="right") - 1, 0, _PARTS - 1)
        return _Places(numbers, part, (edges[1:] + edges[:-1]) / 2, ())
    words = [_word(cell) for cell in cells]
    names = list(dict.fromkeys(words)) if numbers is None else [_word(n) for n in np.unique(numbers).tolist()]
    if numbers is None:
        part = np.array([names.index(word) for word in words])
    else:
        part = np.searchsorted(np.unique(numbers), numbers)
    return _Places(part.astype(np.float64), part, np.arange(len(names), dtype=np.float64), tuple(names))


def _word(cell: object) -> str:
    return f"{cell:g}" if isinstance(cell, float | int) and not isinstance(cell, bool) else str(cell)


class _Panels:
    """A panel a parameter side by side, made once: most of what a chart takes are its axes, and they stay."""

    def __init__(self, places: Mapping[str, _Places]):
        self._places = places
        self._figure = Figure(figsize=(3.6 * len(places), 3.0))
        # By hand: a layout engine draws every figure several times, 3 % of what a thousand points take.
        width = self._figure.get_figwidth()
        self._figure.subplots_adjust(left=0.75 / width, right=1 - 0.1 / width, bottom=0.17, top=0.97, wspace=0.08)
        self._axes = self._figure.subplots(1, len(places), sharey=True, squeeze=False)[0]
        for axes, (parameter, place) in zip(self._axes, places.items(), strict=True):
            axes.set_xlabel(parameter, fontsize=9, color=_SOFT)
            if place.words:
                axes.set_xticks(place.middles, place.words, fontsize=8)
            axes.tick_params(labelsize=8, colors=_INK)
            axes.spines[["top", "right"]].set_visible(False)

    def chart(self, name: str, values: FloatArray) -> SweepChart:
        """Draw one figure."""
        self._axes[0].set_ylabel(name, fontsize=9, color=_SOFT)
        pairs = zip(self._axes, self._places.values(), strict=True)
        drawn = [artist for axes, place in pairs for artist in _drawn(axes, values, place)]
        known = int(np.isfinite(values).sum())
        text = f"{known} points: dots (at most {_DOTS}), median, and the band between the 10 % and the 90 % quantile."
        src = png_figure(self._figure, tight=False)
        for artist in drawn:
            artist.remove()
        for axes in self._axes:
            axes.relim()
        return SweepChart(title=name, text=text, src=src)


def _drawn(axes: Axes, values: FloatArray, place: _Places) -> list[Artist]:
    known = np.flatnonzero(np.isfinite(values))
    few = known[:: max(len(known) // _DOTS, 1)]
    spread = np.linspace(-0.25, 0.25, len(few))[np.argsort(np.argsort(few * 7919 % max(len(values), 1)))]
    at = place.at[few] + (spread if place.words else 0)
    drawn: list[Artist] = [*axes.plot(at, values[few], ".", markersize=1.5, color=_SOFT, alpha=0.35, rasterized=True)]
    there = [k for k in range(len(place.middles)) if np.any(place.part[known] == k)]
    bands = [np.quantile(values[known][place.part[known] == k], (0.1, 0.5, 0.9)) for k in there]
    if bands:
        low, median, high = np.transpose(bands)
        middles = place.middles[there]
        drawn.append(axes.fill_between(middles, low, high, color=_BLUE, alpha=0.18, linewidth=0))
        drawn += axes.plot(middles, median, "o-", color=_BLUE, markersize=3, linewidth=1.4)
    return drawn
