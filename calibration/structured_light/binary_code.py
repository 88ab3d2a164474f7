"""Codes whose pictures are black and white: a picture a bit, with or without its inverse."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.arrays import Frame
from calibration.structured_light.correspondence import Correspondence
from calibration.structured_light.decode import decode_gray
from calibration.structured_light.frames import frames_of
from calibration.structured_light.gray import (
    BOTH_AXES,
    Axis,
    CodeName,
    bits_for,
    gray_code_patterns,
    pattern_name,
    size_along,
)
from calibration.structured_light.patterns import Pattern

_PLAIN_SHARE = 0.1
"""Of white minus black: a bit without an inverse counts when it is so far from their mean, which light from other walls
moves. In the closed simulated rooms of reflectance 0.7 and 0.9, with 0.05 2 % of what is read are wrong, so none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BinaryCode:
    """A binary code of columns and rows: a :class:`~calibration.structured_light.code.StructuredLightCode`."""

    name: str
    words: CodeName
    """`gray` is the binary-reflected code; `long-run` has no wide and no very fine stripes; `xor-02` and `xor-04` have
    none but fine ones."""
    inverse: bool = True
    """Whether each picture is followed by its complement; without, a bit is held against the mean of white and black.
    """
    axes: tuple[Axis, ...] = BOTH_AXES
    """What is coded; the other coordinate is NaN."""
    finest_bit: int = 0
    """Bits below this one are not shown; only of `gray`."""
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
        names = []
        for axis in self.axes:
            count = bits_for(size_along(projector_shape, axis))
            bits = reversed(range(min(self.finest_bit, count - 1), count))
            names += [pattern_name(self.words, axis, bit) for bit in bits]
        ends = ("", "-inverse") if self.inverse else ("",)
        return tuple(self._own(name) + end for name in names for end in ends)

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
        made = gray_code_patterns(projector_shape, self.inverse, self.words, axes=self.axes, finest_bit=self.finest_bit)
        return (Pattern(self._own(pattern.name), pattern.codes) for pattern in made)

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
        names = self.pattern_names(projector_shape)
        own = frames_of(self.name, frames, names, white=white, black=black)
        bit_limit = noise_limit if self.inverse else _plain_limit(white, black, noise_limit)
        return decode_gray(
            {self.words + name.removeprefix(self.name): frame for name, frame in own.items()},
            projector_shape,
            white=white,
            black=black,
            contrast_limit=noise_limit,
            bit_limit=bit_limit,
            saturation=saturation,
            code=self.words,
            axes=self.axes,
            finest_bit=self.finest_bit,
            own_light=self.inverse and self.words == "gray",
        )

    def _own(self, name: str) -> str:
        return self.name + name.removeprefix(self.words)


def _plain_limit(white: Frame, black: Frame, noise_limit: float | NDArray[np.floating]) -> NDArray[np.floating]:
    return np.asarray(np.maximum(noise_limit, _PLAIN_SHARE * np.subtract(white, black, dtype=np.float32)))
