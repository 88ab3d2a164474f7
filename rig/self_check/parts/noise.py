"""Photon transfer: variance over signal of pairs of frames gives the gain, the read noise and the full well.

Light comes in electrons, so its variance is its mean; what is left without light is read noise. Both are taken after
the camera's curve is undone, and without the variance of rounding to digital numbers. Every pixel of a pair counts at
the level that it has, so that an unevenly lit wall is an advantage.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from rig.errors import CalibrationFailed
from rig.self_check.parts.linearity import Linear
from rig.self_check.rig_under_test import FloatArray, RigUnderTest
from rig.self_check.rows import Measured, Row

_CODES = (255, 224, 192, 160, 128, 96, 64)
_DARK_PAIRS = 4
_BINS = 24
_TOP = 0.93
"""Brighter pixels may clip in one of the two frames."""
_CURVE = 0.02
"""Relative error of variances by the camera's curve, whose slope is fitted; with many pixels it is the largest."""
_TAIL = 1.96
"""Of a normal distribution: 95 % of it lies within so many standard deviations."""
_BLACK_CLIP = 0.01
"""Share of pixels at 0 without light from which on the noise below it is cut off."""


@dataclass(frozen=True, slots=True)
class Points:
    """Variance of groups of pixels of one level, in linear light."""

    signals: FloatArray
    variances: FloatArray
    counts: FloatArray

    def joined(self, other: Points) -> Points:
        """Both."""
        return Points(
            np.concatenate([self.signals, other.signals]),
            np.concatenate([self.variances, other.variances]),
            np.concatenate([self.counts, other.counts]),
        )


@dataclass(frozen=True, slots=True)
class Transfer:
    """variance = read_variance + signal / gain, with standard errors."""

    gain_e_per_dn: float
    gain_sigma: float
    read_noise_e: float
    read_noise_sigma_e: float
    chi2: float
    """Of the fit, a degree of freedom."""


def points_of(first: FloatArray, second: FloatArray, linear: Linear, step_dn: float, bins: int = _BINS) -> Points:
    """Groups of equally many pixels by level, from two photographs (N,) of the same scene."""
    level = (first + second) / 2
    order = np.argsort(level, kind="stable")
    signals, variances, counts = [], [], []
    for group in np.array_split(order, bins):
        difference = (first - second)[group]
        at = float(level[group].mean())
        rounding = step_dn**2 / 12
        slope = float(linear.slope(np.array(at)))
        signals.append(float(linear.light(np.array(at))))
        variances.append((float(difference.var(ddof=1)) / 2 - rounding) * slope**2)
        counts.append(float(len(group)))
    return Points(np.array(signals), np.array(variances), np.array(counts))


def fit_transfer(points: Points) -> Transfer:
    """Weighted straight line; a variance of n pixels is known to sqrt(2 / n) of itself, and as well as the curve."""
    terms = np.stack([np.ones_like(points.signals), points.signals], axis=1)
    model = np.maximum(points.variances, 1e-3 * points.variances.max())
    for _ in range(5):
        weights = 1 / (model * np.sqrt(2 / points.counts + _CURVE**2))
        fitted = np.linalg.lstsq(terms * weights[:, None], points.variances * weights, rcond=None)[0]
        model = np.maximum(terms @ fitted, 1e-3 * points.variances.max())
    covariance = np.linalg.inv((terms * weights[:, None]).T @ (terms * weights[:, None]))
    chi2 = float((((points.variances - terms @ fitted) * weights) ** 2).sum() / (len(terms) - 2))
    covariance *= max(chi2, 1.0)
    variance, slope = float(fitted[0]), float(fitted[1])
    if slope <= 0:
        raise CalibrationFailed(
            f"noise does not grow with light ({slope:.3g} dn² a dn): noise reduction or heavy compression in the "
            "camera; switch both off"
        )
    gain = 1 / slope
    read_e = gain * float(np.sqrt(max(variance, 0.0)))
    # read² = variance gain²: errors of intercept and slope together
    jacobian = np.array([gain**2, -2 * variance * gain**3])
    squared_sigma = float(np.sqrt(jacobian @ covariance @ jacobian))
    return Transfer(
        gain, gain**2 * float(np.sqrt(covariance[1, 1])), read_e, squared_sigma / max(2 * read_e, 1e-9), chi2
    )


