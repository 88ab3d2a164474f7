"""Frames for a live projector: one 8-bit colour picture in, the projector's 8-bit picture out, in one native call.

``frame_model`` prepares a transport once; ``FrameCompensator`` turns frames. ``sim.reference.frame`` is
the definition in numpy and double precision.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sim import _kernel
from sim.arrays import CodeArray
from sim.errors import SimulationError
from sim.frame.codes import checked_frame
from sim.frame.model import CHANNELS, FrameModel, frame_model
from sim.frame.tables import response_cubics, response_tables, target_table

__all__ = ["FrameCompensator", "FrameModel", "FrameReport", "frame_model"]

Strategy = Literal["exact", "bounded"]
STEPS, FIRST_STEPS = 1, 4
"""Steps towards the bounded optimum: from the last frame's, and from the exact inverse for a first frame or a cut."""


@dataclass(frozen=True)
class FrameReport:
    """About the last frame."""

    error: float
    """Root mean square of predicted minus wanted camera image, share of a target's full scale; NaN if not known."""
    clipped_share: float
    """Share of the steered pixels' channels that the projector's range holds back."""
    passes: int
    """Times that the picture was gone through."""


class FrameCompensator:
    """Turns a target's frames into the projector's.

    Parameters
    ----------
    model : FrameModel
    strategy : {"exact", "bounded"}
        ``exact``: the inverse of the light transport, clamped. ``bounded``: the image within the projector's range
        that comes nearest in the sense of least squares, begun from the last frame's.
    threads : int
        The result does not depend on it.

    Raises
    ------
    SimulationError
        For an unknown strategy or less than one thread.
    """

    def __init__(self, model: FrameModel, strategy: Strategy = "exact", threads: int = 2) -> None:
        if strategy not in ("exact", "bounded"):
            raise SimulationError(f"unknown frame strategy {strategy!r}; there are exact, bounded")
        if threads < 1:
            raise SimulationError(f"{threads} threads; give at least 1")
        self.model, self.strategy, self.threads = model, strategy, threads
        self.last = FrameReport(np.nan, 0.0, 0)
        self._channels = max(1, CHANNELS * int(model.active.sum()))
        self._fresh = True
        self._kernel = _kernel.FrameKernel(
            model, response_tables(model), response_cubics(model), np.linalg.inv(model.mixing).astype(np.float64)
        )

    def frame(self, codes: CodeArray, out: CodeArray | None = None, gain: float = 1.0) -> CodeArray:
        """Return the projector's codes for a target's.

        Parameters
        ----------
        codes : (H, W, 3) uint8 array
            The target's codes, as the model's ``eotf`` reads them.
        out : (H, W, 3) uint8 array, optional
            Filled and returned; a new array otherwise.
        gain : float
            Times the target's light.

        Returns
        -------
        (H, W, 3) uint8 array
            ``out``, where it is given.

        Raises
        ------
        SimulationError
            For arrays of another type, shape or layout, or a gain that is not a number of 0 or more.
        """
        checked_frame(self.model, codes)
        if not (np.isfinite(gain) and gain >= 0):
            raise SimulationError(f"gain {gain:g}; give a finite number of 0 or more")
        result = np.empty_like(codes) if out is None else checked_frame(self.model, out, "out")
        target = target_table(self.model, gain)
        if self.strategy == "exact":
            clipped = self._kernel.exact(codes, result, target, self.threads)
            self.last = FrameReport(np.nan, clipped / self._channels, 2)
        else:
            self.last = self._bounded(codes, result, target)
        return result

    def reset(self) -> None:
        """Forget the frame before: the next one begins anew."""
        self._fresh = True

    def _bounded(self, codes: CodeArray, out: CodeArray, target: NDArray[np.float32]) -> FrameReport:
        fresh, self._fresh = self._fresh, False
        clipped, squared, passes = self._kernel.bounded(
            codes, out, target, steps=STEPS, first_steps=FIRST_STEPS, fresh=fresh, threads=self.threads
        )
        error = float(np.sqrt(squared / self._channels / np.mean(self.model.target_scale**2)))
        return FrameReport(error, clipped / self._channels, passes)
