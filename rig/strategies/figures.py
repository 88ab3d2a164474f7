"""Charts of the comparison of strategies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rig.strategies.records import ClosedLoop, JudgedErrors, StrategyRow

INK, SOFT, MEASURED, PREDICTED, LOOP = "#1d2330", "#8a93a3", "#2557a7", "#b9c6dd", "#c4561c"
LEAST_SECONDS = 1e-3
"""Times below count as this on the logarithmic axis."""


@dataclass(frozen=True)
class TitledRow:
    """A row of the page: a strategy, a closed loop, or a strategy that knows the simulated world."""

    title: str
    figures: StrategyRow
    is_timed: bool = True
    """Whether its seconds are those of a strategy, to be drawn against its error."""


def mean_of(errors: JudgedErrors | None) -> float | None:
    """Return the mean error, None where there is none."""
    return None if errors is None else errors.mean


def errors_figure(rows: Sequence[TitledRow]) -> Figure:
    """Bars: measured and predicted mean error of each strategy; a row without a measurement has one bar."""
    figure = Figure(figsize=(10.0, 0.42 * len(rows) + 1.4), layout="constrained")
    axes = figure.subplots()
    places = np.arange(len(rows))[::-1]
    measured = [mean_of(row.figures.measured) for row in rows]
    predicted = [mean_of(row.figures.predicted) for row in rows]
    for values, offset, colour, label in (
        (measured, 0.2, MEASURED, "measured"),
        (predicted, -0.2, PREDICTED, "predicted"),
    ):
        known = [(place + offset, value) for place, value in zip(places, values, strict=True) if value is not None]
        if known:
            bars = axes.barh([k[0] for k in known], [k[1] for k in known], 0.38, color=colour, label=label)
            axes.bar_label(bars, fmt="%.1f", fontsize=8, padding=3, color=INK)
    axes.set_yticks(places, [row.title for row in rows])
    _plain(axes, "mean error [grey levels of 255]", "")
    axes.margins(x=0.08)
    axes.legend(frameon=False, loc="lower right")
    return figure


def speed_figure(rows: Sequence[TitledRow], loops: Sequence[ClosedLoop] = ()) -> Figure:
    """Seconds to compute against error: the lower left is better. Closed loops hang from their strategy."""
    figure = Figure(figsize=(10.0, 5.2), layout="constrained")
    axes = figure.subplots()
    places = [(max(row.figures.seconds or 0.0, LEAST_SECONDS), row.figures.shown.mean) for row in rows]
    for (seconds, error), row in zip(places, rows, strict=True):
        axes.plot(seconds, error, "o", color=MEASURED, ms=7)
        loop = next((loop for loop in loops if loop.strategy == row.figures.strategy), None)
        if loop:
            _hang(axes, seconds, loop)
    for (seconds, error), row, lift in zip(places, rows, _lifts(places), strict=True):
        axes.annotate(
            row.title,
            (seconds, error),
            xytext=(8, 3 + lift),
            textcoords="offset points",
            fontsize=9,
            arrowprops={"arrowstyle": "-", "color": SOFT, "lw": 0.6} if lift else None,
        )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.margins(x=0.16, y=0.1)
    _plain(axes, "time to compute the projector image [s]", "mean error [grey levels of 255]")
    axes.grid(which="major", color="#e6e9ef", lw=0.6)
    return figure


def loops_figure(loops: Sequence[ClosedLoop], oracle: Sequence[StrategyRow]) -> Figure:
    """Measured mean error after each capture; dashed what knowing the simulated world gives without a loop."""
    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    axes = figure.subplots()
    colours = (LOOP, MEASURED, "#1a7f4b", "#8c4fb0", "#5d6678", "#b38600")
    for colour, loop in zip(np.resize(colours, len(loops)), loops, strict=True):
        errors = [capture.mean for capture in loop.captures]
        numbers = np.arange(1, len(errors) + 1)
        axes.plot(numbers, errors, "o-", color=colour, label=f"{loop.strategy}, rule '{loop.rule}'")
        axes.plot(loop.best, loop.kept.mean, "o", ms=11, mfc="none", color=colour)
    for row in oracle:
        error = row.shown.mean
        axes.axhline(error, color=SOFT, ls="--", lw=1, label=f"{row.strategy}, world known: {error:.2f}")
    axes.set_xticks(np.arange(1, max(len(loop.captures) for loop in loops) + 1))
    _plain(axes, "captures", "measured mean error [grey levels of 255]")
    axes.margins(y=0.15)
    axes.legend(frameon=False)
    return figure


def _hang(axes: Axes, seconds: float, loop: ClosedLoop) -> None:
    errors = [capture.mean for capture in loop.captures[: loop.best]]
    axes.plot([seconds] * len(errors), errors, "-", color=LOOP, lw=1)
    axes.plot(seconds, errors[-1], "o", color=LOOP, ms=7)
    label = f"{loop.strategy}, closed loop of {loop.best} captures"
    axes.annotate(label, (seconds, errors[-1]), xytext=(8, -4), textcoords="offset points", fontsize=9, color=LOOP)


def _lifts(places: Sequence[tuple[float, float]], near: float = 0.045, step: float = 12.0) -> list[float]:
    """How far, in points, each label moves up so that those of neighbours do not lie on each other."""
    logs = np.log10(np.array(places))
    spans = np.maximum(np.ptp(logs, axis=0), 1e-3)
    shares = (logs - logs.min(axis=0)) / spans
    lifts = np.zeros(len(places))
    for k in np.argsort(shares[:, 1]):
        below = [
            j
            for j in np.argsort(shares[:, 1])
            if shares[j, 1] < shares[k, 1] and abs(shares[j, 0] - shares[k, 0]) < 0.25
        ]
        close = [j for j in below if shares[k, 1] + lifts[k] / 330 - shares[j, 1] - lifts[j] / 330 < near]
        lifts[k] = max((lifts[j] + step - 330 * (shares[k, 1] - shares[j, 1]) for j in close), default=0.0)
    return [float(max(lift, 0.0)) for lift in lifts]


def _plain(axes: Axes, x: str, y: str) -> None:
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.spines[["top", "right"]].set_visible(False)
