"""The curve of sRGB."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def linear_of_srgb(share: NDArray[np.float64]) -> NDArray[np.float64]:
    """Linear light of sRGB codes, both 0 … 1 (IEC 61966-2-1)."""
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def srgb_of_linear(share: NDArray[np.float64]) -> NDArray[np.float64]:
    """SRGB codes of linear light, both 0 … 1 (IEC 61966-2-1)."""
    return np.where(share <= 0.0031308, 12.92 * share, 1.055 * np.maximum(share, 0.0) ** (1 / 2.4) - 0.055)
