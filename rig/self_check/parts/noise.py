"""Noise of the camera by photon transfer: pairs of frames give the gain, the read noise and the full well.

Gain and read noise are compared with data sheets, so the camera's curve and its rounding are taken out first, and
each has its standard error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.arrays import BoolArray, FloatArray
from calibration.radiometry.photon_transfer import (
    TransferPoints,
    clear_of_black,
    fit_photon_transfer,
    joined,
    linearised,
    transfer_points,
)
from rig.records import Record, Verdict
from rig.self_check.parts.linearity import CameraCurve
from rig.self_check.results import PartResult
from rig.self_check.rig_under_test import RigUnderTest

_CODES = (255, 224, 192, 160, 128, 96, 64)
_DARK_PAIRS = 4
_TOP = 0.93
"""Of full scale: brighter pixels may clip in one of the two frames."""
_TAIL = 1.96
"""Of a normal distribution: 95 % of it lies within so many standard deviations."""
_BLACK_CLIP = 0.01
"""Share of pixels at 0 without light from which on the noise below it is cut off."""
_LEAST_SPAN = 4
"""Steps of the camera that a group spans: even and odd sums of two frames are in it alike."""
_FLICKER = 0.05
"""Of white: frames of a pair that differ by more are not made equal, something else has happened."""
_GAIN, _READ_NOISE, _FULL_WELL = "gain", "read noise", "full well, at full scale"
_LINE = "photon transfer off a straight line"


@dataclass(frozen=True, kw_only=True, eq=False)
class Noise(Record):
    """Photon transfer of the camera."""

    gain_e_per_dn: float
    gain_95_percent: float
    """Half width of the interval that holds the gain at 95 %."""
    read_noise_e: float
    read_noise_95_percent_e: float
    full_well_e: float
    """Electrons at full scale."""
    full_well_95_percent_e: float
    chi2: float
    """Of the straight line, a degree of freedom."""
    signals_dn: FloatArray
    """(K,) of groups of pixels, in linear light."""
    variances_dn2: FloatArray
    """(K,) of these groups."""


def check_noise(tested: RigUnderTest, curve: CameraCurve, step_dn: float) -> PartResult[Noise]:
    """Gain, read noise, full well; only what kept them from being measured where frames are compressed."""
    usable = _usable(tested)
    lit = [] if tested.is_compressed else _lit(tested, usable, step_dn)
    dark, at_zero = _dark(tested, usable)
    clipped = at_zero > _BLACK_CLIP
    cut = "the dark level is 0, noise is cut off there: raise the camera's black level (brightness control)"
    black = Verdict(what="dark pixels at 0", value=100 * at_zero, limit=100 * _BLACK_CLIP, unit="% of all", advice=cut)
    if tested.is_compressed:
        return PartResult(verdicts=(*_untold(), black))
    measured = joined(lit if clipped or tested.black_level.is_clipped else [*lit, *dark])
    points = linearised(clear_of_black(measured, curve.response, curve.known_from_dn), curve.response, step_dn)
    transfer = fit_photon_transfer(points)
    full_well_e = transfer.gain_e_per_dn * float(curve.response.levels[-1])
    relative = transfer.gain_sigma_e_per_dn / transfer.gain_e_per_dn
    verdicts = (
        Verdict(what=_GAIN, value=transfer.gain_e_per_dn, unit="e-/dn"),
        Verdict(what=_READ_NOISE, value=transfer.read_noise_e, unit="e-", advice=cut if clipped else ""),
        Verdict(what=_FULL_WELL, value=full_well_e, unit="e-"),
        Verdict(
            what=_LINE,
            value=transfer.chi2,
            limit=tested.limits.photon_transfer_chi2,
            unit="χ² a degree of freedom",
            advice="noise reduction, sharpening, compression (MJPG) or a vibrating picture; use a raw format",
        ),
        black,
    )
    suggested = {}
    if transfer.chi2 <= tested.limits.photon_transfer_chi2:
        suggested["camera.full_well_e"] = _three_digits(full_well_e)
        if not clipped:
            suggested["camera.read_noise_e"] = _three_digits(transfer.read_noise_e)
    numbers = Noise(
        gain_e_per_dn=transfer.gain_e_per_dn,
        gain_95_percent=_TAIL * transfer.gain_sigma_e_per_dn,
        read_noise_e=transfer.read_noise_e,
        read_noise_95_percent_e=_TAIL * transfer.read_noise_sigma_e,
        full_well_e=full_well_e,
        full_well_95_percent_e=_TAIL * relative * full_well_e,
        chi2=transfer.chi2,
        signals_dn=points.signals,
        variances_dn2=points.variances,
    )
    return PartResult(verdicts=verdicts, numbers=numbers, suggested=suggested)


def _untold() -> tuple[Verdict, ...]:
    """What compression leaves of the noise tells nothing of the sensor."""
    advice = (
        "the frames are JPEG (their noise has seams every 8 pixels): what noise is left is not the sensor's. A session "
        "measures it as it is; for the sensor's use a raw format (GREY, YUYV, Y12), where the camera has one"
    )
    return tuple(Verdict(what=what, value=None, advice=advice) for what in (_GAIN, _READ_NOISE, _FULL_WELL, _LINE))


def _usable(tested: RigUnderTest) -> BoolArray:
    """(H, W) pixels that do not clip on white."""
    return np.asarray(tested.white < _TOP * tested.full_scale_dn)


def _lit(tested: RigUnderTest, usable: BoolArray, step_dn: float) -> list[TransferPoints]:
    """Groups of a pair of frames of each of several codes."""
    room, lamp = (image[usable] for image in (tested.black - tested.offset_dn, tested.white - tested.black))
    sources, parts = np.stack([lamp, room], axis=1), []
    for code in _CODES:
        first, second = (tested.photograph(code)[usable] - tested.offset_dn for _ in range(2))
        level = _brought_level(second, first, sources)
        parts.append(transfer_points(first, level, least_span_dn=_LEAST_SPAN * step_dn))
    return parts


def _brought_level(second: FloatArray, first: FloatArray, sources: FloatArray) -> FloatArray:
    """(N,) the second frame as bright as the first: light of lamp and room (N, 2) that flickers is no noise."""
    change = sources @ np.linalg.lstsq(sources, first - second, rcond=None)[0]
    is_flicker = np.abs(change).mean() < _FLICKER * sources.sum(axis=1).mean()
    return np.asarray(second + change if is_flicker else second)


def _dark(tested: RigUnderTest, usable: BoolArray) -> tuple[list[TransferPoints], float]:
    """Projector black at the shortest exposure, one group a pair, and the share of pixels at 0."""
    shortest_s = tested.exposure_range_s[0]
    parts, at_zero = [], 0.0
    for _ in range(_DARK_PAIRS):
        first, second = (tested.photograph(0, "black", shortest_s) for _ in range(2))
        at_zero = max(at_zero, float((first <= 0).mean()))
        above = (first[usable] - tested.offset_dn, second[usable] - tested.offset_dn)
        parts.append(transfer_points(above[0], above[1] + (above[0].mean() - above[1].mean()), bins=1))
    return parts, at_zero


def _three_digits(value: float) -> float:
    return float(f"{value:.3g}")
