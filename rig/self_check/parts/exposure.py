"""The working exposure, whether light arrives at all, and whether the exposure fits the display's refresh."""

from __future__ import annotations

import numpy as np

from rig.capture.rig import Rig
from rig.errors import CalibrationFailed
from rig.profile.schema import Profile
from rig.self_check.rig_under_test import RigUnderTest
from rig.self_check.rows import Measured, Row

_AIM = 0.8
_TRIES = 8
_LEAST_SIGNAL = 0.01
"""White has to be brighter than black by this share of full scale, or there is nothing to measure."""
PATIENCE_S = 0.5
"""No display known to us takes longer from its time stamp to light."""


def with_generous_latency(profile: Profile, latency_s: float = PATIENCE_S) -> Profile:
    """The profile with another latency: the promised one is to be checked, not trusted."""
    return profile.with_device(profile.projector.model_copy(update={"latency_s": latency_s}))


def find_subject(rig: Rig) -> RigUnderTest:
    """Expose projector white at about 80 % of full scale, in whole refreshes if there is room.

    Raises CalibrationFailed when white is not brighter than black.
    """
    subject = RigUnderTest(rig, rig.profile.camera.exposure_s)
    for _ in range(_TRIES):
        frame = subject.shoot(255, "white")
        subject.channel = int(np.argmax(frame.pixels.mean(axis=(0, 1))))
        level = float(np.quantile(frame.pixels[..., subject.channel], 0.999)) / rig.camera.full_scale_dn
        if 0.88 * _AIM < level < 1.12 * _AIM:
            break
        factor = 0.25 if level > 0.98 else _AIM / max(level, 0.02)
        subject.exposure_s = rig.set_exposure(float(np.clip(subject.exposure_s * factor, *subject.exposure_range_s)))
    _refuse_darkness(subject)
    subject.exposure_s = rig.set_exposure(whole_refreshes(subject.exposure_s, subject))
    return subject


def _refuse_darkness(subject: RigUnderTest) -> None:
    difference = float(np.quantile(subject.photograph(255, "white") - subject.photograph(0, "black"), 0.99))
    limit = _LEAST_SIGNAL * subject.full_scale_dn
    if difference < limit:
        raise CalibrationFailed(
            f"projector white is only {difference:.1f} dn brighter than black at {subject.exposure_s:.4g} s, the "
            f"limit is {limit:.0f} dn: no light of the projector reaches the camera. Look at lens caps, aim and room "
            "light."
        )


def whole_refreshes(exposure_s: float, subject: RigUnderTest) -> float:
    """Next exposure below that is a whole number of refreshes; as it was when that is none, or out of range."""
    count = int(exposure_s * subject.refresh_rate_hz + 0.05)
    whole_s = count / subject.refresh_rate_hz
    shortest, longest = subject.exposure_range_s
    return whole_s if count and shortest <= whole_s <= longest else exposure_s


def mismatch(exposure_s: float, refresh_rate_hz: float) -> float:
    """|t f - round(t f)| / (t f): the largest share of light by which such an exposure can be off."""
    refreshes = exposure_s * refresh_rate_hz
    return abs(refreshes - round(refreshes)) / refreshes


def check_exposure(subject: RigUnderTest) -> Measured:
    """Signal, clipping, noise of one frame, and whole refreshes."""
    limits, lit = subject.limits, subject.lit
    signal = subject.white - subject.black
    first, second = subject.photograph(255, "white"), subject.photograph(255, "white")
    noise = float((first - second)[lit].std() / np.sqrt(2) / signal[lit].mean())
    share = float(np.quantile(signal, 0.99)) / subject.full_scale_dn
    clipped = float((first >= subject.full_scale_dn).mean())
    off = 100 * mismatch(subject.exposure_s, subject.refresh_rate_hz)
    rows = (
        Row("white above black", share, "of full scale", limits.signal_share, at_least=True,
            advice="allow a longer exposure, open the iris, or darken the room"),
        Row("clipped pixels with white on", clipped, "of all", limits.clipped_share,
            advice="something glossy, or the shortest exposure is too long: close the iris"),
        Row("temporal noise at white", 100 * noise, "% of white", limits.noise_percent,
            advice="expose longer, open the iris, lower the gain"),
        Row("exposure off a whole number of refreshes", off, "%", limits.mismatch_percent,
            advice="close the iris or take a grey filter, so that white needs at least one refresh"),
    )  # fmt: skip
    numbers = {"exposure_s": subject.exposure_s, "refreshes": subject.exposure_s * subject.refresh_rate_hz}
    return Measured(rows, {"camera.exposure_s": round(subject.exposure_s, 6)}, numbers)


def without_room_light(exposure_s: float, subject: RigUnderTest, light_hz: float) -> float | None:
    """Shortest exposure that holds whole refreshes and whole periods of the room light; None if none is allowed."""
    shortest, longest = subject.exposure_range_s
    for count in range(1, 31):
        candidate_s = count / subject.refresh_rate_hz
        periods = candidate_s * light_hz
        if shortest <= candidate_s <= longest and abs(periods - round(periods)) < 0.02 and round(periods) > 0:
            return candidate_s
    return None