def check_noise(subject: RigUnderTest, linear: Linear, step_dn: float) -> Measured:
    """Gain, read noise, full well."""
    usable = _usable(subject)
    lit = _pairs(subject, linear, step_dn, usable)
    dark, at_zero = _dark(subject, linear, step_dn, usable)
    clipped = at_zero > _BLACK_CLIP
    points = lit if clipped else lit.joined(dark)
    transfer = fit_transfer(points)
    full_well_e = transfer.gain_e_per_dn * linear.full_scale_dn
    relative = transfer.gain_sigma / transfer.gain_e_per_dn
    cut = "the dark level is 0, noise is cut off there: raise the camera's black level (brightness control)"
    rows = (
        Row("gain", transfer.gain_e_per_dn, "e-/dn"),
        Row("read noise", transfer.read_noise_e, "e-", advice=cut if clipped else ""),
        Row("full well, at full scale", full_well_e, "e-"),
        Row("photon transfer off a straight line", transfer.chi2, "χ² a degree of freedom",
            subject.limits.photon_transfer_chi2,
            advice="noise reduction, sharpening, compression (MJPG) or a vibrating picture; use a raw format"),
        Row("dark pixels at 0", 100 * at_zero, "% of all", 100 * _BLACK_CLIP, advice=cut),
    )  # fmt: skip
    suggested = {"camera.full_well_e": _three_digits(full_well_e)}
    if not clipped:
        suggested["camera.read_noise_e"] = _three_digits(transfer.read_noise_e)
    numbers = {
        "gain_e_per_dn": transfer.gain_e_per_dn,
        "gain_95_percent": _TAIL * transfer.gain_sigma,
        "read_noise_e": transfer.read_noise_e,
        "read_noise_95_percent_e": _TAIL * transfer.read_noise_sigma_e,
        "full_well_e": full_well_e,
        "full_well_95_percent_e": _TAIL * relative * full_well_e,
        "chi2": transfer.chi2,
        "signals_dn": [float(s) for s in points.signals],
        "variances_dn2": [float(v) for v in points.variances],
    }
    return Measured(rows, suggested, numbers)


def _usable(subject: RigUnderTest) -> np.ndarray:
    """(H, W) pixels that do not clip on white."""
    return np.asarray(subject.white < _TOP * subject.full_scale_dn)


def _pairs(subject: RigUnderTest, linear: Linear, step_dn: float, usable: np.ndarray) -> Points:
    parts = []
    for code in _CODES:
        first, second = (subject.photograph(code)[usable] for _ in range(2))
        parts.append(points_of(first, _levelled(second, first, linear), linear, step_dn))
    return _all(parts)


def _levelled(second: FloatArray, first: FloatArray, linear: Linear) -> FloatArray:
    """The second frame as bright as the first: a lamp that flickers is no noise of the camera."""
    ratio = (first.mean() - linear.offset_dn) / max(second.mean() - linear.offset_dn, 1e-9)
    steady = abs(ratio - 1) < 0.05
    return np.asarray(linear.offset_dn + (second - linear.offset_dn) * (ratio if steady else 1.0))


def _dark(subject: RigUnderTest, linear: Linear, step_dn: float, usable: np.ndarray) -> tuple[Points, float]:
    """Projector black at the shortest exposure, and the share of pixels at 0."""
    shortest_s = subject.exposure_range_s[0]
    parts, at_zero = [], 0.0
    for _ in range(_DARK_PAIRS):
        first, second = (subject.photograph(0, "black", shortest_s) for _ in range(2))
        at_zero = max(at_zero, float((first <= 0).mean()))
        parts.append(points_of(first[usable], second[usable], linear, step_dn, bins=1))
    return _all(parts), at_zero


def _all(parts: Iterable[Points]) -> Points:
    first, *rest = parts
    for part in rest:
        first = first.joined(part)
    return first


def _three_digits(value: float) -> float:
    return float(f"{value:.3g}")
