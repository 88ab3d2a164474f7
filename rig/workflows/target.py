"""The picture to show: a file of the user's, or a photograph that ships with scikit-image."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.images import read_picture

Float32Array = NDArray[np.float32]

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
"""Of red, green and blue (Rec. 709)."""


@dataclass(frozen=True, eq=False)
class Target:
    """A picture of the projector's shape in grey levels, 0 … 255, linear light."""

    name: str
    grey: Float32Array
    """(H, W)."""

    @property
    def sha256(self) -> str:
        """Of the grey levels."""
        return hashlib.sha256(np.ascontiguousarray(self.grey).tobytes()).hexdigest()


def load_target(path: Path | None, shape: tuple[int, int], fit: bool = False) -> Target:
    """Read a target; colour is turned to grey by Rec. 709 luminance.

    Raises UsageError for a file that is missing, unreadable, of another size (unless `fit`), or not finite.
    """
    if path is None:
        return Target("photograph 'astronaut' of scikit-image, mean 123, sd 46", default_picture(shape))
    picture = read_picture(path)
    grey = picture @ _LUMINANCE if picture.shape[2] == 3 else picture[..., 0]
    if grey.shape != shape and not fit:
        raise UsageError(
            f"{path}: {grey.shape[1]} x {grey.shape[0]} px, but the projector has {shape[1]} x {shape[0]} px; "
            "resize the picture, or add --fit to crop and scale it"
        )
    grey = grey if grey.shape == shape else _fitted(grey, shape)
    if grey.max() > 255.001:
        raise UsageError(f"{path}: grey levels up to {grey.max():.4g}, the limit is 255 (1.0 in an EXR); scale it")
    return Target(path.name, np.ascontiguousarray(grey, dtype=np.float32))


def default_picture(shape: tuple[int, int]) -> Float32Array:
    """A photograph of the projector's shape, rescaled to mean 123 and standard deviation 46."""
    from skimage.data import astronaut

    read: Callable[[], NDArray[np.uint8]] = astronaut
    grey = _fitted(read().astype(np.float32) @ _LUMINANCE, shape)
    for _ in range(30):
        grey = np.clip((grey - grey.mean()) / max(float(grey.std()), 1e-6) * 46.0 + 123.0, 0.0, 255.0)
    return grey.astype(np.float32)


def _fitted(grey: Float32Array, shape: tuple[int, int]) -> Float32Array:
    """Scale to cover the shape, and crop what stands over."""
    factor = max(shape[0] / grey.shape[0], shape[1] / grey.shape[1])
    height, width = (max(s, round(n * factor)) for n, s in zip(grey.shape, shape, strict=True))
    method = cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC
    scaled = np.clip(cv2.resize(grey, (width, height), interpolation=method), 0, 255)
    top, left = (height - shape[0]) // 2, (width - shape[1]) // 2
    return np.asarray(scaled[top : top + shape[0], left : left + shape[1]], dtype=np.float32)
