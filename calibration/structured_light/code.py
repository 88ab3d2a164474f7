"""What every structured-light code offers, and the codes that come with this package.

A code is a set of pictures and the way back from their photographs to projector pixels. White and black are not among
its pictures: they are photographed for every code, and handed to :meth:`StructuredLightCode.decode`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from calibration.arrays import Frame
from calibration.structured_light.correspondence import Correspondence
from calibration.structured_light.decode import decode_gray
from calibration.structured_light.gray import CodeName, bits_for, gray_code_patterns, pattern_name
from calibration.structured_light.patterns import Pattern


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
            Named and ordered as :meth:`pattern_names` says, codes (H, W) uint8.
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
            One frame of each picture, in the order of their names or another. [dn]
        projector_shape : (height, width)
            That the pictures were made for. [px]
        white, black : (H, W)
            Frames of projector white and black. [dn]
        noise_limit : float or (H, W)
            Differences of two frames below this are noise. [dn]
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


@dataclass(frozen=True, slots=True)
class GrayCode:
    """A Gray code of columns and rows, each picture followed by its inverse: a :class:`StructuredLightCode`."""

    name: CodeName
    """`gray` is the binary-reflected code; `long-run` has no wide and no very fine stripes."""
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
            Most significant bit first, columns before rows.
        """
        height, width = projector_shape
        axes = (("column", width), ("row", height))
        bits = [(axis, bit) for axis, size in axes for bit in reversed(range(bits_for(size)))]
        planes = [pattern_name(self.name, axis, bit) for axis, bit in bits]
        return tuple(name + end for name in planes for end in ("", "-inverse"))

    def patterns(self, projector_shape: tuple[int, int]) -> Iterator[Pattern]:
        """Yield the pictures, one at a time.

        Parameters
        ----------
        projector_shape : (height, width)
            Of the projector. [px]

        Yields
        ------
        Pattern
            Codes (H, W), 0 or 255.
        """
        return gray_code_patterns(projector_shape, code=self.name)

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
            A pixel is lit, and a bit counts, when two frames differ by at least this. [dn]
        saturation : float, optional
            Values from here on are clipped. [dn]

        Returns
        -------
        Correspondence
            Whole projector pixels, halves on the border between two.

        Raises
        ------
        CalibrationError
            If frames are missing or their shapes differ; the message names them.
        """
        return decode_gray(
            frames,
            projector_shape,
            white=white,
            black=black,
            contrast_limit=noise_limit,
            bit_limit=noise_limit,
            saturation=saturation,
            code=self.name,
        )


CODES: Mapping[str, StructuredLightCode] = MappingProxyType(
    {code.name: code for code in (GrayCode("long-run"), GrayCode("gray"))}
)
"""The codes of this package by name."""
