"""Whether every code makes its own light: the steps of an eight-bit path, up to both ends."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rig.self_check.rig_under_test import FloatArray, RigUnderTest
from rig.self_check.rows import Measured, Row

_COARSE = tuple(range(0, 256, 16))
_MIDDLE = tuple(range(112, 129))
_UPPER = tuple(range(236, 256))
_DARK_END = (0, 15)
_DARK_REPEATS = 4
_SIGMAS = 3.0


def check_ramp(subject: RigUnderTest) -> Measured:
    """Order of all levels; single steps in the middle and at the upper end; light at both ends."""
    codes = sorted({*_COARSE, *_MIDDLE, *_UPPER, 255})
    light = {code: _mean(subject, code) for code in codes}
    again = {code: _mean(subject, code) for code in (128, 255)}
    noise = max(_sigma(subject), *(abs(again[code] - light[code]) / np.sqrt(2) for code in again))
    fallen = _fallen(light, noise)
    middle, upper = _steps(light, _MIDDLE, noise), _steps(light, _UPPER, noise)
    dark = _dark_end_sigmas(subject)
    bright = float((light[255] - light[236]) / (np.sqrt(2) * noise))
    limits = subject.limits
    limited = "limited range: set the output or the projector to full RGB (0 to 255)"
    bits = "the path has fewer than eight bits, or a picture mode lifts them: 8 bpc, dynamic contrast off"
    rows = (
        Row("steps of the ramp that go down", float(fallen), "steps", 0.0, advice=bits),
        Row("codes 112 to 128 that differ from the one before", middle, "of all", limits.step_share, at_least=True,
            advice=bits),
        Row("codes 236 to 255 that differ from the one before", upper, "of all", limits.step_share, at_least=True,
            advice=limited),
        Row("light of code 15 over 0", dark, "σ", limits.end_sigmas, at_least=True, advice=limited),
        Row("light of code 255 over 236", bright, "σ", limits.end_sigmas, at_least=True, advice=limited),
    )  # fmt: skip
    numbers = {"codes": codes, "light_dn": [light[code] for code in codes], "noise_dn": noise}
    return Measured(rows, {}, numbers)


def _mean(subject: RigUnderTest, code: int) -> float:
    return float(subject.photograph(code)[subject.lit].mean())


def _sigma(subject: RigUnderTest) -> float:
    """Noise of the mean over all lit pixels of a white frame. [dn]."""
    first, second = subject.photograph(255), subject.photograph(255)
    return float((first - second)[subject.lit].std() / np.sqrt(2) / np.sqrt(subject.lit.sum()))


def _fallen(light: Mapping[int, float], noise: float) -> int:
    values = np.array([light[code] for code in sorted(light)])
    return int((np.diff(values) < -_SIGMAS * np.sqrt(2) * noise).sum())


def _steps(light: Mapping[int, float], codes: tuple[int, ...], noise: float) -> float:
    """Share of neighbouring codes whose light differs by more than noise, or by a third of the usual step."""
    steps = np.diff(np.array([light[code] for code in codes]))
    usual = float(steps.mean())
    enough = min(_SIGMAS * np.sqrt(2) * noise, usual / 3) if usual > 0 else np.inf
    return float((steps > max(enough, 0.2 * usual)).mean())


def _dark_end_sigmas(subject: RigUnderTest) -> float:
    """Light of code 15 over that of code 0, in standard errors; the two in turns, so that drift cancels."""
    exposure_s = min(4 * subject.exposure_s, subject.exposure_range_s[1])
    pairs: list[FloatArray] = []
    for _ in range(_DARK_REPEATS):
        dark, bright = (subject.photograph(code, exposure_s=exposure_s) for code in _DARK_END)
        pairs.append((bright - dark)[subject.lit])
    means = np.array([pair.mean() for pair in pairs])
    by_pixels = float(np.mean([pair.std() for pair in pairs])) / np.sqrt(pairs[0].size * len(pairs))
    by_pairs = float(means.std(ddof=1)) / np.sqrt(len(means))
    return float(means.mean() / max(by_pixels, by_pairs, 1e-9))
