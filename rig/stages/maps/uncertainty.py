"""How well the light of white is known at each camera pixel: its split, its place and its width in the projector's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.files.channels import image_of
from rig.session import Session

FloatArray = NDArray[np.float64]

SMOOTHING_SHARE = 0.003
"""Spread of the smoothing of light's shares along walls, of the picture's width."""
SPLIT_BIAS = 0.004
"""Relative standard deviation of all direct light together: `direct_bias_percent` of eleven sessions that
`benchmarks/calibration/random_rigs.py` ran was 0.34 % rms (decision 57). What differs between
pixels, the frames tell."""
_MOST_SPLIT = 0.3
"""Of one pixel's direct light: where the frames leave more, its share is its neighbours'."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LightUncertainty:
    """Standard deviations by what the frames of the checkers leave."""

    split: FloatArray
    """(H, W, B) of direct light, relative, its share smoothed over neighbours."""
    place_px: FloatArray
    """(H, W) of the place in the projector's picture that a camera pixel sees, along an axis."""
    variance_px2: FloatArray
    """(H, W, 2) of the blur's variance there, along columns and rows."""


def light_uncertainty(session: Session) -> LightUncertainty:
    """Return what the finished step `separation` found of its own errors."""
    step = session.finished("separation")
    direct = image_of(step.load_image("separation"), "direct").astype(np.float64)
    maps = step.load_image("blur")
    variance = image_of(maps, "direct_variance").astype(np.float64)
    sigma = np.stack([maps["variance_sigma_x"], maps["variance_sigma_y"]], axis=-1).astype(np.float64)
    # A Gaussian's mean over noise of its own in each pixel: 4 π σ² pixels count.
    pixels = max(4 * np.pi * (SMOOTHING_SHARE * direct.shape[1]) ** 2, 1.0)
    return LightUncertainty(
        split=np.minimum(np.sqrt(variance) / np.maximum(direct, 1e-9), _MOST_SPLIT) / np.sqrt(pixels),
        place_px=np.sqrt(maps["place_variance"].astype(np.float64)),
        variance_px2=np.nan_to_num(sigma),
    )
