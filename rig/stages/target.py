"""The picture to show: a file of the user's, or a photograph that ships with scikit-image."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.files.pictures import in_channels, read_picture_of_shape

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
        return in_channels(self.levels, 1)[..., 0]

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
        from rig.files.photographs import astronaut  # here, for it takes scikit-image

        return Target("photograph 'astronaut' of scikit-image, mean 123, sd 46", astronaut(shape, channels))
    return Target(Path(path).name, read_picture_of_shape(path, shape, channels=channels, fit=fit))
