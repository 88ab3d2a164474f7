"""A sinusoid of one fine period, and black and white pictures that number its half periods."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.arrays import Frame
from calibration.structured_light.bits import BitPairs, middle
from calibration.structured_light.correspondence import Correspondence, PixelReason
from calibration.structured_light.frames import frames_of, noise_dn, part
from calibration.structured_light.gray import BOTH_AXES, Axis, across, bits_for, positions, size_along, words
from calibration.structured_light.patterns import WHITE, Pattern
from calibration.structured_light.phase.sinusoids import (
    PERIOD_PX,
    STEPS,
    PhaseReading,
    decode_phases,
    difference,
    phase,
    steps,
)

_PLAIN_SHARE = 0.03
"""Of white minus black: a bit counts when it is so far from their mean."""
_MOST_OFF = 0.4
"""Periods between the phase and the middle of the half period that the bits name: a quarter where both are right, a
half where they name the next period."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GrayPhaseCode:
    """Gray code and phase shift: a :class:`~calibration.structured_light.code.StructuredLightCode`.

    The half periods are numbered by a Gray code of long runs, so that no picture lights whole walls. As half periods
    are numbered, and not periods, a bit that is open on the border of two numbers does no harm: the phase is well
    within the period that both name.

    References
    ----------
    G. Sansoni, M. Carocci, R. Rodella, Three-dimensional vision based on a combination of gray-code and phase-shift
    light projection, Applied Optics 38(31), 1999.
    """

    name: str = "gray-phase"
    period_px: float = PERIOD_PX
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
            Columns before rows; the bits before the phases.
        """
        names = []
        for axis in self.axes:
            names += self._bit_names(axis, self._bits(projector_shape, axis)) + self._phase_names(axis)
        return tuple(names)

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
            size_px = size_along(projector_shape, axis)
            bits = self._bits(projector_shape, axis)
            word = words("long-run", bits)[(np.arange(size_px) / (self.period_px / 2)).astype(int)]
            for bit, name in zip(reversed(range(bits)), self._bit_names(axis, bits), strict=True):
                stripe = ((word >> bit) & 1).astype(np.uint8) * np.uint8(WHITE)
                yield Pattern(name, across(stripe, projector_shape, axis))
            yield from map(Pattern, self._phase_names(axis), steps(projector_shape, axis, self.period_px))

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
        mean = middle(white, black)
        least = np.maximum(noise_limit, np.float32(_PLAIN_SHARE) * difference(white, black))
        read = {}
        for axis in self.axes:
            bits = self._bits(projector_shape, axis)
            read[axis] = _GrayPhaseAxis(
                period_px=self.period_px,
                pairs=BitPairs.of(
                    [(own[name], mean) for name in self._bit_names(axis, bits)], least, positions("long-run", bits)
                ),
                phases=tuple(own[name] for name in self._phase_names(axis)),
                noise_dn=noise_dn(noise_limit),
            )
        return decode_phases(
            read,
            projector_shape,
            frames=list(own.values()),
            white=white,
            black=black,
            contrast_limit=np.asarray(noise_limit),
            saturation=saturation,
        )

    def _bits(self, projector_shape: tuple[int, int], axis: Axis) -> int:
        size_px = size_along(projector_shape, axis)
        return bits_for(int((size_px - 1) / (self.period_px / 2)) + 1)

    def _bit_names(self, axis: Axis, bits: int) -> list[str]:
        return [f"{self.name}-{axis}-{bit:02d}" for bit in reversed(range(bits))]

    def _phase_names(self, axis: Axis) -> list[str]:
        return [f"{self.name}-{axis}-phase-{step}" for step in range(STEPS)]


@dataclass(frozen=True, slots=True, kw_only=True)
class _GrayPhaseAxis:
    period_px: float
    pairs: BitPairs
    phases: tuple[Frame, ...]
    noise_dn: NDArray[np.float32]

    def read(self, rows: slice) -> PhaseReading:
        """Find the coordinates of some rows."""
        shape = self.phases[0][rows].shape
        twice, reason = np.empty(shape, dtype=np.uint16), np.zeros(shape, dtype=np.uint8)
        self.pairs.read(rows, twice, reason)
        half_px = self.period_px / 2
        middle_px = twice * np.float32(half_px / 2) + np.float32((half_px - 1) / 2)
        cycles, twice_amplitude = phase(self.phases, rows)
        about = middle_px / np.float32(self.period_px)
        counted = cycles + np.rint(about - cycles)
        noise = part(self.noise_dn, rows)
        with np.errstate(divide="ignore"):
            sigma = noise * np.float32(self.period_px * 2**0.5 / (2 * np.pi)) / twice_amplitude
        i0, i1, i2, i3 = (frame[rows] for frame in self.phases)
        left = difference(i0, i1) + difference(i2, i3)
        return PhaseReading(
            position_px=counted * np.float32(self.period_px),
            sigma_px=sigma,
            misfit=np.asarray(left**2 / (4 * noise**2 + np.float32(1e-6)), dtype=np.float32),
            ambiguous=np.abs(counted - about) > _MOST_OFF,
            uncertain_bit=np.asarray(reason != PixelReason.VALID),
        )
