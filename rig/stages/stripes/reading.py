"""Frames of a session to a map: in the camera's numbers or in light, as the code needs it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from calibration import StructuredLightCode
from calibration.arrays import Frame
from calibration.structured_light.consistency.complements import refuse_stale_frames
from calibration.structured_light.correspondence import Correspondence
from calibration.structured_light.frames import NOISE_SIGMAS
from rig.stages.linear_light import Float32Array, RadiometricCalibration

INVERSE = "-inverse"
_ROWS_HELD = 120
"""About so many rows, and columns as far apart, are held against stale frames."""


def read_code(
    code: StructuredLightCode,
    frame: Callable[[str], NDArray[np.uint16]],
    projector_shape: tuple[int, int],
    radiometric: RadiometricCalibration,
) -> Correspondence:
    """Find the projector pixel that each camera pixel sees, to whole pixels where the code is one of whole pixels.

    Parameters
    ----------
    code
        That was shown.
    frame
        Gives the (H, W, B) frame of a pattern, of `white` and of `black`. [dn]
    projector_shape
        (height, width) that the patterns were made for. [px]
    radiometric
        Noise, saturation and response of the camera.

    Raises
    ------
    CalibrationError
        If frames are missing or their shapes differ, or one is stale: it shows another picture than it should.
    """
    names = code.pattern_names(projector_shape)
    flats = frame("white"), frame("black")
    linear = in_light(flats, radiometric)
    if not has_inverses(names):
        return linear.decode(code, {name: linear.read(frame(name)) for name in names}, projector_shape)
    plain = in_dn(flats, radiometric)
    some = some_pixels(flats[0].shape)
    frames, thinned = dict[str, Frame](), {"white": linear.white[some], "black": linear.black[some]}
    for name in names:
        pixels = frame(name)
        frames[name], thinned[name] = plain.read(pixels), linear.read(pixels[some])
    refuse_stale_frames(thinned, linear.noise_limit[some], linear.saturation, swell=swell_of(radiometric))
    return plain.decode(code, frames, projector_shape)


def in_light(flats: tuple[NDArray[np.uint16], NDArray[np.uint16]], radiometric: RadiometricCalibration) -> FrameReading:
    """Return how frames are read as linear light, by those of white and black."""
    table = radiometric.table()
    return FrameReading.of(flats, partial(_light, table=table), radiometric, table)


def in_dn(flats: tuple[NDArray[np.uint16], NDArray[np.uint16]], radiometric: RadiometricCalibration) -> FrameReading:
    """Return how frames are read in the camera's numbers, by those of white and black."""
    return FrameReading.of(flats, partial(_grey, radiometric=radiometric), radiometric)


@dataclass(frozen=True, eq=False, kw_only=True)
class FrameReading:
    """Frames (H, W, B) as a decoder takes them, (H, W), in a unit."""

    read: Callable[[NDArray[np.uint16]], Frame]
    white: Frame
    black: Frame
    noise_limit: NDArray[np.float64]
    saturation: float

    @classmethod
    def of(
        cls,
        flats: tuple[NDArray[np.uint16], NDArray[np.uint16]],
        read: Callable[[NDArray[np.uint16]], Frame],
        radiometric: RadiometricCalibration,
        table: Float32Array | None = None,
    ) -> FrameReading:
        """Return how frames are read: in digital numbers, or in the light that a table gives for each."""
        white, black = flats
        limit = NOISE_SIGMAS * np.sqrt(2) * radiometric.sum_noise_dn(white, black)
        saturation: float = radiometric.saturation_dn
        darkness = np.maximum(black - radiometric.offset_dn, 0).sum(axis=2)
        if table is not None:
            limit *= np.gradient(table)[((white.astype(np.uint32) + black) // 2).max(axis=2)]
            saturation = float(table[radiometric.saturation_dn])
            darkness = table[black].sum(axis=2)
        # a picture at a mains light's brightest, its inverse at the darkest
        limit += 2 * swell_of(radiometric) * darkness
        return cls(
            read=read,
            white=read(white),
            black=read(black),
            noise_limit=limit,
            saturation=saturation * white.shape[2],
        )

    def decode(
        self, code: StructuredLightCode, frames: Mapping[str, Frame], projector_shape: tuple[int, int]
    ) -> Correspondence:
        """Decode frames that were read so."""
        return code.decode(
            frames,
            projector_shape,
            white=self.white,
            black=self.black,
            noise_limit=self.noise_limit,
            saturation=self.saturation,
        )


def has_inverses(names: Sequence[str]) -> bool:
    """Tell whether each picture is held against its inverse, so that any response of the camera will do."""
    known = set(names)
    return all(name.endswith(INVERSE) or f"{name}{INVERSE}" in known for name in names)


def some_pixels(shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Return every n-th row and column of a picture: enough to hold pictures of a code against each other."""
    return (slice(None, None, max(1, shape[0] // _ROWS_HELD)),) * 2


def swell_of(radiometric: RadiometricCalibration) -> float:
    """Return by what share a mains light makes single frames of black brighter and darker, where it shows most."""
    return max(radiometric.black_swell.values(), default=0.0)


def _light(pixels: NDArray[np.uint16], table: Float32Array) -> Float32Array:
    """(H, W) sum of the bands (H, W, B) in linear light."""
    return np.asarray(table[pixels].sum(axis=2), dtype=np.float32)


def _grey(pixels: NDArray[np.uint16], radiometric: RadiometricCalibration) -> NDArray[np.unsignedinteger]:
    """(H, W) sum of the bands (H, W, B): the code is in each."""
    most = np.min_scalar_type(radiometric.full_scale_dn * pixels.shape[2])
    return np.asarray(pixels.sum(axis=2, dtype=np.promote_types(np.uint16, most)))
