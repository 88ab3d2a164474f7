"""How long light takes after the display says that a picture is on screen, from frames that the change cuts.

The camera's frames are taken without waiting for the profile's latency. The share of an exposure that a change
leaves to the new picture tells when it came, far finer than the camera's period; photographs at shares of the
exposure turn brightness into such shares. The light of black, which is there all the time, is added to these: that
takes the camera's curve, which they tell as well.

Rolling shutter: a time stamp is the first row's. Where the two halves of the frames differ, the delay of a row is
found from them, and the delays are corrected by it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.arrays import BoolArray, FloatArray
from calibration.errors import CalibrationError
from calibration.structured_light.patterns import flat
from rig.devices.protocols import RawFrame
from rig.errors import CalibrationFailed, CaptureTimeout
from rig.records import Record, Verdict
from rig.self_check.parts.linearity import CameraCurve, curve_of, straight_curve
from rig.self_check.results import PartResult
from rig.self_check.rig_under_test import RigUnderTest, fingerprint

TRIALS = 40
_FRAMES_WAITED = 200
_CHANGED, _SWELL_SEEN = 0.02, 1.5
"""Share of a change by which a frame shows it; noise of a frame's mean is far below. Where frames of a still picture
differ by as much, so many times that."""
_MOST_SWELL = 0.15
"""Of a change: where a still picture differs by more, a new one is not told from it."""
_STILL_FRAMES = 8
"""Of the bright picture, and of black: three phases of a mains light at 30 frames a second, and more."""
_CURVE_PIXELS = 4000
_NO_GAP = 0.998
"""Of the camera's period: nothing falls between two frames, and the frame rate stays."""
_FRACTIONS = (0.2, 0.4, 0.6, 0.8)
_GOLDEN = 0.618
"""Waits before a change, in periods, that fill the phases evenly."""
_MARGIN = 0.25
"""Of a refresh: what a change may hide between frames and still count as sharp, and what is added to be safe."""
_LEAST_SHARP = 5
"""So many trials without a gap at the change are better than all trials with it."""
_LEAST_CUT = 3
"""Frames that a change cuts, of which the delay of a row is told: noise alone makes no readout of half a ms."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Levels:
    """How bright frames are that the bright picture lights for a share of the exposure."""

    code: int
    curve: CameraCurve
    shares: FloatArray
    """(N,) of the exposure, rising from 0 to 1."""
    masks: tuple[BoolArray, BoolArray, BoolArray]
    """(H, W) lit pixels: all, those of the upper half, those of the lower."""
    means: FloatArray
    """(3, N) mean light of each mask at each share."""
    rows: tuple[float, float, float]
    """Where the light of each mask is on average, in rows from the top."""

    def share_of(self, image: FloatArray, mask: int) -> float:
        """Share of the exposure that the bright picture had, seen in one of the masks."""
        light = float(self.curve.light(image[self.masks[mask]]).mean())
        return float(np.interp(light, self.means[mask], self.shares))


@dataclass(frozen=True, kw_only=True)
class Latency(Record):
    """The display's delay from its time stamp to light, over many changes of the picture. [s]."""

    mean: float
    min: float
    median: float
    max: float
    sd: float
    values_s: tuple[float, ...]
    """Of the changes that count."""
    safe_s: float
    """A latency that a profile can promise: the largest seen + a quarter of a refresh."""
    code: int
    """Of the bright picture."""
    exposure_s: float
    trials: int
    used: tuple[int, ...]
    """Which trials count, from 0."""
    unseen_s: float
    """The most that fell between two frames, of the trials that count."""
    readout_s: float
    """Of the camera, first to last row; 0 where it is too short to be seen."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Sight:
    """One frame after a change: the new picture's share of it, and of its upper and lower half."""

    started_s: float
    exposure_s: float
    share: float
    upper: float
    lower: float


@dataclass(frozen=True, slots=True)
class _Trial:
    """One change of the picture."""

    on_screen_s: float
    sights: tuple[_Sight, ...]
    changed: float
    """Share of the change by which a frame shows it."""

    def delay(self) -> tuple[float, float]:
        """Delay of the change as if it were a step, and how much of that no frame has seen. [s].

        What is missing of the new picture is added up over exposures and the gaps between them.
        """
        missing_s = unseen_s = 0.0
        time_s, before = self.on_screen_s, 0.0
        for sight in self.sights:
            gap_s = max(sight.started_s - time_s, 0.0)
            after = float(sight.share > 1 - self.changed)
            missing_s += gap_s * (1 - (before + after) / 2) + sight.exposure_s * (1 - sight.share)
            unseen_s += gap_s if before != after else 0.0
            time_s, before = sight.started_s + sight.exposure_s, float(sight.share > self.changed)
        return missing_s, unseen_s


