"""Whether signal is proportional to exposure: a straight line, and how far the signals lie off it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.arrays import FloatArray


@dataclass(frozen=True, kw_only=True)
class StraightLine:
    """A straight line through signals over exposure, by least squares."""

    slope: float
    """Signal a unit of exposure. [dn/s]"""
    intercept: float
    """Signal at exposure 0. [dn]"""
    residual_share: float
    """Largest distance from the line, share of the brightest signal. [1]"""
    r_squared: float
    """Share of the signals' variance that the line explains. [1]"""
    slope_sigma: float
    """Standard error of the slope, from the scatter about the line. [dn/s]"""


def fit_linearity(exposures: FloatArray, signals: FloatArray) -> StraightLine:
    """Fit a straight line to signals over exposure, or over time.

    Parameters
    ----------
    exposures : (K,)
        At least two different ones. [s]
    signals : (K,)
        Mean signal above the dark level at each. [dn]

    Returns
    -------
    StraightLine
        The line, and how far the signals lie off it.

    References
    ----------
    EMVA Standard 1288, Standard for Characterization of Image Sensors and Cameras, section on linearity.
    """
    deviation = exposures - exposures.mean()
    slope = float(np.mean(deviation * (signals - signals.mean())) / np.mean(deviation**2))
    intercept = float(signals.mean() - slope * exposures.mean())
    residual = signals - slope * exposures - intercept
    squares = float((residual**2).sum())
    spread = float(((signals - signals.mean()) ** 2).sum())
    return StraightLine(
        slope=slope,
        intercept=intercept,
        residual_share=float(np.abs(residual).max() / signals.max()),
        r_squared=1 - squares / spread if spread > 0 else 1.0,
        slope_sigma=float(np.sqrt(squares / max(len(signals) - 2, 1) / (deviation**2).sum())),
    )
