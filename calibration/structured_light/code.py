"""What every structured-light code offers, and the codes that come with this package.

A code is a set of pictures and the way back from their photographs to projector pixels. White and black are not among
its pictures: they are photographed for every code, and handed to :meth:`StructuredLightCode.decode`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from calibration.arrays import Frame
from calibration.structured_light.binary_code import BinaryCode
from calibration.structured_light.correspondence import Correspondence
from calibration.structured_light.patterns import Pattern
from calibration.structured_light.phase.gray_phase import GrayPhaseCode
from calibration.structured_light.phase.micro_phase import MicroPhaseCode
from calibration.structured_light.phase.three_frequency import ThreeFrequencyCode


@runtime_checkable
class StructuredLightCode(Protocol):
    """Pictures that tell a camera which projector pixel it sees, and how to read their photographs.

    Another package offers a code of its own by such an object; nothing is inherited.
    """

    @property
    def name(self) -> str:
        """Word by which the code is chosen; its patterns' names begin with it."""
        ...

    @property
    def version(self) -> str:
        """Changes whenever other pictures or other results come out."""
        ...

    def pattern_names(self, projector_shape: tuple[int, int]) -> tuple[str, ...]:
        """Return the names of the pictures in the order in which they are shown.

        Parameters
        ----------
        projector_shape : (height, width)
            Of the projector. [px]

        Returns
        -------
        tuple of str
            Lower-case letters, digits and hyphens; no name twice.
        """
        ...

    def patterns(self, projector_shape: tuple[int, int]) -> Iterator[Pattern]:
        """Yield the pictures, one at a time.

        Parameters
        ----------
        projector_shape : (height, width)
            Of the projector. [px]

        Yields
        ------
        Pattern
            Named and ordered as :meth:`pattern_names` says, codes (H, W) uint8: linear light, 255 is white. Whoever
            shows them makes up for the projector's response, so that 128 is half of white.
        """
        ...

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
            One frame of each picture, in the order of their names or another; linear in light. [dn]
        projector_shape : (height, width)
            That the pictures were made for. [px]
        white, black : (H, W)
            Frames of projector white and black. [dn]
        noise_limit : float or (H, W)
            Differences of two frames below this are noise: two standard deviations of such a difference. [dn]
        saturation : float, optional
            Values from here on are clipped. [dn]

        Returns
        -------
        Correspondence
            (H, W): the coordinate, or why there is none, for every pixel.

        Raises
        ------
        CalibrationError
            If frames are missing or their shapes differ; the message names them.
        """
        ...


CODES: Mapping[str, StructuredLightCode] = MappingProxyType(
    {
        code.name: code
        for code in (
            BinaryCode(name="long-run", words="long-run"),
            BinaryCode(name="gray", words="gray", version="2"),
            BinaryCode(name="gray-plain", words="gray", inverse=False),
            BinaryCode(name="xor-02", words="xor-02"),
            BinaryCode(name="xor-04", words="xor-04"),
            GrayPhaseCode(),
            ThreeFrequencyCode(),
            MicroPhaseCode(),
        )
    }
)
"""The codes of this package by name: all of columns and rows, so that a session can use them.

A code of one axis is another object: ``dataclasses.replace(CODES["gray"], axes=("column",))``.
"""
