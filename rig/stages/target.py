"""What is to be shown, and by which strategies: a picture of the user's, or one that ships with scikit-image."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig import plug_ins
from rig.errors import UsageError
from rig.files.pictures import astronaut, in_channels, read_picture_of_shape
from rig.profile.tables import ProjectorProfile

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


@dataclass(frozen=True, eq=False)
class CompensationRequest:
    """What is to be shown, and by which strategies."""

    target: Target
    strategies: tuple[str, ...]
    """Known names, `none` first (:func:`check_strategies`)."""


def requested_compensation(
    target: str | Path | None, strategies: tuple[str, ...], projector: ProjectorProfile, *, channels: int, fit: bool
) -> CompensationRequest:
    """Read the picture that is to be shown, and check the names of the strategies.

    Raises what :func:`load_target` and :func:`check_strategies` raise.
    """
    names = check_strategies(strategies)
    return CompensationRequest(load_target(target, projector.shape, fit, channels=channels), names)


def check_strategies(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return known strategies, `none` first, for it is what the others are measured against; `all` is every one.

    Raises UsageError for a name that is not known.
    """
    known = plug_ins.names("strategy", plug_ins.own_strategies())
    names = known if "all" in names else names
    unknown = [name for name in names if name not in known]
    if unknown:
        raise UsageError(f"unknown strategy {', '.join(unknown)}; there are {', '.join(known)}, or all")
    return ("none", *(name for name in dict.fromkeys(names) if name != "none"))


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
        return Target("photograph 'astronaut' of scikit-image, mean 123, sd 46", astronaut(shape, channels))
    return Target(Path(path).name, read_picture_of_shape(path, shape, channels=channels, fit=fit))
