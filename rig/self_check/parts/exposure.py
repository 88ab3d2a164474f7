"""The working exposure, whether light arrives at all, and whether the exposure fits the display's refresh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.radiometry.exposure import ExposureAim, brightest_share, next_exposure, refuse_darkness
from rig.capture.rig import Rig
from rig.profile.schema import Profile
from rig.records import Record, Verdict
from rig.self_check.results import PartResult
from rig.self_check.rig_under_test import RigUnderTest
from rig.stages.error_tree import one_error_tree

_AIM = ExposureAim(share=0.8, accepted=(0.88 * 0.8, 1.12 * 0.8))
"""Lower and wider than a session's: flicker and drift, which are to be measured, must not clip."""
_TRIES = 8
PATIENCE_S = 0.5
"""No display known to us takes longer from its time stamp to light."""
_MOST_REFRESHES = 30
"""Half a second at 60 Hz: a longer exposure is no use to a session."""
_WHOLE_PERIODS = 0.02
"""Of a period of the room light: what an exposure may be off, which leaves 2 % of the ripple."""


def with_generous_latency(profile: Profile, latency_s: float = PATIENCE_S) -> Profile:
    """The profile with another latency: the promised one is to be checked, not trusted."""
    return profile.with_device(profile.projector.model_copy(update={"latency_s": latency_s}))


@one_error_tree()
def prepare_rig(rig: Rig) -> RigUnderTest:
    """Expose projector white at about 80 % of full scale, in whole refreshes if there is room.

    Raises CalibrationFailed when white is not brighter than black.
    """
    tested = RigUnderTest(rig=rig, exposure_s=rig.profile.camera.exposure_s)
    earlier: tuple[float, float] | None = None
    for _ in range(_TRIES):
        frame = tested.shoot(255, "white")
        tested.channel = int(np.argmax(frame.pixels.mean(axis=(0, 1))))
        level = brightest_share(frame.pixels, tested.full_scale_dn)
        chosen_s = next_exposure(tested.exposure_s, level, _AIM, tested.exposure_range_s, earlier=earlier)
        if chosen_s is None:
            break
        earlier = (tested.exposure_s, level)
        tested.exposure_s = rig.set_exposure(chosen_s)
    white, black = (tested.shoot(code, name).pixels for code, name in ((255, "white"), (0, "black")))
    refuse_darkness(white, black, full_scale_dn=tested.full_scale_dn, exposure_s=tested.exposure_s)
    tested.exposure_s = rig.set_exposure(whole_refreshes(tested.exposure_s, tested))
    return tested


def whole_refreshes(exposure_s: float, tested: RigUnderTest) -> float:
    """Next exposure below that is a whole number of refreshes; as it was when that is none, or out of range."""
    count = int(exposure_s * tested.refresh_rate_hz + 0.05)
    whole_s = count / tested.refresh_rate_hz
    shortest, longest = tested.exposure_range_s
    return whole_s if count and shortest <= whole_s <= longest else exposure_s


def mismatch(exposure_s: float, refresh_rate_hz: float) -> float:
    """|t f - round(t f)| / (t f): the largest share of light by which such an exposure can be off."""
    refreshes = exposure_s * refresh_rate_hz
    return abs(refreshes - round(refreshes)) / refreshes


@dataclass(frozen=True, kw_only=True)
class WorkingExposure(Record):
    """The exposure at which all but a few parts measure."""

    exposure_s: float
    refreshes: float
    """How many of the display it holds."""


def check_exposure(tested: RigUnderTest) -> PartResult[WorkingExposure]:
    """Signal, clipping, noise of one frame, and whole refreshes."""
    limits, lit = tested.limits, tested.lit
    signal = tested.white - tested.black
    first, second = tested.photograph(255, "white"), tested.photograph(255, "white")
    noise = float((first - second)[lit].std() / np.sqrt(2) / signal[lit].mean())
    share = float(np.quantile(signal, 0.99)) / tested.full_scale_dn
    clipped = float((first >= tested.full_scale_dn).mean())
    off = 100 * mismatch(tested.exposure_s, tested.refresh_rate_hz)
    verdicts = (
        Verdict(
            what="white above black",
            value=share,
            limit=limits.signal_share,
            unit="of full scale",
            at_least=True,
            advice="allow a longer exposure, open the iris, or darken the room",
        ),
        Verdict(
            what="clipped pixels with white on",
            value=clipped,
            limit=limits.clipped_share,
            unit="of all",
            advice="something glossy, or the shortest exposure is too long: close the iris",
        ),
        Verdict(
            what="temporal noise at white",
            value=100 * noise,
            limit=limits.noise_percent,
            unit="% of white",
            advice="expose longer, open the iris, lower the gain",
        ),
        Verdict(
            what="exposure off a whole number of refreshes",
            value=off,
            limit=limits.mismatch_percent,
            unit="%",
            advice="close the iris or take a grey filter, so that white needs at least one refresh",
        ),
    )
    numbers = WorkingExposure(exposure_s=tested.exposure_s, refreshes=tested.exposure_s * tested.refresh_rate_hz)
    suggested = {"camera.exposure_s": round(tested.exposure_s, 6)}
    return PartResult(verdicts=verdicts, numbers=numbers, suggested=suggested)


def without_room_light(tested: RigUnderTest, light_hz: float) -> float | None:
    """Shortest exposure that holds whole refreshes and whole periods of the room light; None if none is allowed."""
    shortest, longest = tested.exposure_range_s
    for count in range(1, _MOST_REFRESHES + 1):
        candidate_s = count / tested.refresh_rate_hz
        periods = candidate_s * light_hz
        whole = round(periods) > 0 and abs(periods - round(periods)) < _WHOLE_PERIODS
        if shortest <= candidate_s <= longest and whole:
            return candidate_s
    return None
