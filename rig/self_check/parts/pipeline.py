"""The camera's pipeline: frames between a new exposure and its effect, frames that wait in the queue, lost frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.arrays import FloatArray
from rig.devices.protocols import RawFrame
from rig.records import Record, Verdict
from rig.self_check.results import PartResult
from rig.self_check.rig_under_test import RigUnderTest, fingerprint

_CHANGES = 4
"""Of the exposure, both ways twice."""
_FRAMES = 8
"""That a change may take: drivers keep two to six buffers."""
_IDLE_PERIODS = 6
"""Of a pause: as many frames as a driver's queue holds."""
_SERIES = 30
"""A second of a usual camera: a loss of one frame in twenty shows."""
_BRIEF = 0.8
"""Of the camera's period: an exposure that cannot slow it down."""


@dataclass(frozen=True, kw_only=True)
class DeliveryAge(Record):
    """Time from the end of an exposure until its frame is handed over. [s]."""

    min: float
    median: float
    max: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Pipeline(Record):
    """How the camera's frames come."""

    depth_frames: tuple[int, ...]
    """Frames between an exposure's setting and its effect, one a change."""
    waiting_frames: int
    """That came at once after a pause."""
    delivery_age_s: DeliveryAge
    intervals_s: FloatArray
    """(N,) between the time stamps of a series."""
    copies: int
    """Frames of the series whose pixels are those of one before."""


def check_pipeline(tested: RigUnderTest) -> PartResult[Pipeline]:
    """Depth, frames in flight, frame rate, copies."""
    limits = tested.limits
    promised_hz = tested.rig.profile.camera.frame_rate_hz
    settled = _settled_levels(tested)
    changes = [_change(tested, settled, k) for k in range(_CHANGES)]
    waiting, age = _queue(tested)
    exposure_s = min(tested.exposure_s, max(_BRIEF / promised_hz, tested.exposure_range_s[0]))
    series = tested.series(255, _SERIES, "white", exposure_s)
    rate_hz, copies = frame_rate_hz(series), _copies(series)
    off = 100 * abs(rate_hz / promised_hz - 1)
    verdicts = (
        Verdict(
            what="frames between an exposure's setting and its effect",
            value=float(max(c[0] for c in changes)),
            unit="frames",
        ),
        Verdict(
            what="frames that claim the new exposure and show the old",
            value=float(sum(c[1] for c in changes)),
            limit=limits.misreported_frames,
            unit="frames",
            advice="the driver's frames lag: report it, with the driver's name and version",
        ),
        Verdict(what="frames that wait while nobody asks", value=float(waiting), unit="frames"),
        Verdict(what="frame rate", value=rate_hz, unit="Hz"),
        Verdict(
            what="frame rate off the profile's",
            value=off,
            limit=limits.frame_rate_percent,
            unit="%",
            advice="set frame_rate_hz as suggested, or a smaller or compressed format, another port",
        ),
        Verdict(
            what="frames lost",
            value=100 * _lost(series) / len(series),
            limit=limits.rejected_percent,
            unit="% of frames",
            advice="another USB port or cable, no hub; a smaller format; a less busy machine",
        ),
        Verdict(
            what="frames that are copies of one before",
            value=100 * copies / len(series),
            limit=limits.copied_percent,
            unit="% of frames",
            advice="the camera or a loopback repeats frames: lower the frame rate to what the sensor gives",
        ),
    )
    suggested = {"camera.frame_rate_hz": round(rate_hz, 3)} if off > limits.frame_rate_percent else {}
    numbers = Pipeline(
        depth_frames=tuple(c[0] for c in changes),
        waiting_frames=waiting,
        delivery_age_s=age,
        intervals_s=np.diff([frame.started_s for frame in series]),
        copies=copies,
    )
    return PartResult(verdicts=verdicts, numbers=numbers, suggested=suggested)


def _settled_levels(tested: RigUnderTest) -> tuple[tuple[float, float], tuple[float, float]]:
    """(exposure, mean level) of two exposures of white."""
    both = [tested.exposure_s, max(tested.exposure_s / 2, tested.exposure_range_s[0])]
    first, second = ((s, float(tested.photograph(255, "white", s)[tested.lit].mean())) for s in both)
    return first, second


def _change(
    tested: RigUnderTest, settled: tuple[tuple[float, float], tuple[float, float]], number: int
) -> tuple[int, int]:
    """Frames that a new exposure takes to be seen, and how many claim it before.

    A driver may wait itself until the exposure is there, so frames are counted by time.
    """
    (_, old), (new_s, new) = settled if number % 2 == 0 else settled[::-1]
    rig = tested.rig
    rig.set_exposure(settled[number % 2][0])
    tested.shoot(255, "white", settled[number % 2][0])
    called_s = rig.clock.now_s()
    chosen_s = rig.set_exposure(new_s)
    depth = misreported = 0
    for _ in range(_FRAMES):
        frame = tested.take(0.0)
        if frame is None:
            continue
        level = float(tested.pixels(frame)[tested.lit].mean())
        depth = max(int((frame.started_s - called_s) * rig.profile.camera.frame_rate_hz), depth)
        if abs(level - new) < abs(level - old):
            break
        misreported += abs(frame.exposure_s / chosen_s - 1) < 0.01
    return depth, misreported


def _queue(tested: RigUnderTest) -> tuple[int, DeliveryAge]:
    """Frames that come at once after a pause, and the age at which frames are handed over. [s]."""
    rig = tested.rig
    period_s = 1 / rig.profile.camera.frame_rate_hz
    tested.shoot(255, "white")
    paused_s = rig.clock.now_s() + _IDLE_PERIODS * period_s
    rig.clock.wait_until_s(paused_s)
    waiting, ages = 0, []
    for _ in range(3 * _FRAMES):
        frame = tested.take(0.0)
        if frame is None:
            continue
        if frame.started_s + frame.exposure_s < paused_s:
            waiting += 1
        else:
            ages.append(rig.clock.now_s() - frame.started_s - frame.exposure_s)
    values = np.array(ages or [0.0])
    return waiting, DeliveryAge(min=float(values.min()), median=float(np.median(values)), max=float(values.max()))


def frame_rate_hz(series: Sequence[RawFrame]) -> float:
    """By time stamps: the rate of frames that follow each other without a gap."""
    return 1 / float(np.median(np.diff([frame.started_s for frame in series])))


def _lost(series: Sequence[RawFrame]) -> int:
    """Frames that the driver has missed."""
    return sum(frame.lost for frame in series[1:])


def _copies(series: Sequence[RawFrame]) -> int:
    """Frames whose pixels are those of a frame before."""
    return len(series) - len({fingerprint(frame) for frame in series})
