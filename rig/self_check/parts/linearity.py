"""How digital numbers rise with light: a still picture at rising exposures.

A camera with a tone curve is as good as a straight one where the same curve fits every exposure.

The exposures are whole refreshes where the camera allows eight of them, with a grey code that fills them; otherwise
equal steps of one that white fills, and then a display that makes its light in turns adds its own ripple.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.arrays import FloatArray
from calibration.radiometry.camera_response import fit_camera_response
from calibration.radiometry.linearity import fit_linearity
from calibration.radiometry.response import Response, ideal_levels
from rig.errors import CalibrationFailed
from rig.records import Record, Verdict
from rig.self_check.results import PartResult
from rig.self_check.rig_under_test import RigUnderTest

_STEPS = 8
"""Of the sweep: enough for a curve of three terms and its residual."""
_LEAST_STEPS = 4
"""Different exposures: fewer say nothing about a curve."""
_TOP = 0.9
"""Brightest level of the sweep, share of full scale."""
_FEW = 0.1
"""Of the pixels, at the shortest exposure: a webcam's curve (sRGB, 8 bits) was true to 0.1 % above their level, and
3 to 18 % too steep below it."""
_CODES = range(255, 31, -8)
_SAMPLES = 6000
"""Lit pixels that the camera's curve is fitted to: dark and bright ones together tell it best."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """Pixels of one level over exposure."""

    code: int
    whole_refreshes: bool
    exposures_s: FloatArray
    """(K,)"""
    levels_dn: FloatArray
    """(K, N) each pixel above the dark level, mean of two frames."""
    full_scale_dn: float
    """Above the dark level."""
    samples_dn: FloatArray
    """(2 K, M) lit pixels above the dark level, in each of the two frames."""

    @property
    def signals_dn(self) -> FloatArray:
        """(K,) mean of the pixels."""
        return np.asarray(self.levels_dn.mean(axis=1))


@dataclass(frozen=True, slots=True)
class CameraCurve:
    """From digital numbers to linear light, in the unit in which full scale stays what it is."""

    offset_dn: float
    response: Response
    known_from_dn: float
    """Above the dark level: what few pixels of the sweep were below tells hardly anything of the curve there."""

    def light(self, digital: NDArray[np.float64]) -> FloatArray:
        """Linear light. [dn at full scale]."""
        return ideal_levels(self.response, digital - self.offset_dn)


@dataclass(frozen=True, kw_only=True, eq=False)
class Linearity(Record):
    """Signal over exposure."""

    code: int
    """Of the picture."""
    whole_refreshes: bool
    """Whether the exposures are whole refreshes of the display."""
    exposures_s: FloatArray
    """(K,)"""
    signals_dn: FloatArray
    """(K,) above the dark level."""
    slope_dn_per_s: float
    intercept_dn: float
    """Of the straight line."""
    dark_level_dn: float
    light: FloatArray
    """(K,) the signals after the camera's curve is undone."""


