"""Pictures sampled between their pixels."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def sample_bands(image: FloatArray, xy_px: FloatArray) -> FloatArray:
    """Return (N, B) samples of an image (H, W, B), as :func:`sample` takes them."""
    return np.stack([sample(image[..., b], xy_px) for b in range(image.shape[-1])], axis=-1)


def sample(image: FloatArray, xy_px: FloatArray) -> FloatArray:
    """Return (N,) bilinear samples; NaN where a point is outside or touches a pixel that is 0 or NaN."""
    usable = np.isfinite(image) & (image != 0)
    xy = np.where(np.isfinite(xy_px), xy_px, -10.0).astype(np.float32)
    x, y = (np.ascontiguousarray(xy[None, :, k]) for k in (0, 1))
    values = _remap(np.where(usable, image, 0.0), x, y)
    whole = _remap(usable.astype(np.float64), x, y) > 1 - 1e-6
    return np.where(whole, values, np.nan)


def sample_smooth(image: FloatArray, xy_px: FloatArray) -> FloatArray:
    """Return (N, B) bilinear samples of an image (H, W, B) in which 0 is a value like any other; 0 outside."""
    xy = np.where(np.isfinite(xy_px), xy_px, -10.0).astype(np.float32)
    x, y = (np.ascontiguousarray(xy[None, :, k]) for k in (0, 1))
    return np.stack([_remap(image[..., b], x, y) for b in range(image.shape[-1])], axis=-1)


def _remap(image: FloatArray, x: NDArray[np.float32], y: NDArray[np.float32]) -> FloatArray:
    # OpenCV's remap takes at most 32,767 columns.
    step = 30_000
    parts = [
        cv2.remap(image.astype(np.float32), x[:, k : k + step], y[:, k : k + step], cv2.INTER_LINEAR)[0]
        for k in range(0, x.shape[1], step)
    ]
    return np.concatenate(parts).astype(np.float64)