def measure_latency(tested: RigUnderTest) -> Latency:
    """Distribution of the display's delay, and the camera's readout as far as it shows."""
    period_s = 1 / tested.rig.profile.camera.frame_rate_hz
    exposure_s = tested.rig.set_exposure(float(np.clip(_NO_GAP * period_s, *tested.exposure_range_s)))
    levels = _levels(tested, exposure_s)
    changed = _change_that_shows(tested, levels, exposure_s)
    trials = [_run_trial(tested, levels, number, changed) for number in range(TRIALS)]
    line_s = _line_delay_s(trials, levels)
    found = np.array([trial.delay() for trial in trials])
    sharp = found[:, 1] < _MARGIN / tested.refresh_rate_hz
    chosen = sharp if sharp.sum() >= _LEAST_SHARP else np.ones(len(found), bool)
    delays_s = found[chosen, 0] + line_s * levels.rows[0]
    return Latency(
        mean=float(delays_s.mean()),
        min=float(delays_s.min()),
        median=float(np.median(delays_s)),
        max=float(delays_s.max()),
        sd=float(delays_s.std(ddof=1)) if len(delays_s) > 1 else 0.0,
        values_s=tuple(float(delay_s) for delay_s in delays_s),
        safe_s=float(delays_s.max()) + _MARGIN / tested.refresh_rate_hz,
        code=levels.code,
        exposure_s=exposure_s,
        trials=TRIALS,
        used=tuple(int(number) for number in np.flatnonzero(chosen)),
        unseen_s=float(found[chosen, 1].max()),
        readout_s=line_s * levels.masks[0].shape[0],
    )


def _levels(tested: RigUnderTest, exposure_s: float) -> _Levels:
    """Photograph a code that does not clip at this exposure, at shares of the exposure."""
    for code in (255, 192, 128, 64):
        full = tested.photograph(code, f"level-{code:03d}", exposure_s)
        if np.quantile(full, 0.999) < 0.9 * tested.full_scale_dn:
            break
    shares, images = [], []
    for fraction in _FRACTIONS:
        if fraction * exposure_s >= tested.exposure_range_s[0]:
            frame = tested.shoot(code, f"level-{code:03d}", fraction * exposure_s)
            shares.append(frame.exposure_s / exposure_s)
            images.append(tested.pixels(frame))
    black = tested.photograph(0, "black", exposure_s)
    lit = full - black > 0.3 * np.quantile(full - black, 0.99)
    masks = _halves(lit)
    shares, images = [*shares, 1.0], [*images, full]
    curve = _curve(tested, images, np.array(shares), lit)
    dark = curve.light(black)
    lights = [curve.light(image) + (1 - share) * dark for image, share in zip(images, shares, strict=True)]
    means = np.array([[light[mask].mean() for light in (dark, *lights)] for mask in masks])
    brought = lights[-1] - dark
    return _Levels(
        code=code,
        curve=curve,
        shares=np.array([0.0, *shares]),
        masks=masks,
        means=np.maximum.accumulate(means, axis=1),
        rows=(_row_of(brought, masks[0]), _row_of(brought, masks[1]), _row_of(brought, masks[2])),
    )


