"""What every compensation strategy starts from and returns; here each is measured against ``direct``."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.compensation.split_transport import SplitTransport, Transport, split_transport_of
from sim.errors import SimulationError
from sim.geometry.scene import BoolArray, FloatArray
from sim.light.colour import ColourTransport

Notes = Mapping[str, float | str]
WORSE = 1 + 1e-6
"""Ratio of errors from which on a strategy says that ``direct`` is better."""


@dataclass(frozen=True, eq=False)
class Compensation:
    """A projector image, and the camera image that the model expects of it; (n,) grey or (n, C) in colour."""

    projector_image: FloatArray
    """p, within the range."""
    predicted: FloatArray
    """T p."""
    clipped: BoolArray
    """Values that the range holds back."""
    residual_rms: float
    """Root mean square of T p - target."""
    iterations: int
    seconds: float
    """Of the strategy itself."""
    notes: Notes = field(default_factory=dict)
    """What the strategy has to say. ``worse_than_direct``, where there is one: how many times the mean or the RMS
    error of ``direct`` this one's is."""


@dataclass(frozen=True, eq=False)
class Problem:
    """A checked request: a transport, a target and the projector's range."""

    view: SplitTransport
    target: FloatArray
    """(n, C)."""
    lower: float
    upper: float
    grey: bool
    """The caller's images are (n,)."""
    started_s: float

    def clamped(self, wanted: FloatArray) -> FloatArray:
        """Clamp to the projector's range."""
        return np.clip(wanted, self.lower, self.upper)

    def out_of_range(self, wanted: FloatArray) -> BoolArray:
        """Tell where a wanted image leaves the projector's range."""
        return np.asarray((wanted < self.lower) | (wanted > self.upper))

    def finished(
        self, wanted: FloatArray, iterations: int = 1, notes: Notes | None = None, held: BoolArray | None = None
    ) -> Compensation:
        """Clamp a wanted projector image (n, C) to the range, predict what it gives, and compare with ``direct``.

        Parameters
        ----------
        held : (n, C) bool, optional
            Values that the range holds back; default: where ``wanted`` leaves it.
        """
        seconds = time.perf_counter() - self.started_s
        p = self.clamped(wanted)
        predicted = self.view.forward(p)
        clipped = self.out_of_range(wanted) if held is None else held
        said = dict(notes or {}) | self._compared(predicted)
        rms = float(np.sqrt(np.mean((predicted - self.target) ** 2)))
        return Compensation(
            self._shaped(p), self._shaped(predicted), self._shaped(clipped), rms, iterations, seconds, said
        )

    def _compared(self, predicted: FloatArray) -> dict[str, float]:
        by_direct = self.view.forward(self.clamped(self.view.by_direct(self.target)))
        ours, direct = (np.abs(seen - self.target) for seen in (predicted, by_direct))
        # An error of direct that is roundoff is no measure.
        least = max(1e-9 * float(np.abs(self.target).max(initial=0.0)), np.finfo(float).tiny)
        worse = max(
            float(ours.mean()) / max(float(direct.mean()), least),
            float(np.linalg.norm(ours)) / max(float(np.linalg.norm(direct)), least * ours.size**0.5),
        )
        return {"worse_than_direct": worse} if worse > WORSE else {}

    def _shaped(self, values: NDArray[Any]) -> NDArray[Any]:
        return values[:, 0] if self.grey else np.ascontiguousarray(values)


def prepare(transport: Transport, target: ArrayLike, lower: float, upper: float) -> Problem:
    """Check what a strategy is asked.

    Raises
    ------
    SimulationError
        For a target of the wrong shape or not finite, an empty range, or a transport that is not the projector's view.
    """
    started_s = time.perf_counter()
    values = np.asarray(target, dtype=np.float64)
    colour = isinstance(transport, ColourTransport)
    channels = transport.channels if isinstance(transport, ColourTransport) else 1
    pixels = transport.shape[0] // channels
    if values.shape != ((pixels, channels) if colour else (pixels,)):
        bands = f" of {channels} bands" if colour else ""
        raise SimulationError(f"target of shape {values.shape}; the transport has {pixels} camera pixels{bands}")
    if not np.isfinite(values).all():
        raise SimulationError(f"target: {int((~np.isfinite(values)).sum())} of {values.size} values not finite")
    if not lower < upper:
        raise SimulationError(f"projector range {lower:g} ... {upper:g} is empty; lower must be below upper")
    return Problem(
        split_transport_of(transport),
        np.asfortranarray(values.reshape(pixels, channels)),
        lower,
        upper,
        not colour,
        started_s,
    )
