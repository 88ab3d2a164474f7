"""Whether a lamp and the light of a room are what they were, from photographs of the same walls before and now."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.arrays import FloatArray
from calibration.errors import CalibrationError

_BLOCKS = 8
"""Along each side of the picture: what is wrong in one place (a moved thing, vignetting) is alike within a block."""
_LEAST_IN_BLOCK, _LEAST_BLOCKS = 10, 4
_OF_MEDIAN = 1.2533
"""Standard error of a median over that of a mean, of normal deviates."""
_LEAST_SIGMA = 1e-5
"""Rounding of a camera's numbers alone brings as much."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LightChange:
    """How much brighter than before, as a share, and its standard deviation."""

    lamp_gain: float
    """Projector's light now over before: 1 is no change."""
    lamp_gain_sigma: float
    room_light: float
    """Light without the projector's, now minus before, as a share of projector white."""
    room_light_sigma: float


def light_change(
    xy_px: FloatArray,
    white: tuple[FloatArray, FloatArray],
    black: tuple[FloatArray, FloatArray],
    *,
    expected: tuple[FloatArray | float, float] = (1.0, 0.0),
    ripple: float = 0.0,
) -> LightChange:
    """Compare the light of a projector and of a room, before and now.

    Parameters
    ----------
    xy_px : (N, 2)
        Camera pixels, spread over the picture. [px]
    white : ((N,), (N,))
        Light of projector white above black at the same places of the walls, before and now.
    black : ((N,), (N,))
        Light while the projector shows black, before and now, in the same unit.
    expected : ((N,) or float, float)
        Ratio of white now over before, by where the devices stand now, and how sure it is: light that was reflected
        more than once does not follow it.
    ripple : float
        Standard deviation of the room's light from frame to frame, share of it.

    Returns
    -------
    LightChange
        Medians of medians over an eighth by an eighth of the picture; sigmas from how these differ.

    Raises
    ------
    CalibrationError
        Too little of the picture is lit to compare.
    """
    (white_before, white_now), (black_before, black_now) = white, black
    usable = (white_before > 0) & np.isfinite(white_before) & np.isfinite(white_now)
    typical = float(np.median(white_before[usable])) if usable.any() else 0.0
    block = _blocks(xy_px)
    ratio = np.where(usable, white_now / np.where(usable, white_before, 1.0) / expected[0], np.nan)
    gains = _medians(ratio, block)
    if typical <= 0 or len(gains) < _LEAST_BLOCKS:
        raise CalibrationError(
            f"only {len(gains)} parts of the picture are lit as before, {_LEAST_BLOCKS} are needed: the projector or "
            "the camera looks elsewhere, or is covered"
        )
    room = _medians((black_now - black_before) / typical, block)
    flicker = ripple * float(np.nanmedian(black_now)) / typical
    return LightChange(
        lamp_gain=float(np.median(gains)),
        lamp_gain_sigma=float(np.hypot(np.hypot(_error(gains), flicker), expected[1])),
        room_light=float(np.median(room)),
        room_light_sigma=float(np.hypot(_error(room), flicker)),
    )


def _blocks(xy_px: FloatArray) -> FloatArray:
    low, high = xy_px.min(axis=0), xy_px.max(axis=0)
    cell = np.minimum((xy_px - low) / np.maximum(high - low, 1.0) * _BLOCKS, _BLOCKS - 1).astype(np.int64)
    return np.asarray(cell[:, 0] * _BLOCKS + cell[:, 1])


def _medians(value: FloatArray, block: FloatArray) -> FloatArray:
    parts = [value[(block == k) & np.isfinite(value)] for k in np.unique(block)]
    return np.array([np.median(part) for part in parts if len(part) >= _LEAST_IN_BLOCK])


def _error(medians: FloatArray) -> float:
    spread = 1.4826 * float(np.median(np.abs(medians - np.median(medians))))
    return max(_OF_MEDIAN * spread / float(np.sqrt(len(medians))), _LEAST_SIGMA)
