"""How wide stripes have to be on this rig: from the contrast that photographs of two widths have."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from math import ceil

import numpy as np
from numpy.typing import NDArray

from calibration.arrays import BoolArray, Float32Array, Frame
from calibration.structured_light.code import StructuredLightCode
from calibration.structured_light.frames import frames_of
from calibration.structured_light.gray import BOTH_AXES, Axis
from calibration.structured_light.patterns import Pattern
from calibration.structured_light.phase.gray_phase import GrayPhaseCode
from calibration.structured_light.phase.micro_phase import MicroPhaseCode
from calibration.structured_light.phase.sinusoids import PERIOD_PX, sinusoid
from calibration.structured_light.phase.three_frequency import ThreeFrequencyCode

BLUR_PERIODS_PX = (16.0, 64.0)
"""The first is halved by a blur of 3 px and leaves a fiftieth behind one of 7; the second hardly knows either."""
_LEAST_LIT = 100
"""Pixels; fewer say nothing of a picture."""
_CLEAR = 3.0
"""Noise limits by which wide stripes swing where the projector's own light is told from light of other walls."""
_SHARE = 0.9
"""Of the lit pixels which the choice has to suit: the rest are edges, and what both lenses leave out of focus."""
_LEAST_SHARE = 0.005
"""Of the contrast of wide stripes: with less it is noise, and the blur at least so much."""
_BLUR_PX = {"long-run": 2.0, "xor-04": 1.3, "xor-02": 0.8}
"""Up to here nine of ten pixels that are read when all is sharp are read, and hardly one wrong: blur of 1 to 4.5 px in
a closed room of reflectance 0.5, `benchmarks/calibration/blurred_codes.py`."""
_FINE_BLUR_PX = 0.7
"""Of codes with stripes of one and two pixels, and of those that nothing is known of."""
_MOST_TIMES = 8


@dataclass(frozen=True, eq=False, kw_only=True)
class StripeBlur:
    """What stripes of two periods tell: where the projector's own light is, and how wide both lenses make a line."""

    lit: BoolArray
    """(H, W) pixels in which wide stripes can be told from noise."""
    sigma_px: float
    """Standard deviation, which nine of ten of these pixels do not exceed. [projector px]"""


def blur_patterns(projector_shape: tuple[int, int]) -> Iterator[Pattern]:
    """Yield sinusoids of a fine and a wide period, each twice along both axes, a quarter of a period apart.

    Parameters
    ----------
    projector_shape : (height, width)
        Of the projector. [px]

    Yields
    ------
    Pattern
        Codes (H, W): linear light, 255 is white.
    """
    for axis, period_px in product(BOTH_AXES, BLUR_PERIODS_PX):
        for name, shift in zip(_names(axis, period_px), (0.0, 0.25), strict=True):
            yield Pattern(name, sinusoid(projector_shape, axis, period_px, shift))


def blur_of_stripes(
    frames: Mapping[str, Frame], white: Frame, black: Frame, noise_limit: float | NDArray[np.floating]
) -> StripeBlur:
    """Tell blur from light of other walls: both weaken fine stripes, but only blur spares wide ones.

    A sinusoid is half of white at the mean, wherever a pixel is, so that two pictures a quarter of a period apart give
    its amplitude. Behind a Gaussian blur of σ px the amplitude of period T is exp(−2 π² σ² / T²) of the whole.

    Parameters
    ----------
    frames : mapping of pattern name to (H, W)
        Of :func:`blur_patterns`, linear in light. [dn]
    white, black : (H, W)
        Frames of projector white and black, linear in light. [dn]
    noise_limit : float or (H, W)
        Two standard deviations of the difference of two frames. [dn]

    Returns
    -------
    StripeBlur
        A σ of 0 where hardly a pixel is lit: nothing is known then.

    Raises
    ------
    CalibrationError
        If a frame is missing.
    """
    names = [name for axis, period_px in product(BOTH_AXES, BLUR_PERIODS_PX) for name in _names(axis, period_px)]
    own = frames_of("blur", frames, names, white=white, black=black)
    mean = (white.astype(np.float32) + black) / 2
    fine, wide = (
        np.stack([np.hypot(*(own[name] - mean for name in _names(axis, period_px))) for axis in BOTH_AXES])
        for period_px in BLUR_PERIODS_PX
    )
    lit = np.asarray((wide > _CLEAR * np.asarray(noise_limit, np.float32)).all(axis=0))
    if lit.sum() < _LEAST_LIT:
        return StripeBlur(lit=lit, sigma_px=0.0)
    share = np.minimum((fine[:, lit] / wide[:, lit]).min(axis=0), 1)
    left = max(_all_but_few(share), _LEAST_SHARE)
    short, long = BLUR_PERIODS_PX
    per_variance = 2 * np.pi**2 * (short**-2 - long**-2)
    return StripeBlur(lit=lit, sigma_px=float(np.sqrt(-np.log(left) / per_variance)))


def times_as_wide(code: StructuredLightCode, sigma_px: float) -> int:
    """Choose how many times as wide a code's stripes have to be behind a blur.

    Parameters
    ----------
    code : StructuredLightCode
    sigma_px : float
        Of both lenses together. [projector px]

    Returns
    -------
    int
        1 where they are wide enough. Sinusoids are best with a period of 2 π σ.
    """
    if isinstance(code, GrayPhaseCode | ThreeFrequencyCode | MicroPhaseCode):
        times = round(2 * np.pi * sigma_px / PERIOD_PX)
    else:
        times = ceil(sigma_px / _BLUR_PX.get(code.name, _FINE_BLUR_PX))
    return min(max(times, 1), _MOST_TIMES)


def _names(axis: Axis, period_px: float) -> list[str]:
    return [f"blur-{axis}-{period_px:.0f}-{quarter}" for quarter in (0, 1)]


def _all_but_few(values: Float32Array) -> float:
    """Return what nine out of ten values reach."""
    return float(np.quantile(values, 1 - _SHARE))
