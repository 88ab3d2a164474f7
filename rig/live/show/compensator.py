"""What computes the projector's codes of each frame."""

from __future__ import annotations

from typing import Protocol

from rig.live.sources.source import Pixels


class FrameReport(Protocol):
    """What is known of the last frame."""

    @property
    def error(self) -> float:
        """Root mean square of predicted minus wanted camera image, share of full scale; NaN if not known."""
        ...


class Compensator(Protocol):
    """Codes of a target picture to codes for the projector, in one call."""

    @property
    def last(self) -> FrameReport | None:
        """Of the last frame; None before the first."""
        ...

    def frame(self, codes: Pixels, out: Pixels | None = None, gain: float = 1.0) -> Pixels:
        """Compute (H, W, 3) projector codes of (H, W, 3) target codes whose brightness is multiplied by ``gain``."""
        ...

    def reset(self) -> None:
        """Forget the frames before."""
        ...
