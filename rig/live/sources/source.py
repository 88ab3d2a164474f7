"""What a source of pictures is, and what its end and its failures are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from rig.errors import UsageError

Pixels = NDArray[np.uint8]


class SourceBroken(UsageError):
    """A source that cannot be read, or not any further."""


class SourceEnded(Exception):
    """A source has no more pictures; nothing is wrong."""


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A picture as its source gave it; the memory is the source's, good until its next one."""

    pixels: Pixels
    """(H, W, 3), of any size."""
    is_bgr: bool = False
    """Blue first, as OpenCV has it; else red first."""


class Source(Protocol):
    """Pictures, one after the other; used by one thread."""

    @property
    def name(self) -> str:
        """In words, for people."""
        ...

    @property
    def frame_rate_hz(self) -> float | None:
        """Known once it is open: pictures a second; None for pictures that come when they come."""
        ...

    def open(self) -> None:
        """Begin with its first picture. Raises SourceBroken or DeviceError."""
        ...

    def read(self, timeout_s: float) -> Picture | None:
        """Give the next picture; None when none came in that time.

        Raises SourceEnded, SourceBroken, DeviceError.
        """
        ...

    def close(self) -> None:
        """Let it go; any number of times, from any state."""
        ...


class Fitter:
    """Scales pictures to cover a shape, and crops what stands over; allocates only when their size changes."""

    def __init__(self, shape: tuple[int, int]):
        self._shape = shape
        self._scaled = np.empty((0, 0, 3), np.uint8)

    def fit(self, picture: Picture, out: Pixels) -> None:
        """Write a picture of any size to ``out``, (H, W, 3) of the shape, red first."""
        pixels = self._covering(picture.pixels)
        top, left = ((n - m) // 2 for n, m in zip(pixels.shape, self._shape, strict=False))
        cropped = pixels[top : top + self._shape[0], left : left + self._shape[1]]
        if picture.is_bgr:
            cv2.cvtColor(cropped, cv2.COLOR_BGR2RGB, dst=out)
        else:
            np.copyto(out, cropped)

    def _covering(self, pixels: Pixels) -> Pixels:
        if pixels.shape[:2] == self._shape:
            return pixels
        factor = max(n / m for n, m in zip(self._shape, pixels.shape, strict=False))
        height, width = (max(n, round(m * factor)) for n, m in zip(self._shape, pixels.shape, strict=False))
        if self._scaled.shape[:2] != (height, width):
            self._scaled = np.empty((height, width, 3), np.uint8)
        method = cv2.INTER_AREA if factor < 1 else cv2.INTER_LINEAR
        cv2.resize(pixels, (width, height), dst=self._scaled, interpolation=method)
        return self._scaled
