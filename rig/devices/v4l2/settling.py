"""When a new exposure is in the frames: told from the frames, not by counting them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

_EVERY = 4
"""Pixels that are looked at: every fourth of every fourth row."""
_SATURATED = 0.95
"""Share of full scale above which a pixel says nothing of the exposure."""
_STEADY_SHARE = 0.01
_STEADY_DN_OF_255 = 0.3
"""Two means agree when they differ by less than a hundredth, or by less than this share of full scale."""
_HAPPENED = 0.3
"""Share of the linear change that has to be seen: a response curve with gamma 2.2 shows about a third to a half."""
_MEASURABLE = 3.0
"""A change is measurable when the part that has to be seen is this many times what counts as steady."""
UNMEASURED_FRAMES = 4
"""Where the change cannot be seen (darkness, saturation) this many frames have to be steady."""


@dataclass(slots=True)
class Settling:
    """Looks at frames after an exposure change, under a still scene, until they are settled.

    Parameters
    ----------
    before
        (H, W, C) digital numbers of a frame with the old exposure.
    ratio
        New exposure over old.
    full_scale_dn
        The largest digital number.
    """

    before: NDArray[np.uint16]
    ratio: float
    full_scale_dn: int
    frames: int = 0
    means: list[float] = field(default_factory=list)
    _usable: NDArray[np.bool_] = field(init=False)
    _before_dn: float = field(init=False)

    def __post_init__(self) -> None:
        sample = self.before[::_EVERY, ::_EVERY]
        limit = _SATURATED * self.full_scale_dn
        self._usable = (sample < limit) & (sample * max(1.0, self.ratio) < limit)
        self._before_dn = self._mean(self.before)

    def add(self, pixels: NDArray[np.uint16]) -> bool:
        """Look at one more frame; True when this one and the last are settled."""
        self.frames += 1
        self.means.append(self._mean(pixels))
        if len(self.means) < 2 or abs(self.means[-1] - self.means[-2]) > self._steady_dn(self.means[-1]):
            return False
        if self.is_measurable:
            return self._has_changed()
        return self._steady_frames() >= UNMEASURED_FRAMES

    @property
    def expected_dn(self) -> float:
        """The change of the mean if the sensor's numbers were in proportion to its exposure."""
        return self._before_dn * (self.ratio - 1.0)

    @property
    def is_measurable(self) -> bool:
        """The change stands out of what two equal frames differ by."""
        steady_dn = self._steady_dn(self._before_dn * max(1.0, self.ratio))
        return _HAPPENED * abs(self.expected_dn) > _MEASURABLE * steady_dn

    def state(self) -> str:
        """For messages: what was expected and what was seen."""
        seen = " ".join(f"{mean:.2f}" for mean in self.means[-4:]) or "none"
        hope = f"{self._before_dn + self.expected_dn:.2f}" if self.is_measurable else "(not measurable)"
        return f"mean of unsaturated pixels before {self._before_dn:.2f} dn, expected about {hope}, seen {seen}"

    def _has_changed(self) -> bool:
        change_dn = self.means[-1] - self._before_dn
        return change_dn / self.expected_dn >= _HAPPENED

    def _steady_frames(self) -> int:
        steady = 1
        while steady < len(self.means) and abs(self.means[-steady] - self.means[-steady - 1]) <= self._steady_dn(
            self.means[-1]
        ):
            steady += 1
        return steady

    def _steady_dn(self, mean_dn: float) -> float:
        return max(_STEADY_SHARE * mean_dn, _STEADY_DN_OF_255 * self.full_scale_dn / 255)

    def _mean(self, pixels: NDArray[np.uint16]) -> float:
        if not self._usable.any():
            return float(pixels[::_EVERY, ::_EVERY].mean())
        return float(pixels[::_EVERY, ::_EVERY][self._usable].mean())
