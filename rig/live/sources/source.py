"""What a source of pictures is, and what its end and its failures are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rig.errors import UsageError

Pixels = NDArray[np.uint8]


class SourceBroken(UsageError):
    """A source that cannot be read, or not any further."""

    exit_code = 24


class CameraMissing(SourceBroken):
    """A camera that is to be shown is not there, or went away."""

    exit_code = 20


class FilmBroken(SourceBroken):
    """A film that cannot be read, or breaks off."""

    exit_code = 21


class PictureBroken(SourceBroken):
    """A picture that is none, or a folder without one that can be read."""

    exit_code = 22


class SourceGone(SourceBroken):
    """A film, picture or folder that was there when the show was planned, and is there no more."""

    exit_code = 23


class PipeBroken(SourceBroken):
    """A pipe, standard input or shared memory that gives no pictures, or broke off."""


class SourceEnded(Exception):
    """A source has no more pictures; its arguments, if any, tell what was passed over last."""


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A picture as its source gave it; the memory is the source's, good until its next one."""

    pixels: Pixels
    """(H, W, 3), of any size."""
    is_bgr: bool = False
    """Blue first, as OpenCV has it; else red first."""
    told: tuple[str, ...] = ()
    """What a person has to know: what the source could not give before it, and why; how its colours were taken."""


class Source(Protocol):
    """Pictures, one after the other; used by one thread."""

    @property
    def name(self) -> str:
        """The source in words, for people."""
        ...

    @property
    def frame_rate_hz(self) -> float | None:
        """Known once it is open: pictures a second; None for pictures that come when they come."""
        ...

    def open(self) -> None:
        """Begin with its first picture. Raises SourceBroken or DeviceError."""
        ...

    def read(self, timeout_s: float, /) -> Picture | None:
        """Give the next picture; None when none came in that time.

        Raises SourceEnded, SourceBroken, DeviceError.
        """
        ...

    def close(self) -> None:
        """Let it go; any number of times, from any state."""
        ...
