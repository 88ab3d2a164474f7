"""How wide stripes have to be on this rig: from the contrast that photographs of some widths have."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from calibration.arrays import BoolArray, Float32Array, Frame
from calibration.errors import CalibrationError
from calibration.structured_light.phase.sinusoids import phase

_LEAST_LIT = 100
"""Pixels; fewer say nothing of a picture."""
_SHARE = 0.9
"""Of the lit pixels which the choice has to suit: the rest are edges, and what both lenses leave out of focus."""
_LEAST_CONTRAST = 0.2
"""Of black and white stripes: with less a bit is more noise and light from elsewhere than stripe."""


def sinusoid_contrast(phases: Sequence[Frame], white: Frame, black: Frame) -> Float32Array:
    """Measure which share of a sinusoid's swing arrives at each pixel.

    Parameters
    ----------
    phases : sequence of four (H, W)
        The sinusoid in its four phases, linear in light. [dn]
    white, black : (H, W)
        Frames of projector white and black. [dn]

    Returns
    -------
    (H, W) float32
        1 where neither blur nor light from other walls weakens it.
    """
    _, twice_amplitude = phase(phases, slice(None))
    return np.asarray(twice_amplitude / np.maximum(np.subtract(white, black, dtype=np.float32), 1), np.float32)


def choose_period_px(contrast: Mapping[float, Float32Array], lit: BoolArray) -> float:
    """Choose the period of a phase shift that gives the most exact coordinates.

    The standard deviation of a coordinate is in proportion to the period, and to one over its contrast. Fine stripes
    are better until blur takes their contrast: behind a Gaussian blur of σ px the best period is 2 π σ.

    Parameters
    ----------
    contrast : mapping of period [px] to (H, W)
        As :func:`sinusoid_contrast` measures it.
    lit : (H, W) bool
        Pixels that the projector reaches.

    Returns
    -------
    float
        One of the periods: nine lit pixels out of ten have a standard deviation that is small for all of them. [px]

    Raises
    ------
    CalibrationError
        If hardly a pixel is lit, or no period was measured.
    """
    if not contrast or lit.sum() < _LEAST_LIT:
        raise CalibrationError(
            f"{len(contrast)} periods, {lit.sum()} lit pixels: photograph at least one period, and at least "
            f"{_LEAST_LIT} pixels that the projector lights"
        )
    worst = {period: period / max(_all_but_few(values[lit]), 1e-6) for period, values in contrast.items()}
    return min(worst, key=lambda period: worst[period])


def choose_finest_bit(pairs: Sequence[tuple[Frame, Frame]], white: Frame, black: Frame, lit: BoolArray) -> int:
    """Choose the finest bit of a Gray code whose stripes can still be told from their inverse.

    Parameters
    ----------
    pairs : sequence of two (H, W)
        Pattern and inverse of bit 0, 1, 2 … [dn]
    white, black : (H, W)
        Frames of projector white and black. [dn]
    lit : (H, W) bool
        Pixels that the projector reaches.

    Returns
    -------
    int
        What a code calls its ``finest_bit``.

    Raises
    ------
    CalibrationError
        If no bit's stripes have a fifth of the contrast of white.
    """
    span = np.maximum(np.subtract(white, black, dtype=np.float32), 1)[lit]
    for bit, (pattern, inverse) in enumerate(pairs):
        contrast = np.abs(np.subtract(pattern, inverse, dtype=np.float32))[lit] / span
        # Half of the pixels lie nearer to an edge of two stripes than to the middle of one, whatever the blur.
        if lit.sum() >= _LEAST_LIT and float(np.median(contrast)) >= _LEAST_CONTRAST:
            return bit
    raise CalibrationError(
        f"no bit of {len(pairs)} has stripes with {100 * _LEAST_CONTRAST:g} % of the contrast of white: focus both "
        "lenses, or darken the room"
    )


def _all_but_few(values: Float32Array) -> float:
    """Return what nine out of ten values reach."""
    return float(np.quantile(values, 1 - _SHARE))
