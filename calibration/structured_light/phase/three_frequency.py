"""Three sinusoids of nearly the same fine period, told apart by their beats (heterodyne phase shift)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.arrays import Frame
from calibration.structured_light.correspondence import Correspondence
from calibration.structured_light.frames import frames_of, noise_dn
from calibration.structured_light.gray import BOTH_AXES, Axis
from calibration.structured_light.patterns import Pattern
from calibration.structured_light.phase.beats import FREQUENCIES, BeatAxis, Beats
from calibration.structured_light.phase.sinusoids import PERIOD_PX, STEPS, decode_phases, steps


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
        return tuple(
            name for axis in self.axes for frequency in range(FREQUENCIES) for name in self._names(axis, frequency)
        )

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
            periods = Beats.of(projector_shape, axis, self.period_px).periods_px
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
            axis: BeatAxis.of(
                Beats.of(projector_shape, axis, self.period_px),
                [own[name] for frequency in range(FREQUENCIES) for name in self._names(axis, frequency)],
                noise_dn(noise_limit),
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