def measure_sweep(tested: RigUnderTest) -> Sweep:
    """Photograph the sweep. Raises CalibrationFailed when no exposure fills the pixels."""
    top_s = _STEPS / tested.refresh_rate_hz
    filling = _filling_code(tested, top_s) if top_s <= tested.exposure_range_s[1] else None
    code = 255 if filling is None else filling
    if filling is None:
        level = float((tested.white - tested.offset_dn)[tested.one_level].mean()) / tested.full_scale_dn
        top_s = min(tested.exposure_s * _TOP / level, tested.exposure_range_s[1])
    exposures, levels, samples = [], [], []
    every = max(1, int(tested.lit.sum()) // _SAMPLES)
    for step in range(1, _STEPS + 1):
        wanted_s = max(top_s * step / _STEPS, tested.exposure_range_s[0])
        frames = [tested.shoot(code, f"level-{code:03d}", wanted_s) for _ in range(2)]
        exposures.append(frames[0].exposure_s)
        levels.append(np.mean([tested.pixels(f)[tested.one_level] for f in frames], axis=0) - tested.offset_dn)
        samples += [tested.pixels(frame)[tested.lit][::every] - tested.offset_dn for frame in frames]
    if len(set(exposures)) < _LEAST_STEPS:
        raise CalibrationFailed(
            f"the camera took {len(set(exposures))} different exposures of {_STEPS} that were asked for up to "
            f"{top_s:.4g} s; check exposure_range_s against what the camera does"
        )
    return Sweep(
        code=code,
        whole_refreshes=filling is not None,
        exposures_s=np.array(exposures),
        levels_dn=np.array(levels),
        full_scale_dn=tested.full_scale_dn - tested.offset_dn,
        samples_dn=np.array(samples),
    )


def _filling_code(tested: RigUnderTest, exposure_s: float) -> int | None:
    """Brightest code that keeps the judged pixels below the top of the scale at an exposure.

    None where light on black, of a room or of the display, fills them alone.
    """

    def fits(code: int) -> bool:
        image = tested.photograph(code, f"level-{code:03d}", exposure_s)
        return float(image[tested.one_level].mean()) <= _TOP * tested.full_scale_dn

    low, high = 0, len(_CODES) - 1
    if not fits(_CODES[high]):
        return None
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if fits(_CODES[middle]) else (middle + 1, high)
    return _CODES[low]


def camera_curve(tested: RigUnderTest, sweep: Sweep) -> CameraCurve:
    """What undoes the camera's curve. Raises CalibrationError when the sweep does not tell it."""
    return curve_of(tested, sweep.samples_dn, np.repeat(sweep.exposures_s, 2))


def curve_of(tested: RigUnderTest, samples_dn: FloatArray, exposures: FloatArray) -> CameraCurve:
    """The same of pixels (F, N) above the dark level at exposures (F,) in any unit. Raises CalibrationError."""
    full_scale_dn, sigma = tested.full_scale_dn - tested.offset_dn, tested.black_level.sigma_dn
    response = fit_camera_response(
        samples_dn, exposures, full_scale_dn, black_dn=tested.offset_dn, black_sigma_dn=sigma
    )
    shortest = samples_dn[exposures == exposures.min()]
    return CameraCurve(tested.offset_dn, response, known_from_dn=float(np.quantile(shortest, _FEW)))


def straight_curve(tested: RigUnderTest) -> CameraCurve:
    """Of a camera about which nothing is known: proportional to light."""
    full_scale_dn = tested.full_scale_dn - tested.offset_dn
    straight = Response(np.array([0.0, full_scale_dn]), np.array([0.0, 1.0]), 0.0)
    return CameraCurve(tested.offset_dn, straight, known_from_dn=0.0)


def _gamma(response: Response) -> float:
    """Power law between a hundredth of the light of full scale and all of it."""
    low = float(np.interp(0.01, response.linear, response.levels)) / response.levels[-1]
    return float(np.log(0.01) / np.log(low))


def check_linearity(tested: RigUnderTest, sweep: Sweep, curve: CameraCurve) -> PartResult[Linearity]:
    """Residual of a straight line, R², and of the camera's own curve."""
    limits = tested.limits
    line = fit_linearity(sweep.exposures_s, sweep.signals_dn)
    note = "" if sweep.whole_refreshes else " (the exposures are no whole refreshes: a colour wheel shows here, too)"
    advice = "gamma, contrast and tone curves of the camera off, where it can: dark places get finer steps"
    light = ideal_levels(curve.response, sweep.levels_dn).mean(axis=1)
    left = fit_linearity(sweep.exposures_s, light)
    verdicts = (
        Verdict(
            what="nonlinearity: residual of signal over exposure",
            value=100 * line.residual_share,
            unit="% of brightest",
            advice=advice,
        ),
        Verdict(what="R² of signal over exposure", value=line.r_squared, advice=advice),
        Verdict(what="gamma of the camera's curve, black to white", value=_gamma(curve.response)),
        Verdict(
            what="nonlinearity that the camera's curve leaves",
            value=100 * left.residual_share,
            limit=limits.nonlinearity_percent,
            unit="% of brightest",
            advice="automatic exposure, auto tone mapping, backlight compensation of the camera off; if single "
            "exposures stick out, the camera does not take every exposure over" + note,
        ),
    )
    numbers = Linearity(
        code=sweep.code,
        whole_refreshes=sweep.whole_refreshes,
        exposures_s=sweep.exposures_s,
        signals_dn=sweep.signals_dn,
        slope_dn_per_s=line.slope,
        intercept_dn=line.intercept,
        dark_level_dn=tested.offset_dn,
        light=light,
    )
    return PartResult(verdicts=verdicts, numbers=numbers)
