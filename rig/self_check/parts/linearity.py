"""Whether digital numbers are proportional to light: a still picture at rising exposures.

The exposures are whole refreshes where the camera allows eight of them, with a grey code that fills them; otherwise
equal steps of one that white fills, and then a display that makes its light in turns adds its own ripple.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.errors import CalibrationFailed
from rig.self_check.rig_under_test import FloatArray, RigUnderTest, line_through
from rig.self_check.rows import Measured, Row

_STEPS = 8
_TOP = 0.9
"""Brightest level of the sweep, share of full scale."""
_CODES = range(255, 31, -8)


@dataclass(frozen=True, slots=True)
class Sweep:
    """Signal (above the dark level) of pixels of one level over exposure."""

    code: int
    whole_refreshes: bool
    exposures_s: FloatArray
    signals_dn: FloatArray
    full_scale_dn: float
    """Above the dark level."""

    def straight(self) -> tuple[float, float, float]:
        """Largest residual of a straight line, share of the brightest signal; R²; slope. [-, -, dn/s]."""
        slope, intercept = line_through(self.exposures_s, self.signals_dn)
        residual = self.signals_dn - slope * self.exposures_s - intercept
        spread = float(((self.signals_dn - self.signals_dn.mean()) ** 2).sum())
        return (
            float(np.abs(residual).max() / self.signals_dn.max()),
            1 - float((residual**2).sum()) / spread,
            slope,
        )

    def coefficients(self) -> FloatArray:
        """(3,) light = a y + b y² + c y³ with y = share of full scale; 1 at full scale."""
        y = self.signals_dn / self.full_scale_dn
        terms = np.stack([y, y**2, y**3, np.ones_like(y)], axis=1)
        fitted = np.linalg.lstsq(terms, self.exposures_s / self.exposures_s.max(), rcond=None)[0][:3]
        return np.asarray(fitted / fitted.sum())


@dataclass(frozen=True, slots=True)
class Linear:
    """From digital numbers to linear light, in the unit in which full scale stays what it is."""

    offset_dn: float
    full_scale_dn: float
    """Above the offset."""
    coefficients: FloatArray

    def light(self, digital: NDArray[np.float64]) -> FloatArray:
        """Linear light. [dn at full scale]."""
        y = (digital - self.offset_dn) / self.full_scale_dn
        a, b, c = self.coefficients
        return np.asarray(self.full_scale_dn * y * (a + y * (b + y * c)))

    def slope(self, digital: NDArray[np.float64]) -> FloatArray:
        """Change of light with the digital number."""
        y = (digital - self.offset_dn) / self.full_scale_dn
        a, b, c = self.coefficients
        return np.asarray(a + y * (2 * b + 3 * c * y))


def measure_sweep(subject: RigUnderTest) -> Sweep:
    """Photograph the sweep. Raises CalibrationFailed when no exposure fills the pixels."""
    top_s, whole = _longest_s(subject)
    code = _filling_code(subject, top_s) if whole else 255
    if not whole:
        level = float((subject.white - subject.offset_dn)[subject.one_level].mean()) / subject.full_scale_dn
        top_s = min(subject.exposure_s * _TOP / level, subject.exposure_range_s[1])
    exposures, signals = [], []
    for step in range(1, _STEPS + 1):
        wanted_s = max(top_s * step / _STEPS, subject.exposure_range_s[0])
        frames = [subject.shoot(code, f"level-{code:03d}", wanted_s) for _ in range(2)]
        exposures.append(frames[0].exposure_s)
        signals.append(np.mean([subject.pixels(f)[subject.one_level].mean() for f in frames]) - subject.offset_dn)
    if len(set(exposures)) < 4:
        raise CalibrationFailed(
            f"the camera took {len(set(exposures))} different exposures of {_STEPS} that were asked for up to "
            f"{top_s:.4g} s; check exposure_range_s against what the camera does"
        )
    return Sweep(code, whole, np.array(exposures), np.array(signals), subject.full_scale_dn - subject.offset_dn)


def _longest_s(subject: RigUnderTest) -> tuple[float, bool]:
    """Eight refreshes, if white fills less than them and the camera allows so much."""
    period_s = _STEPS / subject.refresh_rate_hz
    return period_s, period_s <= subject.exposure_range_s[1]


def _filling_code(subject: RigUnderTest, exposure_s: float) -> int:
    """Brightest code that keeps the judged pixels below the top of the scale at an exposure."""
    low, high = 0, len(_CODES) - 1
    while low < high:
        middle = (low + high) // 2
        image = subject.photograph(_CODES[middle], f"level-{_CODES[middle]:03d}", exposure_s)
        if float(image[subject.one_level].mean()) > _TOP * subject.full_scale_dn:
            low = middle + 1
        else:
            high = middle
    return _CODES[low]


def linear_of(subject: RigUnderTest, sweep: Sweep) -> Linear:
    """What undoes the camera's curve."""
    return Linear(subject.offset_dn, sweep.full_scale_dn, sweep.coefficients())


def check_linearity(subject: RigUnderTest, sweep: Sweep) -> Measured:
    """Residual of a straight line, R²."""
    limits = subject.limits
    residual, r_squared, slope = sweep.straight()
    note = "" if sweep.whole_refreshes else " (the exposures are no whole refreshes: a colour wheel shows here, too)"
    rows = (
        Row("nonlinearity: residual of signal over exposure", 100 * residual, "% of brightest",
            limits.nonlinearity_percent,
            advice="gamma, contrast, black-level and tone curves of the camera off; automatic exposure off" + note),
        Row("R² of signal over exposure", r_squared, "", limits.r_squared, at_least=True,
            advice="as above; if single exposures stick out, the camera does not take every exposure over"),
    )  # fmt: skip
    numbers = {
        "code": sweep.code,
        "whole_refreshes": sweep.whole_refreshes,
        "exposures_s": [float(s) for s in sweep.exposures_s],
        "signals_dn": [float(s) for s in sweep.signals_dn],
        "slope_dn_per_s": slope,
        "dark_level_dn": subject.offset_dn,
        "light_of_share": [float(c) for c in sweep.coefficients()],
    }
    return Measured(rows, {}, numbers)
