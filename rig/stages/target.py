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
from rig.files.pictures import LUMINANCE, cover, read_picture

Float32Array = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Target:
    """A picture of the projector's shape in grey levels, 0 … 255, linear light."""

    name: str
    levels: Float32Array
    """(H, W, C); C = 1, or 3 in colour."""

    @property
    def grey(self) -> Float32Array:
        """(H, W) luminance."""
        return _in_channels(self.levels, 1)[..., 0]

    @property
    def sha256(self) -> str:
        """Of the grey levels."""
        return hashlib.sha256(np.ascontiguousarray(self.levels).tobytes()).hexdigest()


def load_target(path: str | Path | None, shape: tuple[int, int], fit: bool = False, *, channels: int = 1) -> Target:
    """Read a target. For a grey rig colour is turned to grey by Rec. 709 luminance; in colour, grey is a colour, too.

    Parameters
    ----------
    path
        Of the picture; None: a photograph that ships with scikit-image, with mean 123 and sd 46.
    shape
        (height, width) of the projector.
    fit
        Scale and crop a picture of another size.
    channels
        C of the target.

    Raises
    ------
    UsageError
        The file is missing, unreadable, of another size (unless `fit`), too bright, or not finite.
    """
    if path is None:
        levels = _rescaled(_fitted(_in_channels(_photograph(), channels), shape))
        return Target("photograph 'astronaut' of scikit-image, mean 123, sd 46", levels)
    picture = _in_channels(read_picture(path), channels)
    if picture.shape[:2] != shape and not fit:
        raise UsageError(
            f"{path}: {picture.shape[1]} x {picture.shape[0]} px, but the projector has {shape[1]} x {shape[0]} px; "
            "resize the picture, or add --fit to crop and scale it"
        )
    picture = picture if picture.shape[:2] == shape else _fitted(picture, shape)
    if picture.max() > 255.001:
        raise UsageError(f"{path}: grey levels up to {picture.max():.4g}, the limit is 255 (1.0 in an EXR); scale it")
    return Target(Path(path).name, np.ascontiguousarray(picture, dtype=np.float32))


def _in_channels(picture: Float32Array, channels: int) -> Float32Array:
    """(H, W, C) of a picture in grey or colour."""
    if picture.shape[2] == channels:
        return picture
    if channels > 1:
        return np.repeat(picture, channels, axis=2)
    return np.asarray((picture @ LUMINANCE.astype(np.float32))[..., None])


def _photograph() -> Float32Array:
    """A photograph (H, W, 3) that is in the public domain."""
    from skimage.data import astronaut

    read: Callable[[], NDArray[np.uint8]] = astronaut
    return read().astype(np.float32)


def _rescaled(levels: Float32Array) -> Float32Array:
    """Mean 123 and sd 46 over all channels together, as the paper's photograph; iterates, since the range clips."""
    for _ in range(30):
        levels = np.clip((levels - levels.mean()) / max(float(levels.std()), 1e-6) * 46.0 + 123.0, 0.0, 255.0)
    return levels.astype(np.float32)


def _fitted(picture: Float32Array, shape: tuple[int, int]) -> Float32Array:
    """Scale (H, W, C) to cover the shape, and crop what stands over."""
    fitted = cover(picture, shape, cv2.INTER_CUBIC)
    return np.clip(fitted, 0, 255, out=fitted)  # smooth curves overshoot
