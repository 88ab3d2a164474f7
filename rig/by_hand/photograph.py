"""What a photograph is worth: how its levels are spread, what is clipped, how sharp it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.devices.protocols import RawFrame
from rig.files.colour.srgb import srgb_of_linear
from rig.records import Record

_BINS = 16
_PARTS = 3
"""Parts of the picture along each side whose sharpness is told."""
_DARK_SHARE = 0.02
"""Of full scale: of pixels that see hardly any light the sharpness says nothing."""
_EIGHT_BITS = 255


@dataclass(frozen=True, kw_only=True)
class PhotographFigures(Record):
    """Figures of one photograph."""

    histogram: tuple[float, ...]
    """Share of the pixels in each sixteenth of the camera's range, dark to bright."""
    mean: float
    """Share of full scale."""
    brightest: float
    """Of the brightest permille, share of full scale."""
    clipped_share: float
    """Of the pixels: at the largest digital number in some band."""
    black_share: float
    """Of the pixels: at 0 in all bands."""
    sharpness: float | None = None
    """Root mean square step of light from pixel to pixel, share of its mean, noise taken off; None of darkness."""
    sharpness_by_part: tuple[tuple[float | None, ...], ...]
    """The same in three by three parts, from the upper left."""


def figures_of(frame: RawFrame, again: RawFrame, full_scale_dn: int) -> PhotographFigures:
    """Return the figures of a photograph, with the help of a second one of the same.

    Parameters
    ----------
    frame, again
        (H, W, C) digital numbers of two exposures of the same scene.
    full_scale_dn
        Largest digital number.

    Returns
    -------
    PhotographFigures
    """
    pixels = frame.pixels
    counts, _ = np.histogram(pixels, bins=_BINS, range=(0, full_scale_dn + 1))
    first, second = (one.pixels.mean(axis=2, dtype=np.float64) / full_scale_dn for one in (frame, again))
    rows = [np.array_split(row, _PARTS, axis=1) for row in np.array_split(np.stack([first, second], -1), _PARTS)]
    return PhotographFigures(
        histogram=tuple((counts / pixels.size).tolist()),
        mean=float(first.mean()),
        brightest=float(np.quantile(pixels, 0.999)) / full_scale_dn,
        clipped_share=float((pixels >= full_scale_dn).any(axis=2).mean()),
        black_share=float((pixels == 0).all(axis=2).mean()),
        sharpness=_sharpness(first, second),
        sharpness_by_part=tuple(tuple(_sharpness(part[..., 0], part[..., 1]) for part in row) for row in rows),
    )


def _sharpness(first: NDArray[np.float64], second: NDArray[np.float64]) -> float | None:
    """Root mean square gradient over mean: the Tenengrad measure (Krotkov 1987) of two frames multiplied.

    Their noise is independent, so that it does not add to the mean of the products as it does to that of squares.
    """
    mean = float((first.mean() + second.mean()) / 2)
    if mean < _DARK_SHARE or min(first.shape) < 2:
        return None
    steps = sum(float((np.diff(first, axis=a) * np.diff(second, axis=a)).mean()) for a in (0, 1))
    return float(np.sqrt(max(steps, 0.0)) / mean)


def viewable(frame: RawFrame, full_scale_dn: int) -> NDArray[np.uint8]:
    """Return a photograph as a screen shows it, (H, W, C).

    Codes of 8 bits are left as they are, numbers of more bits taken as linear light and coded as sRGB.
    """
    if full_scale_dn <= _EIGHT_BITS:
        return frame.pixels.astype(np.uint8)
    share = np.minimum(frame.pixels / np.float64(full_scale_dn), 1.0)
    return np.asarray(np.rint(255 * srgb_of_linear(share)), np.uint8)
