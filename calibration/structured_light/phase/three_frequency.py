"""Three sinusoids of nearly the same fine period, told apart by their beats (heterodyne phase shift)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.arrays import Float32Array, Frame
from calibration.structured_light.correspondence import Correspondence
from calibration.structured_light.frames import frames_of, noise_dn, part
from calibration.structured_light.gray import BOTH_AXES, Axis, size_along
from calibration.structured_light.patterns import Pattern
from calibration.structured_light.phase.sinusoids import PERIOD_PX, STEPS, PhaseReading, decode_phases, phase, steps

_MOST_APART_PX = 0.4
"""Root mean square distance of the three coordinates from their mean. Where the beats are off by one period, neighbours
among the periods differ by 1 px and more, and this is 0.8 px."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ThreeFrequencyCode:
    """Three periods in four phases each: a :class:`~calibration.structured_light.code.StructuredLightCode`.

    The difference of two phases goes round more slowly than either, and the difference of two differences once over
    the picture: from there the periods are counted, coarse to fine. No stripe is wide, so light from other walls
    is the same in all pictures.

    References
    ----------
    C. Reich, R. Ritter, J. Thesing, White light heterodyne principle for 3D-measurement, Proc. SPIE 3100, 1997.
    """

    name: str = "three-frequency"
    period_px: float = PERIOD_PX
    """The middle one of the three."""
    axes: tuple[Axis, ...] = BOTH_AXES
    """What is coded; the other coordinate is NaN."""
    version: str = "1"

    def pattern_names(self, projector_shape: tuple[int, int]) -> tuple[str, ...]:
        """Return the names of the pictures in the order in which they are shown.

        Parameters
        ----------
        projector_shape : (height, width)
            Of the projector. [px]

        Returns
        -------
        tuple of str
            Columns before rows; long periods first.
        """
        del projector_shape
        return tuple(name for axis in self.axes for frequency in range(3) for name in self._names(axis, frequency))

    def patterns(self, projector_shape: tuple[int, int]) -> Iterator[Pattern]:
        """Yield the pictures, one at a time.

        Parameters
        ----------
        projector_shape : (height, width)
            Of the projector. [px]

        Yields
        ------
        Pattern
            Codes (H, W): linear light, 255 is white.
        """
        for axis in self.axes:
            periods = _Beats.of(projector_shape, axis, self.period_px).periods_px
            for frequency, period_px in enumerate(periods):
                shown = steps(projector_shape, axis, period_px)
                yield from map(Pattern, self._names(axis, frequency), shown)

    def decode(
        self,
        frames: Mapping[str, Frame],
        projector_shape: tuple[int, int],
        *,
        white: Frame,
        black: Frame,
        noise_limit: float | NDArray[np.floating],
        saturation: float | None = None,
    ) -> Correspondence:
        """Find the projector pixel that each camera pixel sees.

        Parameters
        ----------
        frames : mapping of pattern name to (H, W)
            One frame of each picture, linear in light. [dn]
        projector_shape : (height, width)
            That the pictures were made for. [px]
        white, black : (H, W)
            Frames of projector white and black. [dn]
        noise_limit : float or (H, W)
            Two standard deviations of the difference of two frames. [dn]
        saturation : float, optional
            Values from here on are clipped. [dn]

        Returns
        -------
        Correspondence
            With sub-pixel coordinates and their standard deviations.

        Raises
        ------
        CalibrationError
            If frames are missing or their shapes differ; the message names them.
        """
        own = frames_of(self.name, frames, self.pattern_names(projector_shape), white=white, black=black)
        read = {
            axis: _BeatAxis(
                beats=_Beats.of(projector_shape, axis, self.period_px),
                frames=tuple(tuple(own[name] for name in self._names(axis, frequency)) for frequency in range(3)),
                noise_dn=noise_dn(noise_limit),
            )
            for axis in self.axes
        }
        return decode_phases(
            read,
            projector_shape,
            frames=list(own.values()),
            white=white,
            black=black,
            contrast_limit=np.asarray(noise_limit),
            saturation=saturation,
        )

    def _names(self, axis: Axis, frequency: int) -> list[str]:
        return [f"{self.name}-{axis}-{frequency}-{step}" for step in range(STEPS)]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Beats:
    """Three numbers of periods over a range that the picture does not quite fill."""

    counts: tuple[int, int, int]
    range_px: float

    @classmethod
    def of(cls, projector_shape: tuple[int, int], axis: Axis, period_px: float) -> _Beats:
        """Choose the numbers: their beats have `slow`, and one more, periods over the range, and those differ by one.

        With `slow` periods the noise that enters each stage of counting is about the same.
        """
        size_px = size_along(projector_shape, axis)
        middle = max(int(np.ceil(size_px / period_px)) + 1, 2)
        slow = max(1, round((middle / (2 * 3**0.5)) ** 0.5))
        return cls(counts=(middle - slow, middle, middle + slow + 1), range_px=middle * period_px)

    @property
    def periods_px(self) -> tuple[float, float, float]:
        """Of the three sinusoids."""
        low, middle, high = self.counts
        return self.range_px / low, self.range_px / middle, self.range_px / high


