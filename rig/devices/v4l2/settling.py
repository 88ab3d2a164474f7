"""When a new exposure is in the frames: told from the frames, not by counting them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

_EVERY = 4
"""Pixels that are looked at: every fourth of every fourth row."""
_SATURATED = 0.95
"""Share of full scale above which a pixel says nothing of the exposure."""
_BLACK_SHARE = 0.01
"""The darkest hundredth of the pixels is taken for black: sensors add a level that no exposure changes."""
_STEADY_SHARE = 0.01
"""Of the mean: two frames nearer than that have one exposure."""
_STEADY_DN_OF_255 = 0.3
"""Two means agree when they differ by less than a hundredth, or by less than this share of full scale."""
_HAPPENED = 0.3
"""Share of the linear change that has to be seen: a response curve with gamma 2.2 shows about a third to a half."""
_MEASURABLE = 3.0
"""A change is measurable when the part that has to be seen is this many times what counts as steady."""
_ABOVE_NOISE = 3.0
"""What stands above black by fewer standard deviations of the noise is no light that an exposure would raise."""
_DARKEST_SIGMAS = 2.33
"""The darkest hundredth of normal noise lies so many standard deviations below its mean."""
_LEAST_NOISE_DN = 0.5
"""A whole number may be off by so much."""
_QUIET_HALF = 0.143
"""Mean of a squared normal deviate up to its median: 1 - 2 * 0.6745 * 0.3178 / 0.5, which edges cannot raise."""
UNMEASURED_FRAMES = 4
"""Where the change cannot be seen (darkness, saturation) so many frames have to be steady, or more."""


@dataclass(slots=True, kw_only=True)
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
    unmeasured_frames
        How many frames have to be steady where the change cannot be seen.
    black_dn
        The darkest that frames of this camera and gain were before, if there were any.
    """

    before: NDArray[np.uint16]
    ratio: float
    full_scale_dn: int
    unmeasured_frames: int = UNMEASURED_FRAMES
    black_dn: float = np.inf
    """The least that anything is known to have been without light: of a picture that is bright all over, its own
    darkest pixels tell nothing of it. Afterwards what this picture says, too."""
    means: list[float] = field(default_factory=list)
    """Of the frames so far, in dn."""
    expected_dn: float = field(init=False)
    """The mean if what stands above the darkest pixels were in proportion to the exposure."""
    _usable: NDArray[np.bool_] = field(init=False)
    _before_dn: float = field(init=False)

    def __post_init__(self) -> None:
        sample = self.before[::_EVERY, ::_EVERY]
        self._usable = sample < _SATURATED * self.full_scale_dn
        if not self._usable.any():
            self._usable[:] = True
        usable = sample[self._usable]
        self._before_dn = float(usable.mean())
        noise_dn = _noise_dn(self.before)
        own_dn = min(np.quantile(usable, _BLACK_SHARE) + _DARKEST_SIGMAS * noise_dn, np.median(usable))
        self.black_dn = min(self.black_dn, float(own_dn))
        light_dn = np.where(usable > self.black_dn + _ABOVE_NOISE * noise_dn, usable - self.black_dn, 0.0)
        expected = np.minimum(usable + light_dn * (self.ratio - 1), self.full_scale_dn)
        self.expected_dn = float(expected.mean())

    def add(self, pixels: NDArray[np.uint16]) -> bool:
        """Look at one more frame; True when this one and the last are settled."""
        self.means.append(float(pixels[::_EVERY, ::_EVERY][self._usable].mean()))
        if self.is_measurable:
            return self._steady_frames() >= 2 and self._has_changed()
        return self._steady_frames() >= self.unmeasured_frames

    @property
    def is_measurable(self) -> bool:
        """The change stands out of what two equal frames differ by."""
        steady_dn = self._steady_dn(max(self._before_dn, self.expected_dn))
        return _HAPPENED * abs(self.expected_dn - self._before_dn) > _MEASURABLE * steady_dn

    @property
    def frames_it_took(self) -> int:
        """Until the change was seen. 0 where it cannot be seen: so many were waited for as were asked for, and a few.

        Who asked for as many the next time would wait longer with each change.
        """
        return len(self.means) if self.is_measurable else 0

    def state(self) -> str:
        """Return, for messages, what was expected and what was seen."""
        seen = " ".join(f"{mean:.2f}" for mean in self.means[-4:]) or "none"
        expected = f"about {self.expected_dn:.2f}" if self.is_measurable else "no change that can be measured"
        return f"mean of unsaturated pixels before {self._before_dn:.2f} dn, expected {expected}, seen {seen}"

    def _has_changed(self) -> bool:
        return (self.means[-1] - self._before_dn) / (self.expected_dn - self._before_dn) >= _HAPPENED

    def _steady_frames(self) -> int:
        """How many frames, the last among them, have the last one's mean."""
        limit_dn = self._steady_dn(self.means[-1])
        steady = [abs(mean - self.means[-1]) <= limit_dn for mean in reversed(self.means)]
        return steady.index(False) if False in steady else len(steady)

    def _steady_dn(self, mean_dn: float) -> float:
        return max(_STEADY_SHARE * mean_dn, _STEADY_DN_OF_255 * self.full_scale_dn / 255)


def _noise_dn(pixels: NDArray[np.uint16]) -> float:
    """Return the noise of the darker half, in dn: what pixels differ from like neighbours in their row.

    Neighbours at full resolution: pixels further apart differ by what the picture shows, in a checker all of them.
    """
    rows = pixels[::_EVERY].astype(np.float64)
    left, right = rows[:, :-1:_EVERY], rows[:, 1::_EVERY]
    across = (right - left)[left <= np.median(left)]
    squares = np.square(across) if across.size else np.zeros(1)
    usual = squares[squares <= np.quantile(squares, 0.5)].mean()
    return max(float(np.sqrt(usual / (2 * _QUIET_HALF))), _LEAST_NOISE_DN)
