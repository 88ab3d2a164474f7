"""Whether white stands still: from frame to frame, from row to row, and what makes it flicker.

A camera samples light at its frame rate, so that a lamp of 100 Hz shows at the difference to the nearest multiple of
that rate. The spectrum of a series names the source whose alias is where the peak is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from calibration.arrays import FloatArray
from rig.devices.protocols import RawFrame
from rig.records import Record, Verdict
from rig.self_check.parts.exposure import without_room_light
from rig.self_check.parts.pipeline import frame_rate_hz
from rig.self_check.results import PartResult
from rig.self_check.rig_under_test import RigUnderTest

_FRAMES = 64
"""Two seconds of a camera of 30 Hz: lines half a hertz apart are told."""
_DARK_FRAMES = 32
"""Enough to see whether a line that is known is there without the projector's light."""
_NOISE_PAIRS = 8
"""All lit pixels of each: their noise is known to a percent."""
_LIT_ROW = 0.1
"""Of its width: rows with fewer lit pixels are left out."""
_PEAK = 14.0
"""Power of a peak over the mean of the others: chance reaches it once in ten thousand series of this length."""
ROOM = "room"
_ROOM_LIGHT_HZ = {"room light on 50 Hz mains": 100.0, "room light on 60 Hz mains": 120.0}


@dataclass(frozen=True, slots=True)
class Spectrum:
    """Amplitudes of a series about its straight line."""

    frequencies_hz: FloatArray
    amplitudes: FloatArray
    """Same unit as the series."""
    peak_hz: float | None
    """None: nothing stands out of the noise."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Flicker(Record):
    """Light of white from frame to frame, and its spectrum."""

    series_s: FloatArray
    """(N,) time of each frame since the first."""
    series: FloatArray
    """(N,) mean of the lit pixels, over that of all frames."""
    frame_rate_hz: float
    frequencies_hz: FloatArray
    """(K,) up to half the frame rate."""
    amplitude_percent: FloatArray
    """(K,) of white."""
    noise_percent: float
    """Of white: standard deviation of a frame's mean that the pixels' noise explains."""
    source: str
    """Likeliest source of the strongest ripple, in words; empty where nothing stands out."""
    where: str
    """Room, or projector or camera."""


def check_flicker(tested: RigUnderTest) -> PartResult[Flicker]:
    """Temporal and row-wise flicker of white, and the peak's likely source."""
    limits, lit = tested.limits, tested.lit
    white = tested.series(255, _FRAMES, "white")
    times_s = np.array([frame.started_s for frame in white])
    rows = _row_means(tested, white)
    means = np.array([tested.pixels(frame)[lit].mean() for frame in white])
    level = float(means.mean() - tested.black[lit].mean())
    steady = _straightened(times_s, means)
    pixel_noise = _pixel_noise(tested, white)
    noise = pixel_noise / float(np.sqrt(lit.sum()))
    temporal = 100 * float(np.sqrt(max(steady.var() - noise**2, 0.0))) / level
    by_row = 100 * _row_excess(tested, rows, pixel_noise) / level
    rate_hz = frame_rate_hz(white)
    spectrum = spectrum_of(times_s, steady)
    source, light_hz = named(spectrum.peak_hz, rate_hz, tested.refresh_rate_hz, times_s[-1] - times_s[0])
    dark = _dark_ripple(tested, spectrum.peak_hz)
    where = ROOM if dark is not None and dark > 0.5 * spectrum.amplitudes.max() else "projector or camera"
    advice = f"{source}, most likely of the {where}; " if source else ""
    verdicts = (
        Verdict(
            what="flicker of white from frame to frame",
            value=temporal,
            limit=limits.flicker_percent,
            unit="% of white",
            advice=advice + "expose whole refreshes and whole periods of the room light, or switch that light off",
        ),
        Verdict(
            what="flicker of white from row to row",
            value=by_row,
            limit=limits.flicker_percent,
            unit="% of white",
            advice="a rolling shutter sees the display's refresh or the room light: expose whole periods of both",
        ),
        Verdict(
            what=f"strongest ripple: {source}" if source else "strongest ripple",
            value=spectrum.peak_hz,
            unit="Hz, as sampled",
            advice="nothing stands out of the noise",
        ),
    )
    suggested = _exposure(tested, light_hz) if temporal > limits.flicker_percent else {}
    numbers = Flicker(
        series_s=times_s - times_s[0],
        series=means / means.mean(),
        frame_rate_hz=rate_hz,
        frequencies_hz=spectrum.frequencies_hz,
        amplitude_percent=100 * spectrum.amplitudes / level,
        noise_percent=100 * noise / level,
        source=source,
        where=where if source else "",
    )
    return PartResult(verdicts=verdicts, numbers=numbers, suggested=suggested)


def _exposure(tested: RigUnderTest, light_hz: float | None) -> dict[str, float]:
    """An exposure that is blind to the room light, if there is one."""
    chosen_s = without_room_light(tested, light_hz) if light_hz else None
    return {"camera.exposure_s": round(chosen_s, 6)} if chosen_s else {}


