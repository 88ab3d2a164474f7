"""Charts of a rig's check, each of a part that was measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import singledispatch

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from rig.records import Record
from rig.report.figures import style
from rig.report.pictures import svg
from rig.self_check.parts.flicker import Flicker
from rig.self_check.parts.latency import Latency
from rig.self_check.parts.linearity import Linearity
from rig.self_check.parts.noise import Noise
from rig.self_check.parts.ramp import Ramp
from rig.self_check.parts.stability import Stability
from rig.self_check.results import SelfCheck

_BLUE, _ORANGE, _SOFT, _LIMIT = "#2557a7", "#c4561c", "#5d6678", "#b3312c"
LimitsByName = Mapping[str, float]
"""Limits of a part's verdicts, by what is judged."""
_ORDER = (Latency, Linearity, Noise, Flicker, Ramp, Stability)
"""In which the page shows them."""


@dataclass(frozen=True, slots=True)
class Chart:
    """A figure, with what a reader should know of it."""

    title: str
    text: str
    figure: Figure

    @property
    def src(self) -> str:
        """The picture as a data URI."""
        return svg(self.figure)


def check_figures(result: SelfCheck) -> list[Chart]:
    """Draw a chart of each part that was measured and has one, with the limits that its axes can show."""
    found = []
    for kind in _ORDER:
        for part in result.parts.values():
            if isinstance(part.numbers, kind):
                limits = {verdict.what: verdict.limit for verdict in part.verdicts if verdict.limit is not None}
                found.append(_chart(part.numbers, limits))
    return found


def _limit_lines(axes: Axes, limit: float | None) -> None:
    """Draw a limit across an axes, above zero and below."""
    if limit is None:
        return
    for value in (limit, -limit):
        axes.axhline(value, color=_LIMIT, lw=1, ls="--")
    at, within = (1.0, limit), ("axes fraction", "data")
    axes.annotate(
        f"limit {limit:g}",
        at,
        xycoords=within,
        xytext=(0, 3),
        textcoords="offset points",
        ha="right",
        fontsize=8,
        color=_LIMIT,
        annotation_clip=False,
    )


@singledispatch
def _chart(numbers: Record, _: LimitsByName) -> Chart:
    raise TypeError(f"{type(numbers).__name__} has no chart")


