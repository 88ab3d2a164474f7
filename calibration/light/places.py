"""Where camera pixels look in the projector's picture, by the light of the code's own stripes: finer than its bits.

A code's bits say on which side of a stripe's edge a pixel lies; how bright it is says how far from the edge. The
difference of a pattern and its inverse is direct light times 2 s - 1, with the share s that the blurred pattern gives
the pixel; light from other walls is much the same in both and cancels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibration.arrays import BoolArray, Codes, Float32Array, FloatArray
from calibration.light.blur import PointSpread, footprints, stretch
from calibration.light.two_level import TwoLevelPicture, shares_and_slopes, two_level
from calibration.structured_light.correspondence import Correspondence

LEAST_PAIRS = 4
"""Patterns along each axis: with fewer, no edge is near most pixels."""
_PASSES = 2
_MOST_SHIFT_PX = 0.5
"""By which light may move a refined code; more is light that the wall does not explain."""
_MOST_SIGMA_PX = 0.2
_KNOWN = (3e-3 / 0.3) ** 2
"""Of a place before: codes leave 0.3 px at worst, and a camera some 0.3 % of direct light."""
_CHUNK = 1 << 15
_OF_BLUR = 8.0
"""What of a camera's variance counts as a window over which places are means: on five random rigs 0 to 10, most where
walls slant, since there also more light comes from where places change faster."""


def places_by_light(
    differences: Sequence[Float32Array],
    patterns: Sequence[Codes],
    correspondence: Correspondence,
    spread: PointSpread,
    *,
    movable: BoolArray,
) -> Correspondence:
    """Move the coordinates of a correspondence to where light says that they are.

    Parameters
    ----------
    differences : (K of) (H, W)
        Linear light of each pattern minus that of its inverse.
    patterns : (K of) (h, w)
        The codes that were shown, 0 or 255: stripes.
    correspondence : Correspondence
        Refined to well below a pixel.
    spread : PointSpread
        Blur of both lenses.
    movable : (H, W)
        Pixels that are asked.

    Returns
    -------
    Correspondence
        The same pixels are valid; those that light does not tell to 0.2 px, or by more than half a pixel, stay.
    """
    rows, columns = np.nonzero(movable & correspondence.valid)
    pictures, stretched = [two_level(codes) for codes in patterns], stretch(correspondence)
    xy, sigma = correspondence.projector_xy_px.copy(), correspondence.sigma_px
    sigma = np.full(xy.shape, np.inf, dtype=np.float32) if sigma is None else sigma.copy()
    for first in range(0, len(rows), _CHUNK):
        at = rows[first : first + _CHUNK], columns[first : first + _CHUNK]
        light = np.stack([image[at] for image in differences]).astype(np.float64)
        start, there = xy[at].astype(np.float64), np.stack(at[::-1], axis=-1).astype(np.float64)
        places = start
        for _ in range(_PASSES):
            step, found = _step(light, pictures, (spread, places, there, stretched[at]))
            places = places + step
        moved = np.abs(places - start).max(axis=1) < _MOST_SHIFT_PX
        moved &= (found < _MOST_SIGMA_PX).all(axis=1)
        kept = at[0][moved], at[1][moved]
        xy[kept], sigma[kept] = places[moved], found[moved]
    return replace(correspondence, projector_xy_px=xy, sigma_px=sigma)


def blur_as_window_px2(spread: PointSpread) -> float:
    """Return the variance of the window that a camera's blur comes to for places by light. [px² of the camera]."""
    return _OF_BLUR * max(spread.camera.coefficients_px2[0], 0.0)


def _step(
    light: FloatArray, pictures: Sequence[TwoLevelPicture], seen: tuple[PointSpread, FloatArray, FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """(N, 2) by how much places are off, and the standard deviation of that; of differences of light (K, N)."""
    share, along, down = shares_and_slopes(pictures, footprints(*seen))
    regressors = (2 * share - 1, 2 * along, 2 * down)
    gram = np.stack([[np.einsum("kn,kn->n", a, b) for b in regressors] for a in regressors]).transpose(2, 0, 1)
    inverse = np.linalg.inv(gram + np.diag([1e-9, _KNOWN, _KNOWN]))
    right = np.stack([np.einsum("kn,kn->n", a, light) for a in regressors], axis=1)
    found = np.einsum("nab,nb->na", inverse, right)
    left = np.einsum("kn,kn->n", light, light) - np.einsum("na,na->n", found, right)
    scatter = np.maximum(left, 0.0) / (len(pictures) - 3)
    direct = np.where(found[:, 0] > 0, found[:, 0], np.inf)
    variance = scatter[:, None] * np.diagonal(inverse, axis1=1, axis2=2)[:, 1:]
    # A pixel without direct light has no place: its sigma is what bars it.
    sigma = np.where(np.isfinite(direct)[:, None], np.sqrt(variance) / direct[:, None], np.inf)
    return np.clip(found[:, 1:] / direct[:, None], -_MOST_SHIFT_PX, _MOST_SHIFT_PX), sigma
