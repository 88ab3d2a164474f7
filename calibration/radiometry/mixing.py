"""How a projector's channels mix into a camera's bands, and whether they add up to white.

With T_b the light transport of band b lit by white and K[b, q] the share of it that channel q makes, a flat picture of
channel q gives T_b K[b, q] everywhere: direct and global light alike, so every lit pixel is a witness. After M. D.
Grossberg, H. Peri, S. K. Nayar and P. N. Belhumeur, Making one object look like another: controlling appearance using
a projector-camera system, CVPR 2004.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.arrays import BoolArray, FloatArray
from calibration.errors import CalibrationError

CONDITION_LIMIT = 30.0
"""Of K; about the factor by which noise grows when colours are taken apart."""
ADDITIVITY_LIMIT = 0.05
"""By how much white may differ from red + green + blue."""
_TILES = 4
"""Along each side of the picture, for :attr:`Mixing.variation`."""
_LEAST_PIXELS = 50
"""Of a median: fewer leave it to single wrong pixels."""


@dataclass(frozen=True, eq=False)
class Mixing:
    """What is found of K."""

    matrix: FloatArray
    """(B, C) K[b, q], rows sum to 1."""
    white_over_channels: FloatArray
    """(B,) light of white over the sum of the channels' lights."""
    variation: float
    """Largest difference of K in a tile of the picture (4 x 4 tiles) from K as a whole."""


def fit_mixing(white: NDArray[np.floating], pure: Sequence[NDArray[np.floating]], lit: BoolArray) -> Mixing:
    """Measure how channels mix into bands: medians over the lit pixels of a pure channel's light over white's.

    Parameters
    ----------
    white : (H, W, B)
        Light above black of a white picture.
    pure : C of (H, W, B)
        Of flat pictures of one channel each at its largest code.
    lit : (H, W) bool
        Pixels that count; white is above 0 there in each band.

    Returns
    -------
    Mixing
        (B, C) shares of white, and how well they hold.

    Raises
    ------
    CalibrationError
        If too few pixels are lit, the channels do not add up to white, or two of them look alike to the camera.

    References
    ----------
    M. D. Grossberg, H. Peri, S. K. Nayar and P. N. Belhumeur, Making one object look like another: controlling
    appearance using a projector-camera system, CVPR 2004.
    """
    lit = lit & (white > 0).all(axis=-1)
    if int(lit.sum()) < _LEAST_PIXELS:
        raise CalibrationError(
            f"colour mixing: {int(lit.sum())} lit pixels, at least {_LEAST_PIXELS} are needed; aim the camera at the "
            "projected picture"
        )
    share = np.stack([np.asarray(image[lit], np.float64) / white[lit] for image in pure], axis=-1)
    raw = np.median(share, axis=0)
    sums = raw.sum(axis=1)
    if not (sums > 0).all():
        raise CalibrationError(
            f"colour mixing: no light from red, green and blue (sums {_listed(sums)} of white); does the picture "
            "mode show colours, and does the camera see the picture?"
        )
    _refuse_boost(1 / sums)
    matrix = raw / sums[:, None]
    _refuse_alike(matrix)
    return Mixing(matrix, 1 / sums, _variation(share, raw, lit))


def _refuse_boost(white_over_channels: FloatArray) -> None:
    if np.abs(white_over_channels - 1).max() > ADDITIVITY_LIMIT:
        raise CalibrationError(
            f"colour mixing: white is {_listed(white_over_channels)} times red + green + blue in the camera's bands, "
            f"the limit is {1 - ADDITIVITY_LIMIT:g} ... {1 + ADDITIVITY_LIMIT:g}: a white segment, brilliant colour or "
            "dynamic contrast; choose another picture mode (sRGB, photo), or a camera of 1 channel"
        )


def _refuse_alike(matrix: FloatArray) -> None:
    condition = float(np.linalg.cond(matrix))
    if not condition <= CONDITION_LIMIT:
        raise CalibrationError(
            f"colour mixing: condition {condition:.3g}, the limit is {CONDITION_LIMIT:g}: two channels of the "
            "projector look alike to the camera; is it a grey camera? Use channels = 1, or take its saturation setting "
            "back to normal"
        )


def _variation(share: FloatArray, whole: FloatArray, lit: BoolArray) -> float:
    """Largest difference between a tile's medians and the whole picture's."""
    rows, columns = np.nonzero(lit)
    tile = rows * _TILES // lit.shape[0] * _TILES + columns * _TILES // lit.shape[1]
    filled = [k for k in range(_TILES**2) if (tile == k).sum() >= _LEAST_PIXELS]
    return max((float(np.abs(np.median(share[tile == k], axis=0) - whole).max()) for k in filled), default=0.0)


def _listed(values: FloatArray) -> str:
    return ", ".join(f"{value:.3f}" for value in values)
