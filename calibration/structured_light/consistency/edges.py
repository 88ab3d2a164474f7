"""What photographs of stripes say of each other, whatever they are called.

Which two are complements, which show the same, and what a picture shows at the edges of another one's stripes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calibration.arrays import BoolArray, Float32Array, FloatArray, Frame

_LINES = 150
"""Rows, and columns, that are looked at: some twenty edges of the widest stripe in view."""
_MOST_PLACES = 60_000
_STRONG = 0.3
"""Of the contrast of bright places: darker ones get more light from other surfaces than from the projector."""
_EDGE_CONTRAST = 0.15
"""Of white minus mean, on both sides of an edge: above the noise of JPEG, below the finest stripes that can be read."""
_STILL = 3
"""Pictures that may change within two camera pixels; where more do, the surface ends. One changes at an edge, others
beside it where a camera pixel is as wide as a stripe, and two or three by chance where one surface ends before another:
in a drawn set (seed 5037) one such end hid all edges of a picture but thirteen. So each place counts by the inverse of
the square of their number."""
_LEAST_EDGES = 12
_TOGETHER = 3
"""Neighbouring lines that meet the same piece of an edge, and the same noise of JPEG."""
_CLEAR = 0.4
"""Of the standard deviation, for pictures whose sides are clear: edges of stripes all say the same, ends of surfaces
that pass for edges lie anywhere. In a drawn set (seed 801, `benchmarks/photographs`) 38 % of 121 were such ends."""
_MOST = 1.5
"""Mean sizes of a picture's stripes; a wave's crest has 1.57. Where surfaces end, a picture of which blur leaves a
tenth shows many times that, and few such places would outvote its edges (drawn set 906)."""
_MOIRE_TURNS = 1.25
"""Turns over one camera pixel to turns over two: 0.5 of stripes that are resolved, 1 of noise, (2 / P) / (2 − 4 / P) of
periods P of two to four pixels, which is 1.25 at 2.9."""
_WIDE, _LEAST_SHARED = 0.12, 30
"""Share of the places at which stripes turn over two pixels: their edges are four pixels and more from those of other
pictures. And edges that two pictures share by no chance."""
BLURRED = 0.5
"""Of white minus mean: stripes of less contrast are compared by their changes."""


@dataclass(frozen=True)
class LinePlaces:
    """All photographs at lit places along rows and columns: digital numbers, or −1 dark … +1 lit."""

    left: Float32Array
    """(N, K) photograph, place."""
    middle: Float32Array
    """(N, K) one camera pixel further."""
    right: Float32Array
    """(N, K) two camera pixels further."""

    @cached_property
    def dark_and_lit(self) -> Float32Array:
        """(K,) sum of the least and the most that any photograph shows at a place."""
        return np.asarray(self.middle.max(axis=0) + self.middle.min(axis=0))


@dataclass(frozen=True, slots=True, kw_only=True)
class Stripes:
    """Pictures of stripes, each read from a photograph and its complement or from one photograph alone."""

    middle: Float32Array
    """(U, K) picture, place: −1 dark … +1 lit."""
    amplitude: FloatArray
    """(U,) mean size of it: how far the stripes are resolved."""
    at_edges: FloatArray
    """(U, U) mean of picture b at the edges of picture a over b's amplitude; NaN where too few edges tell."""
    sigma: FloatArray
    """(U, U) standard deviation of that for pictures b that are blurred, a part of it for those whose sides are
    clear."""
    undersampled: BoolArray
    """(U,) whether the stripes turn more often over one camera pixel than over two: there are fewer than 2.9 pixels to
    a bright and a dark one together, and what they show within a pixel of an edge averages out or turns round."""
    shared: FloatArray
    """(U, U) share of the edges at which two pictures of wide stripes change, of all such pictures they alone: of the
    picture that has more edges."""


def places_on_lines(frames: Sequence[Frame], limit: float) -> LinePlaces:
    """Gather what all photographs show at lit places along some rows and columns.

    Parameters
    ----------
    frames : sequence of (H, W)
        All of one camera, in the same unit. [dn]
    limit : float
        Least difference of the brightest and the darkest photograph at a place. [dn]

    Returns
    -------
    LinePlaces
        In digital numbers. No order or name of the photographs enters.
    """
    both = [_along(stack, limit) for stack in (frames, [frame.T for frame in frames])]
    return LinePlaces(*(np.concatenate(parts, axis=1) for parts in zip(*both, strict=True)))


