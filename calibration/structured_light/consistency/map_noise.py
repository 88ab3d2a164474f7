"""How rough a correspondence map is by itself, and what a fit to it may leave."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from calibration.arrays import FloatArray

_MOST_SPREAD, SHARED_PX = 1.25, 0.06
"""Of a fit's residual over the noise of its data; beside it, what whole parts of a map are off together. In ten
sessions on random rigs, with geometry within 3 sigmas, and fourteen on ci-tiny up to 0.062 px was left beside the
noise. There is no least: points that are less certain than most count less in a fit than in the noise."""
NOISE_PART_PX = 16
"""Of the picture: much larger than a stripe's width, over which the errors of neighbours go together, much smaller than
a wall."""


def most_left_px(noise_px: float) -> float:
    """Return the largest residual to be expected of a fit to a map of this noise, root mean square. [px]."""
    return float(np.hypot(_MOST_SPREAD * noise_px, SHARED_PX))


def map_noise_px(projector_xy_px: ArrayLike) -> float:
    """Return the noise in pixels of a correspondence map (H, W, 2), both coordinates together.

    Where a surface has no edge, the map of a small part of the picture is a quadratic but for its noise. The median
    over such parts tells it, which edges do not move.
    """
    parts = _whole_parts(np.asarray(projector_xy_px, dtype=np.float64))
    if not len(parts):
        return float("nan")
    y, x = (2 * np.mgrid[0:NOISE_PART_PX, 0:NOISE_PART_PX] / (NOISE_PART_PX - 1) - 1).reshape(2, -1)
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
    fitted, _ = np.linalg.qr(terms)
    left = parts - fitted @ (fitted.T @ parts)
    squares = (left**2).sum(axis=(1, 2)) / (len(x) - terms.shape[1])
    return float(np.sqrt(np.median(squares)))


def _whole_parts(xy: FloatArray) -> FloatArray:
    """(N, pixels, 2) square parts of the map in which every pixel has a partner."""
    rows, columns = (n // NOISE_PART_PX for n in xy.shape[:2])
    cut = xy[: rows * NOISE_PART_PX, : columns * NOISE_PART_PX].reshape(
        (rows, NOISE_PART_PX, columns, NOISE_PART_PX, 2)
    )
    parts = cut.swapaxes(1, 2).reshape(rows * columns, NOISE_PART_PX**2, 2)
    return np.asarray(parts[np.isfinite(parts).all(axis=(1, 2))])
