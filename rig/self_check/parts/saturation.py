"""Where the camera really clips, and how many steps its digital numbers have."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.arrays import FloatArray
from rig.records import Record, Verdict
from rig.self_check.results import PartResult
from rig.self_check.rig_under_test import RigUnderTest

_OVER = (2.0, 4.0, 8.0)
"""Times the working exposure; dim pixels clip in the last."""
_SPIKE = 0.002
"""Share of pixels that have exactly the largest value once there is clipping."""


@dataclass(frozen=True, kw_only=True)
class Saturation(Record):
    """The top of the camera's scale, and its steps."""

    clip_dn: float | None = None
    """None: nothing clipped."""
    step_dn: float


def check_saturation(tested: RigUnderTest) -> PartResult[Saturation]:
    """Overexpose white until a spike stands at the top of the histogram."""
    limits = tested.limits
    clip_dn, over = _clip_level_dn(tested)
    share = None if clip_dn is None else clip_dn / tested.full_scale_dn
    step_dn = smallest_step_dn(tested)
    missing = f"white does not clip at {over:g} x the working exposure; allow longer exposures"
    verdicts = (
        Verdict(
            what="level at which the camera clips",
            value=share,
            limit=limits.clip_share,
            unit="of full scale",
            at_least=True,
            advice=missing
            if share is None
            else f"it clips at {clip_dn:.0f} dn: full range instead of 16 to 235, gain higher, or a smaller bit_depth",
        ),
        Verdict(
            what="step between digital numbers",
            value=step_dn,
            limit=limits.step_dn,
            unit="dn",
            advice="bit_depth in the profile is larger than what the camera gives: take its real pixel format",
        ),
    )
    return PartResult(verdicts=verdicts, numbers=Saturation(clip_dn=clip_dn, step_dn=step_dn))


def _clip_level_dn(tested: RigUnderTest) -> tuple[float | None, float]:
    """Digital number at which many pixels stop, and how much more than the working exposure was tried."""
    over = 1.0
    for over in _OVER:
        exposure_s = min(over * tested.exposure_s, tested.exposure_range_s[1])
        image = tested.photograph(255, "white", exposure_s)
        top = float(image.max())
        if _is_spike(image, top):
            return top, over
    return None, over


def _is_spike(image: FloatArray, top: float) -> bool:
    """More pixels at the top than just below it."""
    at_top, below = float((image == top).mean()), float(((image < top) & (image >= 0.98 * top)).mean())
    return at_top > _SPIKE and at_top > below


def smallest_step_dn(tested: RigUnderTest) -> float:
    """Greatest common divisor of the digital numbers that occur; their step."""
    values = np.unique(tested.shoot(255, "white").pixels[..., tested.channel].astype(np.int64))
    return float(np.gcd.reduce(np.diff(values))) if len(values) > 1 else 1.0
