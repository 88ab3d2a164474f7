"""Whether flat pictures are as bright a share of white everywhere: light is linear, whatever the walls do with it."""

from __future__ import annotations

import numpy as np

from calibration.arrays import BoolArray, Float32Array, FloatArray, IntArray

_PARTS, _FULL = 16, 0.3
"""Along each side of the picture: somebody is a few of them wide. Of the pixels that count in the fullest part."""
_MOST_OFF, _OF_WHITE = 0.2, 0.03
"""Of a picture's light, and of white: room light that flickers may change single pictures by a hundredth of white,
where white is dark by a twentieth of it; where somebody stands in a picture, a third of its light is left."""


def part_shares(
    light: Float32Array | FloatArray, white: Float32Array | FloatArray, lit: BoolArray, parts: int = _PARTS
) -> FloatArray:
    """Return the light of parts of a picture, over that of white.

    Parameters
    ----------
    light, white : (H, W)
        Linear light above black.
    lit : (H, W)
        Pixels that count.
    parts : int
        Along each side of the picture.

    Returns
    -------
    (M,)
        Of the parts that have enough such pixels, in the same order for the same pixels.
    """
    counts = _sums(lit, parts)
    full = counts > _FULL * counts.max()
    shown, whole = (_sums(np.where(lit, each, 0.0), parts)[full] for each in (light, white))
    return np.asarray(shown / whole)


def unevenness(shares: FloatArray) -> FloatArray:
    """Return by how much one part of each picture is off from the middle of all, where it is most so.

    Parameters
    ----------
    shares : (K, M)
        By :func:`part_shares`, of K pictures.

    Returns
    -------
    (K,)
        In units of what is allowed: a fifth of the picture's light and 0.03 of white's; below 0 where it is darker.
    """
    middle = np.median(shares, axis=1, keepdims=True)
    off = (shares - middle) / (_MOST_OFF * middle + _OF_WHITE)
    return np.asarray(np.take_along_axis(off, np.abs(off).argmax(axis=1)[:, None], axis=1)[:, 0])


def disturbed(uneven: FloatArray) -> IntArray:
    """Return which pictures are uneven while most are not: a projector that is uneven by itself is so in most."""
    odd = np.flatnonzero(np.abs(uneven) > 1)
    return odd if 2 * len(odd) < len(uneven) else odd[:0]


def _sums(values: BoolArray | Float32Array | FloatArray, parts: int) -> FloatArray:
    """(N,) over parts of the picture (H, W)."""
    rows, columns = (np.array_split(np.arange(n), parts) for n in values.shape)
    return np.array([values[np.ix_(row, column)].sum(dtype=np.float64) for row in rows for column in columns])
