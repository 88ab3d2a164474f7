"""Coordinates from three sinusoids and their beats: the definition of the kernel's `read_beats`."""

from __future__ import annotations

import numpy as np

from calibration.arrays import FloatArray
from calibration.structured_light.phase.beats import MOST_APART_PX2, BeatAxis
from calibration.structured_light.phase.sinusoids import STEPS, PhaseReading


def read_beats(axis: BeatAxis) -> PhaseReading:
    """Return the coordinates of an axis, counted up from the beat of beats, by the slow one, to the fast one."""
    phases, amplitudes = zip(
        *(_phase(axis.frames[k : k + STEPS]) for k in range(0, len(axis.frames), STEPS)), strict=True
    )
    periods = np.array(axis.beats.periods_px)[:, None, None]
    about_px = _coarse_px(axis, phases)
    each_px = np.array([_counted(p, about_px / period) * period for p, period in zip(phases, periods, strict=True)])
    position = (each_px * periods**-2).sum(axis=0) / (periods**-2).sum()
    apart = ((each_px - position) ** 2).sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        turns = axis.noise_dn * 2**0.5 / (2 * np.pi) / np.min(amplitudes, axis=0)
        misfit = apart / (2 * (turns * periods.mean()) ** 2 + 1e-6)
    around, beyond = axis.beats.range_px, axis.beats.periods_px[1] / 2
    position = position - around * np.floor((position + beyond) / around)
    return PhaseReading(
        position_px=position.astype(np.float32),
        sigma_px=(turns * (periods**-2).sum() ** -0.5).astype(np.float32),
        misfit=misfit.astype(np.float32),
        ambiguous=apart > MOST_APART_PX2,
    )


def _phase(frames: tuple[FloatArray, ...]) -> tuple[FloatArray, FloatArray]:
    """Phase, 0 to 1 of a period, and twice the amplitude."""
    i0, i1, i2, i3 = (frame.astype(np.float64) for frame in frames)
    return _fraction(np.arctan2(i1 - i3, i0 - i2) / (2 * np.pi)), np.hypot(i0 - i2, i1 - i3)


def _coarse_px(axis: BeatAxis, phases: tuple[FloatArray, ...]) -> FloatArray:
    low, middle, high = axis.beats.counts
    beat_low, beat_high = _fraction(phases[1] - phases[0]), _fraction(phases[2] - phases[1])
    slow, fast = middle - low, high - low
    share = _counted(beat_low, slow * _fraction(beat_high - beat_low)) / slow
    return _counted(_fraction(phases[2] - phases[0]), fast * share) / fast * axis.beats.range_px


def _fraction(cycles: FloatArray) -> FloatArray:
    return np.asarray(cycles - np.floor(cycles))


def _counted(fraction: FloatArray, about: FloatArray) -> FloatArray:
    """Cycles of which the fraction is known, and the whole number about."""
    return np.asarray(fraction + np.rint(about - fraction))
