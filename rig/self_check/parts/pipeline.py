"""The camera's pipeline: frames between a new exposure and its effect, frames that wait in the queue, lost frames."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rig.devices.protocols import RawFrame
from rig.self_check.rig_under_test import RigUnderTest, fingerprint
from rig.self_check.rows import Measured, Row

_CHANGES = 4
_FRAMES = 8
_IDLE_PERIODS = 6
_SERIES = 30
_BRIEF = 0.8
"""Of the camera's period: an exposure that cannot slow it down."""


def check_pipeline(subject: RigUnderTest) -> Measured:
    """Depth, frames in flight, frame rate, copies."""
    limits = subject.limits
    promised_hz = subject.rig.profile.camera.frame_rate_hz
    settled = _settled_levels(subject)
    changes = [_change(subject, settled, k) for k in range(_CHANGES)]
    waiting, age_s = _queue(subject)
    exposure_s = min(subject.exposure_s, max(_BRIEF / promised_hz, subject.exposure_range_s[0]))
    series = subject.series(255, _SERIES, "white", exposure_s)
    rate_hz, copies = frame_rate_hz(series), _copies(series)
    off = 100 * abs(rate_hz / promised_hz - 1)
    rows = (
        Row("frames between an exposure's setting and its effect", float(max(c[0] for c in changes)), "frames"),
        Row("frames that claim the new exposure and show the old", float(sum(c[1] for c in changes)), "frames",
            limits.misreported_frames, advice="the driver's frames lag: report it, with the driver's name and version"),
        Row("frames that wait while nobody asks", float(waiting), "frames"),
        Row("frame rate", rate_hz, "Hz"),
        Row("frame rate off the profile's", off, "%", limits.frame_rate_percent,
            advice="set frame_rate_hz as suggested, or a smaller or compressed format, another port"),
        Row("frames lost", 100 * _lost(series) / len(series), "% of frames", limits.rejected_percent,
            advice="another USB port or cable, no hub; a smaller format; a less busy machine"),
        Row("frames that are copies of one before", 100 * copies / len(series), "% of frames", limits.copied_percent,
            advice="the camera or a loopback repeats frames: lower the frame rate to what the sensor gives"),
    )  # fmt: skip
    suggested = {"camera.frame_rate_hz": round(rate_hz, 3)} if off > limits.frame_rate_percent else {}
    numbers = {
        "depth_frames": [c[0] for c in changes],
        "waiting_frames": waiting,
        "delivery_age_s": age_s,
        "intervals_s": [float(d) for d in np.diff([frame.started_s for frame in series])],
        "copies": copies,
    }
    return Measured(rows, suggested, numbers)


def _settled_levels(subject: RigUnderTest) -> tuple[tuple[float, float], tuple[float, float]]:
    """(exposure, mean level) of two exposures of white."""
    both = [subject.exposure_s, max(subject.exposure_s / 2, subject.exposure_range_s[0])]
    first, second = ((s, float(subject.photograph(255, "white", s)[subject.lit].mean())) for s in both)
    return first, second


def _change(
    subject: RigUnderTest, settled: tuple[tuple[float, float], tuple[float, float]], number: int
) -> tuple[int, int]:
    """Frames that a new exposure takes to be seen, and how many claim it before.

    A driver may wait itself until the exposure is there, so frames are counted by time.
    """
    (_, old), (new_s, new) = settled if number % 2 == 0 else settled[::-1]
    rig = subject.rig
    rig.set_exposure(settled[number % 2][0])
    subject.shoot(255, "white", settled[number % 2][0])
    called_s = rig.clock.now_s()
    chosen_s = rig.set_exposure(new_s)
    depth = misreported = 0
    for _ in range(_FRAMES):
        frame = subject.take(0.0)
        if frame is None:
            continue
        level = float(subject.pixels(frame)[subject.lit].mean())
        depth = max(int((frame.started_s - called_s) * rig.profile.camera.frame_rate_hz), depth)
        if abs(level - new) < abs(level - old):
            break
        misreported += abs(frame.exposure_s / chosen_s - 1) < 0.01
    return depth, misreported


def _queue(subject: RigUnderTest) -> tuple[int, dict[str, float]]:
    """Frames that come at once after a pause, and the age at which frames are handed over. [s]."""
    rig = subject.rig
    period_s = 1 / rig.profile.camera.frame_rate_hz
    subject.shoot(255, "white")
    paused_s = rig.clock.now_s() + _IDLE_PERIODS * period_s
    rig.clock.wait_until_s(paused_s)
    waiting, ages = 0, []
    for _ in range(3 * _FRAMES):
        frame = subject.take(0.0)
        if frame is None:
            continue
        if frame.started_s + frame.exposure_s < paused_s:
            waiting += 1
        else:
            ages.append(rig.clock.now_s() - frame.started_s - frame.exposure_s)
    values = np.array(ages or [0.0])
    return waiting, {"min": float(values.min()), "median": float(np.median(values)), "max": float(values.max())}


def frame_rate_hz(series: Sequence[RawFrame]) -> float:
    """By time stamps: the rate of frames that follow each other without a gap."""
    return 1 / float(np.median(np.diff([frame.started_s for frame in series])))


def _lost(series: Sequence[RawFrame]) -> int:
    """Frames that the driver has missed."""
    return sum(frame.lost for frame in series[1:])


def _copies(series: Sequence[RawFrame]) -> int:
    """Frames whose pixels are those of a frame before."""
    return len(series) - len({fingerprint(frame) for frame in series})