def _along(frames: Sequence[Frame], limit: float) -> list[Float32Array]:
    """(N, K) at places, one and two pixels further along the rows."""
    step = max(1, frames[0].shape[0] // _LINES)
    lines = np.stack([frame[step // 2 :: step] for frame in frames])
    contrast = lines.max(axis=0).astype(np.float32) - lines.min(axis=0)
    lit = contrast >= max(limit, _STRONG * _bright(contrast, limit))
    row, column = np.nonzero(lit[:, :-2] & lit[:, 1:-1] & lit[:, 2:])
    few = slice(None, None, 1 + len(row) // _MOST_PLACES)
    return [lines[:, row[few], column[few] + right].astype(np.float32) for right in (0, 1, 2)]


def _bright(contrast: Float32Array, limit: float) -> float:
    seen = contrast[contrast >= limit]
    return float(np.quantile(seen, 0.95)) if len(seen) else limit


def normalised(places: LinePlaces, gains: FloatArray, *, complete: bool) -> LinePlaces:
    """Scale places so that −1 is dark and +1 is lit.

    Parameters
    ----------
    places : LinePlaces
        In digital numbers.
    gains : (N,)
        Exposure of each photograph relative to the others'.
    complete : bool
        Each pattern has its inverse, so that the mean of all photographs lies between dark and lit; else the mean of
        the extremes does.

    Returns
    -------
    LinePlaces
    """
    scale = (1 / gains).astype(np.float32)[:, None]
    return LinePlaces(*(_normalised(v * scale, complete) for v in (places.left, places.middle, places.right)))


def _normalised(seen: Float32Array, complete: bool) -> Float32Array:
    high, low = seen.max(axis=0), seen.min(axis=0)
    mean = seen.mean(axis=0) if complete else (high + low) / 2
    return np.asarray((seen - mean) / np.maximum((high - low) / 2, 1e-6), dtype=np.float32)


def stripes_of(places: LinePlaces, pairs: Sequence[tuple[int, int | None]]) -> Stripes:
    """Read pictures, and what each shows at the edges of the others.

    Parameters
    ----------
    places : LinePlaces
    pairs : sequence of (photograph, complement)
        Indices of photographs; None for a photograph without complement.

    Returns
    -------
    Stripes
        One picture a pair.
    """
    left, middle, right = (_differences(z, pairs) for z in (places.left, places.middle, places.right))
    fine = np.abs(middle).mean(axis=1, keepdims=True) < BLURRED
    # Fine stripes are dark as often as lit: what is left is an exposure not quite found, or a tone curve.
    balance = np.where(fine, middle.mean(axis=1, keepdims=True), 0)
    left, middle, right = left - balance, middle - balance, right - balance
    amplitude = np.maximum(np.abs(middle).mean(axis=1, dtype=np.float64), 1e-6)
    flips = (left > 0) != (right > 0)
    clear = (np.abs(left) > _EDGE_CONTRAST) & (np.abs(right) > _EDGE_CONTRAST)
    changes = np.maximum(flips.sum(axis=0), 1).astype(np.float32)
    edges = (flips & clear & (changes <= _STILL)) / changes**2
    weight = np.maximum(edges.sum(axis=1, dtype=np.float64), 1e-6)[:, None]
    count = weight[:, 0] ** 2 / np.maximum((edges**2).sum(axis=1, dtype=np.float64), 1e-6)
    most = _MOST * amplitude[:, None].astype(np.float32)
    usual = np.clip(middle, -most, most)
    mean, square = (edges @ values.T / weight for values in (usual, usual**2))
    sigma = np.sqrt(np.maximum(square - mean**2, 0) * _TOGETHER / np.maximum(count, 1)[:, None])
    mean[count < _LEAST_EDGES] = np.nan
    turns, turns_over_two = ((left > 0) != (middle > 0)).mean(axis=1), flips.mean(axis=1)
    return Stripes(
        middle=middle,
        amplitude=amplitude,
        at_edges=mean / amplitude,
        sigma=np.where(fine.T, 1, _CLEAR) * sigma / amplitude,
        undersampled=turns > _MOIRE_TURNS * turns_over_two,
        shared=_shared(flips, flips & clear, turns_over_two < _WIDE),
    )


def _shared(flips: BoolArray, edges: BoolArray, wide: BoolArray) -> FloatArray:
    """(U, U) share of edges that two pictures of wide stripes have for themselves."""
    alone = (edges & (flips[wide].sum(axis=0) == 2) & wide[:, None]).astype(np.float32)
    both = np.asarray(alone @ alone.T, dtype=np.float64) * (1 - np.eye(len(flips)))
    both[both < _LEAST_SHARED] = 0
    count = flips.sum(axis=1)
    return np.asarray(both / np.maximum(np.maximum(count[:, None], count), 1))


def _differences(z: Float32Array, pairs: Sequence[tuple[int, int | None]]) -> Float32Array:
    return np.stack([z[a] if b is None else (z[a] - z[b]) / 2 for a, b in pairs])


def complement_error(places: LinePlaces, a: int, b: int) -> float:
    """Share of the places at which two photographs do not add up to white and black.

    The mean of all photographs is not half way between dark and lit where a tone curve bends: pictures of single
    stripes, with light of their neighbours in them, add up to twice that mean, those that are lit or dark almost
    everywhere, as the coarsest of a projector whose rows just exceed a power of two, to dark and lit themselves.
    """
    both, ends = places.middle[a] + places.middle[b], places.dark_and_lit
    return float(((both > np.maximum(ends, 0) + _APART) | (both < np.minimum(ends, 0) - _APART)).mean())


def repetition_error(places: LinePlaces, a: int, b: int) -> float:
    """Share of the places at which two photographs differ."""
    return float((np.abs(places.middle[a] - places.middle[b]) > _APART).mean())


_APART = 0.7
"""Of white minus mean: well over the change that a tone curve makes to fine stripes, under dark against lit."""


def fine_correlation(places: LinePlaces) -> FloatArray:
    """(N, N) correlation of the changes over two camera pixels: what blurred, fine stripes still have in common."""
    change = places.right - places.left
    change = change - change.mean(axis=1, keepdims=True)
    size = np.maximum(np.linalg.norm(change, axis=1), 1e-9)
    return np.asarray((change @ change.T) / np.outer(size, size), dtype=np.float64)
