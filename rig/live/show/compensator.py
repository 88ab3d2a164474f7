"""What computes the projector's codes of each frame, one for each strategy."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np

from rig.live.sources.source import Pixels
from sim.frame.compensator import FrameCompensator, FrameModel

STRATEGIES = ("exact", "bounded")


class FrameError(Protocol):
    """What is known of the last frame."""

    @property
    def error(self) -> float:
        """Root mean square of predicted minus wanted camera image, share of full scale; NaN if not known."""
        ...


class Compensator(Protocol):
    """Codes of a target picture to codes for the projector, in one call."""

    @property
    def last(self) -> FrameError | None:
        """The report of the last frame; None before the first."""
        ...

    def frame(self, codes: Pixels, out: Pixels | None = None, gain: float = 1.0) -> Pixels:
        """Compute (H, W, 3) projector codes of (H, W, 3) target codes whose brightness is multiplied by ``gain``."""
        ...

    def reset(self) -> None:
        """Forget the frames before."""
        ...


def warm_compensators(model: FrameModel, threads: int) -> Mapping[str, Compensator]:
    """One for each strategy, which has computed a frame already: a first one takes longer than the others."""
    compensators = {
        "exact": FrameCompensator(model, "exact", threads),
        "bounded": FrameCompensator(model, "bounded", threads),
    }
    codes = np.zeros((*model.shape, 3), np.uint8)
    for compensator in compensators.values():
        compensator.frame(codes, np.empty_like(codes))
        compensator.reset()
    return compensators
