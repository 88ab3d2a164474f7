"""Whether every code makes its own light: the steps of an eight-bit path, up to both ends."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from calibration.arrays import FloatArray
from rig.records import Record, Verdict
from rig.self_check.results import PartResult
from rig.self_check.rig_under_test import RigUnderTest

_COARSE = tuple(range(0, 256, 16))
_MIDDLE = tuple(range(112, 129))
_UPPER = tuple(range(236, 256))
_DARK_END = (0, 15)
_DARK_REPEATS = 4
"""Pairs of dark pictures: their scatter says what drift and flicker add to the pixels' noise."""
_SIGMAS = 3.0
"""By which a step has to go down, or up, to be one."""
_OF_USUAL, _LEAST_OF_USUAL = 1 / 3, 0.2
"""Of the mean step: where noise is small, a step below a third of it is missing; where it is large, a fifth counts."""


@dataclass(frozen=True, kw_only=True)
class Ramp(Record):
    """Light of codes, each a picture of its own."""

    codes: tuple[int, ...]
    light_dn: tuple[float, ...]
    """Mean of the lit pixels at each code."""
    noise_dn: float
    """Standard deviation of such a mean."""


def check_ramp(tested: RigUnderTest) -> PartResult[Ramp]:
    """Order of all levels; single steps in the middle and at the upper end; light at both ends."""
    codes = sorted({*_COARSE, *_MIDDLE, *_UPPER, 255})
    light = {code: _mean(tested, code) for code in codes}
    again = {code: _mean(tested, code) for code in (128, 255)}
    noise = max(_sigma(tested), *(abs(again[code] - light[code]) / np.sqrt(2) for code in again))
    fallen = _fallen(light, noise)
    middle, upper = _steps(light, _MIDDLE, noise), _steps(light, _UPPER, noise)
    dark = _dark_end_sigmas(tested)
    bright = float((light[255] - light[236]) / (np.sqrt(2) * noise))
    limits = tested.limits
    limited = "limited range: set the output or the projector to full RGB (0 to 255)"
    bits = "the path has fewer than eight bits, or a picture mode lifts them: 8 bpc, dynamic contrast off"
    verdicts = (
        Verdict(what="steps of the ramp that go down", value=float(fallen), limit=0.0, unit="steps", advice=bits),
        Verdict(
            what="codes 112 to 128 that differ from the one before",
            value=middle,
            limit=limits.step_share,
            unit="of all",
            at_least=True,
            advice=bits,
        ),
        Verdict(
            what="codes 236 to 255 that differ from the one before",
            value=upper,
            limit=limits.step_share,
            unit="of all",
            at_least=True,
            advice=limited,
        ),
        Verdict(
            what="light of code 15 over 0", value=dark, limit=limits.end_sigmas, unit="σ", at_least=True, advice=limited
        ),
        Verdict(
            what="light of code 255 over 236",
            value=bright,
            limit=limits.end_sigmas,
            unit="σ",
            at_least=True,
            advice=limited,
        ),
    )
    numbers = Ramp(codes=tuple(codes), light_dn=tuple(light[code] for code in codes), noise_dn=noise)
    return PartResult(verdicts=verdicts, numbers=numbers)


def _mean(tested: RigUnderTest, code: int) -> float:
    return float(tested.photograph(code)[tested.lit].mean())


def _sigma(tested: RigUnderTest) -> float:
    """Noise of the mean over all lit pixels of a white frame. [dn]."""
    first, second = tested.photograph(255), tested.photograph(255)
    return float((first - second)[tested.lit].std() / np.sqrt(2) / np.sqrt(tested.lit.sum()))


def _fallen(light: Mapping[int, float], noise: float) -> int:
    values = np.array([light[code] for code in sorted(light)])
    return int((np.diff(values) < -_SIGMAS * np.sqrt(2) * noise).sum())


def _steps(light: Mapping[int, float], codes: tuple[int, ...], noise: float) -> float:
    """Share of neighbouring codes whose light differs by more than noise, or by a third of the usual step."""
    steps = np.diff(np.array([light[code] for code in codes]))
    usual = float(steps.mean())
    enough = min(_SIGMAS * np.sqrt(2) * noise, usual * _OF_USUAL) if usual > 0 else np.inf
    return float((steps > max(enough, _LEAST_OF_USUAL * usual)).mean())


def _dark_end_sigmas(tested: RigUnderTest) -> float:
    """Light of code 15 over that of code 0, in standard errors; the two in turns, so that drift cancels."""
    exposure_s = min(4 * tested.exposure_s, tested.exposure_range_s[1])
    pairs: list[FloatArray] = []
    for _ in range(_DARK_REPEATS):
        dark, bright = (tested.photograph(code, exposure_s=exposure_s) for code in _DARK_END)
        pairs.append((bright - dark)[tested.lit])
    means = np.array([pair.mean() for pair in pairs])
    by_pixels = float(np.mean([pair.std() for pair in pairs])) / np.sqrt(pairs[0].size * len(pairs))
    by_pairs = float(means.std(ddof=1)) / np.sqrt(len(means))
    return float(means.mean() / max(by_pixels, by_pairs, 1e-9))