def _straightened(times_s: FloatArray, values: FloatArray) -> FloatArray:
    """Without mean and slope: drift is not flicker."""
    return np.asarray(values - np.polyval(np.polyfit(times_s - times_s[0], values, 1), times_s - times_s[0]))


def _row_means(tested: RigUnderTest, frames: Sequence[RawFrame]) -> FloatArray:
    """(N, R) means over the lit pixels of each row that has enough of them. [dn]."""
    count = tested.lit.sum(axis=1)
    rows = count > _LIT_ROW * tested.lit.shape[1]
    return np.stack([(tested.pixels(frame) * tested.lit).sum(axis=1)[rows] / count[rows] for frame in frames])


def _pixel_noise(tested: RigUnderTest, frames: Sequence[RawFrame]) -> float:
    """Standard deviation of one pixel over time; changes that whole rows have in common left out. [dn]."""
    variances = []
    for earlier, later in pairwise(frames[: _NOISE_PAIRS + 1]):
        change = tested.pixels(later) - tested.pixels(earlier)
        common = (change * tested.lit).sum(axis=1) / np.maximum(tested.lit.sum(axis=1), 1)
        variances.append(float(((change - common[:, None])[tested.lit] ** 2).mean()) / 2)
    return float(np.sqrt(np.mean(variances)))


def _row_excess(tested: RigUnderTest, rows: FloatArray, noise: float) -> float:
    """Standard deviation over time of rows against their frame, beyond what the pixels' noise gives. [dn]."""
    count = tested.lit.sum(axis=1)
    alone = rows - rows.mean(axis=1, keepdims=True)
    variance = float((alone - alone.mean(axis=0)).var(axis=0, ddof=1).mean())
    expected = float((noise**2 / count[count > _LIT_ROW * tested.lit.shape[1]]).mean())
    return float(np.sqrt(max(variance - 1.2 * expected, 0.0)))


def spectrum_of(times_s: FloatArray, values: FloatArray) -> Spectrum:
    """Amplitudes by least squares at frequencies up to half the frame rate; frames may be missing."""
    span_s = float(times_s[-1] - times_s[0])
    half_hz = 0.5 / float(np.median(np.diff(times_s)))
    frequencies = np.arange(1.0, 2 * half_hz * span_s + 0.5) / (2 * span_s)
    phase = 2 * np.pi * frequencies[:, None] * (times_s - times_s[0])[None, :]
    amplitudes = 2 / len(times_s) * np.abs((np.exp(1j * phase) * values * _window(len(values))).sum(axis=1))
    power = amplitudes**2
    top = int(np.argmax(power))
    others = np.delete(power, slice(max(top - 4, 0), top + 5))
    stands_out = others.size > 0 and power[top] > _PEAK * max(float(others.mean()), 1e-30)
    return Spectrum(frequencies, amplitudes, float(frequencies[top]) if stands_out else None)


def _window(count: int) -> FloatArray:
    """Of mean 1, so that a strong ripple does not leak over the spectrum."""
    return np.asarray(2 * np.hanning(count + 2)[1:-1])


def named(peak_hz: float | None, rate_hz: float, refresh_rate_hz: float, span_s: float) -> tuple[str, float | None]:
    """What flickers at a frequency that shows at ``peak_hz`` in frames of ``rate_hz``: words, and its frequency."""
    if peak_hz is None:
        return "", None
    sources = {**_ROOM_LIGHT_HZ, "refresh of the display": refresh_rate_hz}
    names = [
        (name, hz) for name, hz in sources.items() if abs(aliased_hz(hz, rate_hz) - peak_hz) < 1.5 / span_s
    ]  # fmt: skip
    if not names:
        return f"unknown source at {peak_hz:.1f} Hz or beside a multiple of {rate_hz:.3g} Hz", None
    words = " or ".join(f"{hz:g} Hz {name}" for name, hz in names)
    return words, names[0][1]


def aliased_hz(frequency_hz: float, rate_hz: float) -> float:
    """Where a frequency shows when it is sampled."""
    return abs(frequency_hz - rate_hz * round(frequency_hz / rate_hz))


def _dark_ripple(tested: RigUnderTest, peak_hz: float | None) -> float | None:
    """Amplitude at the peak while the projector shows black. [dn]."""
    if peak_hz is None:
        return None
    frames: Sequence[RawFrame] = tested.series(0, _DARK_FRAMES, "black")
    times_s = np.array([frame.started_s for frame in frames])
    values = _straightened(times_s, np.array([tested.pixels(frame)[tested.lit].mean() for frame in frames]))
    spectrum = spectrum_of(times_s, values)
    near = np.abs(spectrum.frequencies_hz - peak_hz) < 1.5 / (times_s[-1] - times_s[0])
    return float(spectrum.amplitudes[near].max(initial=0.0))
