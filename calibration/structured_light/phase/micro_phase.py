"""Sinusoids of many fine periods, one picture each but for the first (micro phase shifting)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibration.arrays import BoolArray, Float32Array, Frame
from calibration.structured_light.correspondence import Correspondence
from calibration.structured_light.frames import frames_of, noise_dn, part
from calibration.structured_light.gray import BOTH_AXES, Axis, size_along
from calibration.structured_light.patterns import Pattern
from calibration.structured_light.phase.sinusoids import PhaseReading, decode_phases, sinusoid

PERIODS_PX = (16.0, 14.73, 14.93, 17.7, 14.04, 14.48, 14.0, 17.03, 14.65, 14.07)
"""Found by random search: over 4096 px, the pictures of two pixels that are whole first periods apart differ by at
least 0.73 of the amplitude, root of the sum of squares; the search found no more with periods of 14 to 18 px."""
_FIRST_STEPS = 3
_LEAST_LEAD = 9.0
"""By which the next best pixel must fit worse: sum of squares in units of the noise, three standard deviations."""
_MOST_MISFIT = 12.0
"""Mean square of what the frames have left, in units of noise and of what 2 % of contrast would leave."""
_CONTRAST_ERROR = 0.02
"""By which the contrast of the periods differs, by blur and by light from other walls."""
_LONGEST_STEP_PX = 2.0
"""Of the final fit: where it would go further, the start was wrong, and the misfit says so."""
_ONE_THREAD = 200_000
"""Multiplications in a product that OpenBLAS does not spread over threads (its limit: 262,144)."""
_BATCH = 1 << 12
"""Pixels that are compared with all stripes at once: a megabyte of sums of the largest projectors, which stays in the
second-level cache."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MicroPhaseCode:
    """Micro phase shift: a :class:`~calibration.structured_light.code.StructuredLightCode`.

    Three pictures of the first period give mean, amplitude and phase; of every other period one picture is enough,
    and which of the first period's many stripes a pixel is in is found by comparing all. All periods are nearly
    the same, so that blur and light from other walls weaken all alike.

    References
    ----------
    M. Gupta and S. K. Nayar, Micro phase shifting, CVPR 2012.
    """

    name: str = "micro-phase"
    periods_px: tuple[float, ...] = PERIODS_PX
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
            Columns before rows; the three of the first period first.
        """
        del projector_shape
        return tuple(name for axis in self.axes for name in self._names(axis))

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
            for name, (period_px, shift) in zip(self._names(axis), self._shown(), strict=True):
                yield Pattern(name, sinusoid(projector_shape, axis, period_px, shift))

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
            axis: _MicroPhaseAxis(
                shown=tuple(self._shown()),
                size_px=size_along(projector_shape, axis),
                frames=tuple(own[name] for name in self._names(axis)),
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

    def _shown(self) -> list[tuple[float, float]]:
        """Period [px] and shift [cycles] of each picture."""
        first, *others = self.periods_px
        return [(first, step / _FIRST_STEPS) for step in range(_FIRST_STEPS)] + [(other, 0.0) for other in others]

    def _names(self, axis: Axis) -> list[str]:
        return [f"{self.name}-{axis}-{picture:02d}" for picture in range(len(self.periods_px) - 1 + _FIRST_STEPS)]


@dataclass(frozen=True, kw_only=True)
class _MicroPhaseAxis:
    shown: tuple[tuple[float, float], ...]
    size_px: int
    frames: tuple[Frame, ...]
    noise_dn: NDArray[np.float32]

    def read(self, rows: slice) -> PhaseReading:
        """Find the coordinates of some rows."""
        light = np.stack([frame[rows].astype(np.float32).ravel() for frame in self.frames])
        shape = self.frames[0][rows].shape
        noise = np.broadcast_to(part(self.noise_dn, rows), shape).ravel()
        parts = [self._read(light[:, k : k + _BATCH], noise[k : k + _BATCH]) for k in range(0, light.shape[1], _BATCH)]
        position, sigma, misfit, ambiguous = (np.concatenate(each).reshape(shape) for each in zip(*parts, strict=True))
        return PhaseReading(position_px=position, sigma_px=sigma, misfit=misfit, ambiguous=ambiguous)

    def _read(
        self, light: Float32Array, noise: Float32Array
    ) -> tuple[Float32Array, Float32Array, Float32Array, BoolArray]:
        """Coordinate, standard deviation, misfit and doubt of pixels, from their light (pictures, pixels)."""
        mean, amplitude, cycles = _first_phase(light[:_FIRST_STEPS])
        amplitude = np.maximum(amplitude, np.float32(1e-6))
        within_px = cycles * np.float32(self.first_px)
        relative = (light[_FIRST_STEPS:] - mean) / amplitude
        stripe, lead = self._best_stripe(within_px, relative)
        position = within_px + stripe * np.float32(self.first_px)
        position, sigma_per_noise, left = _refined(light, position, self.shown)
        variance = noise**2 + (np.float32(_CONTRAST_ERROR) * amplitude) ** 2
        doubt = (lead * amplitude**2 < _LEAST_LEAD * 2 * variance) | (left > _MOST_MISFIT * variance)
        return position, sigma_per_noise * noise, left / (noise**2 + np.float32(1e-6)), np.asarray(doubt)

    @property
    def first_px(self) -> float:
        """The period that has several pictures."""
        return self.shown[0][0]

    @cached_property
    def _angular(self) -> NDArray[np.float32]:
        """(others, 1) angular frequencies of the periods that have one picture, in radians a pixel."""
        return np.array([[2 * np.pi / period] for period, _ in self.shown[_FIRST_STEPS:]], dtype=np.float32)

    @cached_property
    def _stripes(self) -> tuple[Float32Array, NDArray[np.float32]]:
        """Numbers of the first period's stripes, and the matrix that makes misfits of them from a pixel's features."""
        number = np.arange(-1, int(self.size_px / self.first_px) + 1)
        turned = self._angular.astype(np.float64) * (number * self.first_px)
        cross = [-2 * np.cos(turned), 2 * np.sin(turned)]
        square = [np.cos(2 * turned) / 2, -np.sin(2 * turned) / 2]
        return number.astype(np.float32), np.concatenate(cross + square).astype(np.float32)

    def _best_stripe(self, within_px: Float32Array, relative: Float32Array) -> tuple[Float32Array, Float32Array]:
        """Return the stripe that explains the single pictures best, and how much worse the next best does.

        The misfit Σ (cos ω (x + k λ) − m)² is, for all stripes k at once, a product of features of x and m with a
        matrix: cos (a + b) = cos a cos b − sin a sin b, and cos² likewise of twice the angle.
        """
        number, matrix = self._stripes
        angle = self._angular * within_px
        cosine, sine = np.cos(angle), np.sin(angle)
        features = np.concatenate([relative * cosine, relative * sine, 2 * cosine**2 - 1, 2 * sine * cosine])
        misfit = _small_products(features.T, matrix)
        self._exclude_beyond(within_px, misfit)
        rows = np.arange(len(misfit))
        best = misfit.argmin(axis=1)
        least = misfit[rows, best]
        misfit[rows, best] = np.inf
        return number[best], misfit[rows, misfit.argmin(axis=1)] - least  # twice as quick as min

    def _exclude_beyond(self, within_px: Float32Array, misfit: Float32Array) -> None:
        """Let no pixel be in a stripe beyond the picture: only those at its sides reach so far."""
        number, _ = self._stripes
        for k in np.flatnonzero((number < 0) | ((number + 1) * self.first_px > self.size_px)):
            position = within_px + number[k] * np.float32(self.first_px)
            misfit[np.abs(position - self.size_px / 2) > self.size_px / 2 + 1, k] = np.inf


def _small_products(features: Float32Array, matrix: NDArray[np.float32]) -> Float32Array:
    """(pixels, stripes) product in pieces that the linear algebra does on the thread that asks.

    Strips are on threads of their own already; with a library that spreads each product over all processors, the whole
    decoding takes twice the processor time (measured with OpenBLAS on two cores).
    """
    rows = max(1, _ONE_THREAD // matrix.size)
    whole = len(features) // rows * rows
    stacked = np.ascontiguousarray(features[:whole]).reshape(-1, rows, features.shape[1]) @ matrix
    return np.concatenate([stacked.reshape(whole, matrix.shape[1]), features[whole:] @ matrix])


def _first_phase(light: Float32Array) -> tuple[Float32Array, Float32Array, Float32Array]:
    """Mean, amplitude and phase (0 … 1 of a period) from three pictures a third of a period apart."""
    mean = light.mean(axis=0)
    cosine = (2 * light[0] - light[1] - light[2]) / 3
    sine = (light[1] - light[2]) / np.float32(3**0.5)
    cycles = np.arctan2(sine, cosine) / np.float32(2 * np.pi)
    return mean, np.hypot(cosine, sine), np.asarray(cycles - np.floor(cycles))


def _refined(
    light: Float32Array, position_px: Float32Array, shown: Sequence[tuple[float, float]]
) -> tuple[Float32Array, Float32Array, Float32Array]:
    """Fit mean, amplitude and coordinate to all pictures, by one step of Gauss and Newton.

    Returns the coordinate, its standard deviation for a noise of 1, and the mean square of what is left.
    """
    angular = np.array([[2 * np.pi / period_px] for period_px, _ in shown], dtype=np.float32)
    shift = np.array([[2 * np.pi * shift] for _, shift in shown], dtype=np.float32)
    angle = angular * position_px - shift
    swing, slope = np.cos(angle), -angular * np.sin(angle)
    swing -= swing.mean(axis=0)
    slope -= slope.mean(axis=0)
    left = light - light.mean(axis=0)
    a, b, c = _sum(swing, swing), _sum(swing, slope), _sum(slope, slope)
    f, g = _sum(swing, left), _sum(slope, left)
    determinant = np.maximum(a * c - b * b, np.float32(1e-9))
    amplitude, moved = (f * c - g * b) / determinant, (g * a - f * b) / determinant
    safe = np.maximum(amplitude, np.float32(1e-6))
    square = np.maximum(_sum(left, left) - amplitude * f - moved * g, 0) / (len(shown) - 3)
    step = np.clip(moved / safe, -_LONGEST_STEP_PX, _LONGEST_STEP_PX)
    sigma = np.sqrt(a / determinant) / safe
    return np.asarray(position_px + step, np.float32), np.asarray(sigma, np.float32), np.asarray(square, np.float32)


def _sum(one: Float32Array, other: Float32Array) -> Float32Array:
    return np.asarray(np.einsum("ij,ij->j", one, other))