@dataclass(frozen=True, slots=True, kw_only=True)
class _BeatAxis:
    beats: _Beats
    frames: tuple[tuple[Frame, ...], ...]
    noise_dn: NDArray[np.float32]

    def read(self, rows: slice) -> PhaseReading:
        """Find the coordinates of some rows."""
        phases, amplitudes = zip(*(phase(each, rows) for each in self.frames), strict=True)
        coarse_px = self._coarse_px(phases)
        periods = np.array(self.beats.periods_px, dtype=np.float32)
        each_px = [_unwrapped(p, coarse_px, period) for p, period in zip(phases, periods, strict=True)]
        weights = periods**-2 / (periods**-2).sum()
        position = sum(weight * x for weight, x in zip(weights, each_px, strict=True))
        apart = sum((x - position) ** 2 for x in each_px)
        twice_amplitude = np.minimum(np.minimum(amplitudes[0], amplitudes[1]), amplitudes[2])
        with np.errstate(divide="ignore"):
            angle = part(self.noise_dn, rows) * np.float32(2**0.5 / (2 * np.pi)) / twice_amplitude
        sigma = angle * np.float32((periods**-2).sum() ** -0.5)
        misfit = apart / (2 * (angle * np.float32(periods.mean())) ** 2 + np.float32(1e-6))
        return PhaseReading(
            position_px=self._within(position),
            sigma_px=sigma,
            misfit=misfit,
            ambiguous=np.asarray(apart > np.float32(2 * _MOST_APART_PX**2)),
        )

    def _coarse_px(self, phases: tuple[Float32Array, ...]) -> Float32Array:
        """Coordinate from the beats: counted up from the beat of beats, by the slow one, to the fast one."""
        low, middle, high = self.beats.counts
        beat_low, beat_high = _fraction(phases[1] - phases[0]), _fraction(phases[2] - phases[1])
        slow, fast = middle - low, high - low
        share = _counted(beat_low, slow * _fraction(beat_high - beat_low)) / np.float32(slow)
        share = _counted(_fraction(phases[2] - phases[0]), fast * share) / np.float32(fast)
        return np.asarray(share * np.float32(self.beats.range_px))

    def _within(self, position_px: Float32Array) -> Float32Array:
        """Take coordinates that noise has carried round the range back to its beginning."""
        around, beyond = np.float32(self.beats.range_px), np.float32(self.beats.periods_px[1] / 2)
        return np.asarray(position_px - around * np.floor((position_px + beyond) / around))


def _fraction(cycles: Float32Array) -> Float32Array:
    whole = np.floor(cycles)
    return np.subtract(cycles, whole, out=whole)


def _counted(fraction: Float32Array, about: Float32Array) -> Float32Array:
    """Cycles of which the fraction is known, and the whole number about."""
    whole = np.subtract(about, fraction)
    return np.add(fraction, np.rint(whole, out=whole), out=whole)


def _unwrapped(fraction: Float32Array, about_px: Float32Array, period_px: np.float32) -> Float32Array:
    return np.asarray(_counted(fraction, about_px / period_px) * period_px)
