"""The page of a lens calibration: coverage, residuals, uncertainty, halves, views."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.lenses.maps import DeviceMaps
from rig.lenses.records import DeviceLens, LensesResult
from rig.report.figures import style
from rig.report.pictures import png_figure
from rig.report.render import headline_of, rendered

FloatArray = NDArray[np.float64]
_BLUE, _ORANGE, _SOFT = "#2557a7", "#c4561c", "#5d6678"
_MOST_ARROWS = 1500


@dataclass(frozen=True)
class LensChart:
    """A figure of one device, with what a reader should know of it."""

    title: str
    text: str
    src: str


def write_lens_page(result: LensesResult, maps: tuple[DeviceMaps, ...], path: Path) -> Path:
    """Write one self-contained HTML file. Raises UsageError when it cannot be written."""
    context = {
        "title": "Lenses from boards",
        "subtitle": f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC; {sum(view.used for view in result.views)} of "
        f"{len(result.views)} views used; lens file {result.output.name}.",
        "met": result.within_limits,
        "verdict": f"{sum(row.met for row in result.limits)} of {len(result.limits)} limits kept",
        "headline": [
            headline_of(result.rms_px, "px", "rms of all corners"),
            *(
                headline_of(one.projection_sigma_px[1], "px", f"median uncertainty, {one.name}")
                for one in result.devices
            ),
        ],
        "result": result,
        "charts": [chart for device, one in zip(result.devices, maps, strict=True) for chart in _charts(device, one)],
    }
    try:
        path.write_text(rendered("lenses/lenses.html", context), encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror}; give a file in a folder that exists") from error
    return path


def _charts(device: DeviceLens, maps: DeviceMaps) -> list[LensChart]:
    charts = [
        LensChart(
            f"{device.name}: coverage and residuals",
            f"Left: the {device.corners} corners that the fit rests on, and (orange) {device.left_out} that do not "
            f"belong. Right: where they were seen minus where the lens has them, rms {device.rms_px:.3f} px. Speckle "
            "is noise; a pattern is a lens model or a board that does not fit.",
            png_figure(_residual_figure(maps)),
        ),
        LensChart(
            f"{device.name}: uncertainty of projection",
            "One standard deviation, in the worst direction, of the pixel at which a fixed point is seen: at the "
            f"boards' distance of {maps.near_m:.2f} m, and far away. It covers the noise of the corners and the "
            "scatter of the views; outside the corners' outline the lens is extrapolated, and the colours end at 1.5 "
            "times the worst within it.",
            png_figure(_sigma_figure(maps)),
        ),
    ]
    if maps.halves is not None and device.halves is not None:
        words = (
            f"Lenses fitted to two halves of the views differ by {device.halves.difference_px:.3f} px (rms), their "
            f"uncertainties say {device.halves.expected_px:.3f} px: a ratio of {device.halves.ratio:.2f}; "
            "about 1 is right."
        )
        charts.append(LensChart(f"{device.name}: two halves of the views", words, png_figure(_halves_figure(maps))))
    return charts


def _residual_figure(maps: DeviceMaps) -> Figure:
    figure = Figure(figsize=(12, 4.2))
    left, right = figure.add_subplot(1, 2, 1), figure.add_subplot(1, 2, 2)
    left.plot(*maps.seen_px.T, ".", color=_BLUE, ms=2)
    left.plot(*maps.left_out_px.T, "x", color=_ORANGE, ms=4)
    step = max(1, len(maps.seen_px) // _MOST_ARROWS)
    seen, residual = maps.seen_px[::step], maps.residual_px[::step]
    length = np.hypot(*residual.T)
    usual = max(float(np.median(length)) if len(length) else 1.0, 1e-6)
    arrows = right.quiver(
        *seen.T,
        *residual.T,
        length,
        angles="xy",
        scale_units="xy",
        scale=usual / (maps.lens.width_px / 40),
        cmap="viridis",
    )
    figure.colorbar(arrows, ax=right, shrink=0.8).set_label("residual, px", color=_SOFT)
    for axes in (left, right):
        _as_picture(axes, maps)
    return figure


def _sigma_figure(maps: DeviceMaps) -> Figure:
    figure = Figure(figsize=(12, 4.2))
    pairs = ((maps.sigma_near_px, f"at {maps.near_m:.2f} m"), (maps.sigma_far_px, "far away"))
    for k, (sigma, title) in enumerate(pairs):
        axes = figure.add_subplot(1, 2, k + 1)
        _map(figure, axes, maps, sigma, top=1.5 * float(np.nanmax(sigma[maps.inside])))
        axes.set_title(title, fontsize=10, loc="left")
    return figure


def _halves_figure(maps: DeviceMaps) -> Figure:
    figure = Figure(figsize=(12, 4.2))
    if maps.halves is not None:
        pairs = ((np.hypot(*maps.halves.difference_px.T), "difference"), (maps.halves.expected_px, "expected"))
        top = 1.2 * float(np.nanmax([values[maps.inside] for values, _ in pairs]))
        for k, (values, title) in enumerate(pairs):
            axes = figure.add_subplot(1, 2, k + 1)
            _map(figure, axes, maps, values, top=top)
            axes.set_title(title, fontsize=10, loc="left")
    return figure


def _map(figure: Figure, axes: Axes, maps: DeviceMaps, values: FloatArray, top: float | None = None) -> None:
    extent = (0, maps.lens.width_px - 1, maps.lens.height_px - 1, 0)
    shown = axes.imshow(
        values.reshape(maps.grid_shape), extent=extent, vmin=0, vmax=top, cmap="viridis", aspect="equal"
    )
    figure.colorbar(shown, ax=axes, shrink=0.8).set_label("px", color=_SOFT)
    _as_picture(axes, maps)


def _as_picture(axes: Axes, maps: DeviceMaps) -> None:
    axes.set(xlim=(0, maps.lens.width_px - 1), ylim=(maps.lens.height_px - 1, 0), aspect="equal")
    style(axes, "x, px", "y, px")
