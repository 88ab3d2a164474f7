"""Where the camera really clips, and how many steps its digital numbers have."""

from __future__ import annotations

import numpy as np

from rig.self_check.rig_under_test import FloatArray, RigUnderTest
from rig.self_check.rows import Measured, Row

_OVER = (2.0, 4.0, 8.0)
_SPIKE = 0.002
"""Share of pixels that have exactly the largest value once there is clipping."""


def check_saturation(subject: RigUnderTest) -> Measured:
    """Overexpose white until a spike stands at the top of the histogram."""
    limits = subject.limits
    clip_dn, over = _clip_level_dn(subject)
    share = None if clip_dn is None else clip_dn / subject.full_scale_dn
    step_dn = smallest_step_dn(subject)
    missing = f"white does not clip at {over:g} x the working exposure; allow longer exposures"
    rows = (
        Row("level at which the camera clips", share, "of full scale", limits.clip_share, at_least=True,
            advice=missing if share is None else
            f"it clips at {clip_dn:.0f} dn: full range instead of 16 to 235, gain higher, or a smaller bit_depth"),
        Row("step between digital numbers", step_dn, "dn", limits.step_dn,
            advice="bit_depth in the profile is larger than what the camera gives: take its real pixel format"),
    )  # fmt: skip
    return Measured(rows, {}, {"clip_dn": clip_dn, "step_dn": step_dn})


def _clip_level_dn(subject: RigUnderTest) -> tuple[float | None, float]:
    """Digital number at which many pixels stop, and how much more than the working exposure was tried."""
    over = 1.0
    for over in _OVER:
        exposure_s = min(over * subject.exposure_s, subject.exposure_range_s[1])
        image = subject.photograph(255, "white", exposure_s)
        top = float(image.max())
        if _is_spike(image, top):
            return top, over
    return None, over


def _is_spike(image: FloatArray, top: float) -> bool:
    """More pixels at the top than just below it."""
    at_top, below = float((image == top).mean()), float(((image < top) & (image >= 0.98 * top)).mean())
    return at_top > _SPIKE and at_top > below


def smallest_step_dn(subject: RigUnderTest) -> float:
    """Greatest common divisor of the digital numbers that occur; their step."""
    values = np.unique(subject.shoot(255, "white").pixels[..., subject.channel].astype(np.int64))
    return float(np.gcd.reduce(np.diff(values))) if len(values) > 1 else 1.0
