"""A code whose stripes are several times as wide: for lenses that blur its finest ones away."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.arrays import Codes, Float32Array, Frame
from calibration.structured_light.code import StructuredLightCode
from calibration.structured_light.correspondence import ROUNDING_PX, Correspondence
from calibration.structured_light.patterns import Pattern
from calibration.structured_light.phase.gray_phase import GrayPhaseCode
from calibration.structured_light.phase.micro_phase import MicroPhaseCode
from calibration.structured_light.phase.three_frequency import ThreeFrequencyCode
from calibration.structured_light.subpixel import refine_subpixel


def widened(code: StructuredLightCode, times: int) -> StructuredLightCode:
    """Make the stripes of a code wider.

    Parameters
    ----------
    code : StructuredLightCode
        Any; sinusoids of this package get longer periods, of another code each pixel is shown as a square of pixels.
    times : int
        How many times as wide; 1 returns the code itself.

    Returns
    -------
    StructuredLightCode
        Under the same name, with pictures of the same names.
    """
    if times == 1:
        return code
    if isinstance(code, GrayPhaseCode | ThreeFrequencyCode):
        return replace(code, period_px=code.period_px * times)
    if isinstance(code, MicroPhaseCode):
        return replace(code, periods_px=tuple(period * times for period in code.periods_px))
    return WiderCode(code, times)


@dataclass(frozen=True, slots=True)
class WiderCode:
    """A code shown in cells of several pixels: a :class:`~calibration.structured_light.code.StructuredLightCode`."""

    code: StructuredLightCode
    times: int
    """Pixels along a cell."""

    @property
    def name(self) -> str:
        """That of the code."""
        return self.code.name

    @property
    def version(self) -> str:
        """That of the code, and how wide it is."""
        return f"{self.code.version} in cells of {self.times} px"

    def pattern_names(self, projector_shape: tuple[int, int]) -> tuple[str, ...]:
        """Return the names of the pictures in the order in which they are shown.

        Parameters
        ----------
        projector_shape : (height, width)
            Of the projector. [px]

        Returns
        -------
        tuple of str
        """
        return self.code.pattern_names(self._cells(projector_shape))

    def patterns(self, projector_shape: tuple[int, int]) -> Iterator[Pattern]:
        """Yield the pictures, one at a time.

        Parameters
        ----------
        projector_shape : (height, width)
            Of the projector. [px]

        Yields
        ------
        Pattern
        """
        for pattern in self.code.patterns(self._cells(projector_shape)):
            yield Pattern(pattern.name, self._shown(pattern.codes, projector_shape))

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
            One frame of each picture. [dn]
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
            Between cells, by planes through them, and with standard deviations.

        Raises
        ------
        CalibrationError
            If frames are missing or their shapes differ; the message names them.
        """
        shape = self._cells(projector_shape)
        found = refine_subpixel(
            self.code.decode(frames, shape, white=white, black=black, noise_limit=noise_limit, saturation=saturation)
        )
        # Planes are fitted to cells, for it is whole cells that are rounded to; only then are cells made pixels.
        xy = found.projector_xy_px * np.float32(self.times) + np.float32((self.times - 1) / 2)
        sigma = np.full(xy.shape, ROUNDING_PX, np.float32) if found.sigma_px is None else found.sigma_px
        return Correspondence(
            _inside(xy, projector_shape), found.reason, projector_shape, np.asarray(sigma * np.float32(self.times))
        )

    def _cells(self, projector_shape: tuple[int, int]) -> tuple[int, int]:
        height, width = projector_shape
        return -(-height // self.times), -(-width // self.times)

    def _shown(self, codes: Codes, projector_shape: tuple[int, int]) -> Codes:
        height, width = projector_shape
        return np.asarray(np.repeat(np.repeat(codes, self.times, axis=0), self.times, axis=1)[:height, :width])


def _inside(xy_px: Float32Array, projector_shape: tuple[int, int]) -> Float32Array:
    """Coordinates in the picture: the last cell may be cut by its border, and then its middle lies beyond."""
    return np.asarray(np.minimum(xy_px, np.array(projector_shape[::-1], np.float32) - 1))