def _curve(tested: RigUnderTest, images: Sequence[FloatArray], shares: FloatArray, lit: BoolArray) -> CameraCurve:
    """The camera's curve from a picture at shares of the exposure; straight where these do not tell it."""
    every = max(1, int(lit.sum()) // _CURVE_PIXELS)
    try:
        return curve_of(tested, np.array([image[lit][::every] for image in images]) - tested.offset_dn, shares)
    except CalibrationError:
        return straight_curve(tested)


def _change_that_shows(tested: RigUnderTest, levels: _Levels, exposure_s: float) -> float:
    """Share of a change by which a frame shows it: more than frames of a still picture differ by.

    Raises CalibrationFailed where they differ too much.
    """
    swell = 0.0
    for code, share in ((levels.code, 1.0), (0, 0.0)):
        frames = tested.series(code, _STILL_FRAMES, f"still-{code:03d}", exposure_s)
        swell = max(swell, *(abs(levels.share_of(tested.pixels(frame), 0) - share) for frame in frames))
    if swell > _MOST_SWELL:
        raise CalibrationFailed(
            f"the light of a still picture changes by {100 * swell:.0f} % of what the picture brings, so that a new "
            "picture is not told from it: switch off room light that flickers, and let the lamp warm up"
        )
    return max(_CHANGED, _SWELL_SEEN * swell)


def _halves(lit: BoolArray) -> tuple[BoolArray, BoolArray, BoolArray]:
    """All lit pixels, and two halves of them, upper rows and lower rows."""
    rows = np.arange(lit.shape[0])[:, None]
    middle = np.median(np.nonzero(lit)[0])
    return lit, lit & (rows < middle), lit & (rows >= middle)


def _row_of(light: FloatArray, mask: BoolArray) -> float:
    weight = np.maximum(light[mask], 0.0)
    return float(np.nonzero(mask)[0] @ weight / max(weight.sum(), 1e-9))


def _run_trial(tested: RigUnderTest, levels: _Levels, number: int, changed: float) -> _Trial:
    """Change the picture once, and take frames until one is the new picture's alone."""
    rig = tested.rig
    brightens = number % 2 == 0
    period_s = 1 / rig.profile.camera.frame_rate_hz
    rig.clock.wait_until_s(rig.clock.now_s() + period_s * ((number * _GOLDEN) % 1))
    picture = flat(tested.picture_shape, levels.code if brightens else 0, f"latency-{number}")
    shown = rig.projector.show(picture.codes, name=picture.name)
    sights: list[_Sight] = []
    seen: set[int] = set()
    after_s = shown.on_screen_s
    for _ in range(_FRAMES_WAITED):
        frame = tested.take(after_s)
        if frame is None or frame.started_s < after_s or (mark := fingerprint(frame)) in seen:
            continue
        seen.add(mark)
        after_s = frame.started_s + frame.exposure_s / 2
        sights.append(_sight(tested.pixels(frame), frame, levels, brightens))
        if sights[-1].share > 1 - changed:
            return _Trial(shown.on_screen_s, tuple(sights), changed)
    raise CaptureTimeout(
        f"a new picture was not seen in {_FRAMES_WAITED} frames after it was shown; does the camera see the projector?"
    )


def _sight(image: FloatArray, frame: RawFrame, levels: _Levels, brightens: bool) -> _Sight:
    bright = [levels.share_of(image, mask) for mask in range(3)]
    share, upper, lower = bright if brightens else (1 - b for b in bright)
    return _Sight(started_s=frame.started_s, exposure_s=frame.exposure_s, share=share, upper=upper, lower=lower)


def _line_delay_s(trials: Sequence[_Trial], levels: _Levels) -> float:
    """Delay of each row against the row above, where it is more than noise; else 0."""
    _, upper, lower = levels.rows
    cut = [s for trial in trials for s in trial.sights if 0.1 < min(s.upper, s.lower) <= max(s.upper, s.lower) < 0.9]
    if len(cut) < _LEAST_CUT or lower <= upper:
        return 0.0
    delays = np.array([(s.lower - s.upper) * s.exposure_s / (lower - upper) for s in cut])
    uncertainty = 1.25 * float(delays.std()) / np.sqrt(len(delays))
    middle = float(np.median(delays))
    return middle if abs(middle) > 5 * uncertainty and abs(middle) * levels.masks[0].shape[0] > 5e-4 else 0.0


def check_latency(tested: RigUnderTest) -> PartResult[Latency]:
    """Latency against the profile's, and its jitter."""
    latency = measure_latency(tested)
    # the pictures were promised with the latency of the profile's file; while it is checked the rig has a generous one
    verdicts = (
        Verdict(
            what="latency of the display",
            value=latency.max,
            limit=tested.promised_latency_s,
            unit="s",
            advice="give projector.latency_s the value suggested below; game mode, if the projector has one",
        ),
        Verdict(what="latency of the display, median", value=latency.median, unit="s"),
        Verdict(
            what="jitter of the latency, largest - smallest",
            value=(latency.max - latency.min) * tested.refresh_rate_hz,
            limit=tested.limits.jitter_refreshes,
            unit="refreshes",
            advice="frame interpolation and noise reduction of the projector off; no compositor; native refresh rate",
        ),
        Verdict(what="readout of the camera, first to last row", value=latency.readout_s, unit="s"),
    )
    suggested = {"projector.latency_s": round(latency.safe_s, 4)}
    return PartResult(verdicts=verdicts, numbers=latency, suggested=suggested)