@_chart.register
def _latency(n: Latency, limits: LimitsByName) -> Chart:
    values_ms = 1e3 * np.asarray(n.values_s)
    figure = Figure(figsize=(10, 2.8))
    axes = figure.add_subplot()
    axes.hist(values_ms, bins=max(8, len(values_ms) // 3), color=_BLUE, rwidth=0.92)
    for value, name in ((n.median, "median"), (n.safe_s, "suggested")):
        axes.axvline(1e3 * value, color=_ORANGE, lw=1.4, ls="--" if name == "median" else "-", label=name)
    if (limit_s := limits.get("latency of the display")) is not None:
        axes.axvline(1e3 * limit_s, color=_LIMIT, lw=1, ls="--", label=f"limit {1e3 * limit_s:g} (the profile's)")
    axes.legend(fontsize=8, frameon=False)
    style(axes, "from the display's time stamp to light, ms", "changes")
    text = (
        f"{len(values_ms)} changes of the picture: median {1e3 * n.median:.2f} ms, "
        f"{1e3 * n.min:.2f} to {1e3 * n.max:.2f} ms, standard deviation {1e3 * n.sd:.2f} ms."
    )
    return Chart("Latency of the display", text, figure)


@_chart.register
def _linearity(n: Linearity, limits: LimitsByName) -> Chart:
    times_ms, signals = 1e3 * n.exposures_s, n.signals_dn
    line = n.slope_dn_per_s * n.exposures_s + n.intercept_dn
    figure = Figure(figsize=(10, 3.4))
    left, right = figure.add_subplot(1, 2, 1), figure.add_subplot(1, 2, 2)
    left.plot(times_ms, line, color=_SOFT, lw=1)
    left.plot(times_ms, signals, "o", color=_BLUE, ms=5)
    style(left, "exposure, ms", "signal, dn")
    right.axhline(0, color=_SOFT, lw=0.8)
    right.plot(times_ms, 100 * (signals - line) / signals.max(), "o-", color=_BLUE, ms=5, lw=1)
    _limit_lines(right, limits.get("nonlinearity that the camera's curve leaves"))
    style(right, "exposure, ms", "off the straight line, % of brightest")
    figure.subplots_adjust(wspace=0.25)
    text = (
        f"Mean of the pixels of one level, code {n.code}, above the dark level of {n.dark_level_dn:.1f} dn; "
        f"exposures are {'whole refreshes' if n.whole_refreshes else 'shares of one, not whole refreshes'}. "
        "The limit is for what the camera's fitted curve leaves."
    )
    return Chart("Linearity of the camera", text, figure)


@_chart.register
def _noise(n: Noise, _: LimitsByName) -> Chart:
    signals, variances = n.signals_dn, n.variances_dn2
    figure = Figure(figsize=(10, 3.6))
    axes = figure.add_subplot()
    shown = np.geomspace(0.3, max(signals.max(), 1.0), 200)
    read = (n.read_noise_e / n.gain_e_per_dn) ** 2
    axes.loglog(shown, read + shown / n.gain_e_per_dn, color=_SOFT, lw=1, label="read noise + light / gain")
    axes.loglog(np.maximum(signals, 0.3), np.maximum(variances, 1e-3), ".", color=_BLUE, ms=5, label="measured")
    axes.axhline(max(read, 1e-3), color=_ORANGE, lw=0.9, ls=":", label="read noise")
    axes.legend(fontsize=8, frameon=False)
    style(axes, "signal in linear light, dn", "variance, dn²")
    text = (
        f"Gain {n.gain_e_per_dn:.4g} ± {n.gain_95_percent:.2g} e-/dn, read noise {n.read_noise_e:.3g} ± "
        f"{n.read_noise_95_percent_e:.2g} e-, full well {n.full_well_e:.4g} ± "
        f"{n.full_well_95_percent_e:.2g} e- (95 %)."
    )
    return Chart("Photon transfer", text, figure)


@_chart.register
def _flicker(n: Flicker, limits: LimitsByName) -> Chart:
    figure = Figure(figsize=(10, 3.0))
    left, right = figure.add_subplot(1, 2, 1), figure.add_subplot(1, 2, 2)
    left.plot(n.series_s, 100 * (n.series - 1), ".-", color=_BLUE, lw=0.8, ms=4)
    _limit_lines(left, limits.get("flicker of white from frame to frame"))
    style(left, "time, s", "white, % off its mean")
    right.plot(n.frequencies_hz, n.amplitude_percent, color=_BLUE, lw=1)
    right.axhline(n.noise_percent, color=_SOFT, lw=0.8, ls=":")
    style(right, f"frequency as sampled at {n.frame_rate_hz:.4g} Hz", "amplitude, % of white")
    figure.subplots_adjust(wspace=0.25)
    return Chart("Flicker of white", n.source or "Nothing stands out of the noise.", figure)


@_chart.register
def _ramp(n: Ramp, _: LimitsByName) -> Chart:
    codes, light = np.asarray(n.codes), np.asarray(n.light_dn)
    figure = Figure(figsize=(10, 3.0))
    axes = figure.add_subplot()
    axes.plot(codes, light, ".-", color=_BLUE, lw=0.8, ms=5)
    for first, last in ((112, 128), (236, 255)):
        axes.axvspan(first, last, color=_SOFT, alpha=0.15, lw=0, label="judged, code by code" if last == 255 else None)
    axes.legend(fontsize=8, frameon=False)
    style(axes, "code", "mean of the lit pixels, dn")
    return Chart("Ramp of codes", "Each code is a picture of its own; steps between neighbours are judged.", figure)


@_chart.register
def _stability(n: Stability, limits: LimitsByName) -> Chart:
    shifts = n.shifts_px
    times_s, light = n.white_times_s, n.white_light_dn
    figure = Figure(figsize=(10, 3.0))
    left, right = figure.add_subplot(1, 2, 1), figure.add_subplot(1, 2, 2)
    left.plot(shifts[:, 0], shifts[:, 1], ".", color=_BLUE, ms=6)
    left.axhline(0, color=_SOFT, lw=0.6)
    left.axvline(0, color=_SOFT, lw=0.6)
    reach = max(0.02, 1.2 * float(np.abs(shifts).max()))
    if (limit_px := limits.get("shift of the picture since the beginning")) is not None:
        left.add_patch(Circle((0, 0), limit_px, fill=False, color=_LIMIT, lw=1, ls="--", label=f"limit {limit_px:g}"))
        left.legend(fontsize=8, frameon=False, loc="upper right")
        reach = max(reach, 1.1 * limit_px)
    left.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    style(left, "shift in x, px", "shift in y, px")
    right.plot(times_s - times_s[0], 100 * (light / light[0] - 1), ".-", color=_ORANGE, lw=0.8, ms=5)
    _limit_lines(right, limits.get("change of white between first and last frame"))
    style(right, "time, s", "white, % off the first")
    figure.subplots_adjust(wspace=0.25)
    return Chart(
        "Stability", "Shift of the picture since the check began, and light of white through the check.", figure
    )
