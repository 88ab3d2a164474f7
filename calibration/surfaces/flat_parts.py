"""Flat parts of pieces of surface: where planes explain the points within their noise, and end at an edge.

A plane n · (x - origin) = 1 is linear in what a camera measures: 1 / distance = n · ray.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from calibration.arrays import BoolArray, FloatArray, IntArray
from calibration.surfaces.pieces import largest_first
from calibration.surfaces.point_map import PointMap, at_least_usual

_SIGMAS = 3.0
"""Within so many standard deviations a point lies on a plane."""
_WIDER, _MOST_GROWTH = 3.0, 1.35
"""A plane that ends at an edge takes in little more when it may miss by three times as much; along a surface that bends
evenly it takes in 3^½ = 1.7 times as much."""
_BENT_SHARE, _BENT_SIGMAS = 0.75, 0.6
"""Of the squared misfit of a plane's points, what a quadric explains of a bent surface, and the root mean square of it
in standard deviations of a point. In simulated rooms far columns, 14 to 22 px wide, have 0.81 to 0.94 and 0.95 to 1.28,
flat sides at most 0.3 and 0.5, but one of 8 px, at whose edges codes mix, 0.63."""
_TRIALS, _SEED_PX = 60, 9
"""Planes that are tried for a piece, and half the side of the window that each is fitted to."""
_TRIED_POINTS = 3000
"""Of a piece, among which its planes are looked for; the one that is found is fitted to all."""
_ROUNDS = 4
"""Of fitting a plane and asking anew which points lie on it."""
_THIN_PX = 2.5
"""Half the width of a strip that is no part beside others: a lens's blur mixes the codes of two surfaces so far."""
_SPECK_PX = 5
"""Side of the window whose majority a pixel follows."""
_MOST_PARTS = 24
"""Planes of one piece: beyond, the rest counts as curved."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Parts:
    """Parts of surface, each flat or smoothly curved."""

    label: IntArray
    """(H, W) 0, 1, … of the part that each pixel sees; -1 for none."""
    planes: FloatArray
    """(K, 3) n of each part's plane, n · (x - origin) = 1; NaN of a curved part. [1/m]"""

    @property
    def flat(self) -> BoolArray:
        """(K,) parts that are planes."""
        return np.isfinite(self.planes[:, 0])


@dataclass(frozen=True, eq=False, kw_only=True)
class _Samples:
    """The points of one piece, in the order of its pixels."""

    rows: IntArray
    columns: IntArray
    rays: FloatArray
    """(N, 3)"""
    inverse: FloatArray
    """(N,) 1 / distance. [1/m]"""
    sigma: FloatArray
    """(N,) of it. [1/m]"""
    shape: tuple[int, int]
    step: int = 1
    """Every so many rows and columns there is a point."""

    def thinned(self) -> _Samples:
        """So few of the rows and columns that planes are tried quickly."""
        step = int(np.ceil(np.sqrt(len(self.rows) / _TRIED_POINTS)))
        return replace(self.only((self.rows % step == 0) & (self.columns % step == 0)), step=step)

    def only(self, chosen: BoolArray) -> _Samples:
        rows, columns, rays = self.rows[chosen], self.columns[chosen], self.rays[chosen]
        return replace(
            self, rows=rows, columns=columns, rays=rays, inverse=self.inverse[chosen], sigma=self.sigma[chosen]
        )


def parts_of(points: PointMap, pieces: IntArray, least_pixels: int) -> Parts:
    """Cut pieces of surface into flat parts, and leave what is curved as it is.

    Parameters
    ----------
    points : PointMap
    pieces : (H, W)
        Number of each pixel's piece; -1 for none.
    least_pixels : int
        A part that has fewer is none.

    Returns
    -------
    Parts
        Of all pieces together, the largest first.
    """
    label = np.full(pieces.shape, -1, dtype=np.int64)
    planes: list[FloatArray] = []
    for piece in range(int(pieces.max(initial=-1)) + 1):
        samples = _samples(points, pieces == piece)
        own = np.full(pieces.shape, -1, dtype=np.int64)
        for plane, chosen in _split(samples, least_pixels):
            part = samples.only(chosen)
            own[part.rows, part.columns] = len(planes)
            planes.append(plane)
        label = np.maximum(label, _tidied(own, pieces == piece))
    return _sorted(label, np.array(planes).reshape(-1, 3), least_pixels)


def _tidied(label: IntArray, piece: BoolArray) -> IntArray:
    """The labels of a piece without strips along edges, where codes of both sides mix, and without specks and holes.

    What belonged to them goes to the nearest part.
    """
    names = [k for k in np.unique(label) if k >= 0]
    widths = {k: float(cv2.distanceTransform((label == k).astype(np.uint8), cv2.DIST_L2, 3).max()) for k in names}
    wide = [k for k in names if widths[k] > _THIN_PX] or sorted(names, key=lambda k: -widths[k])[:1]
    if not wide:
        return label
    nearest = _nearest(np.where(np.isin(label, wide), label, -1))
    smooth = np.stack([cv2.blur((nearest == k).astype(np.float32), (_SPECK_PX, _SPECK_PX)) for k in wide])
    return np.where(piece, np.array(wide)[smooth.argmax(axis=0)], -1)


def _nearest(label: IntArray) -> IntArray:
    """The label of the nearest pixel that has one."""
    unknown = (label < 0).astype(np.uint8)
    place = cv2.distanceTransformWithLabels(unknown, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)[1]
    of_place = np.full(int(place.max()) + 1, -1, dtype=np.int64)
    of_place[place[unknown == 0]] = label[unknown == 0]
    return np.asarray(of_place[place])


def _sorted(label: IntArray, planes: FloatArray, least_pixels: int) -> Parts:
    renamed = largest_first(label, least_pixels)
    order = np.zeros(int(renamed.max(initial=-1)) + 1, dtype=np.int64)
    seen = renamed >= 0
    order[renamed[seen]] = label[seen]
    return Parts(label=renamed, planes=planes[order])


def _samples(points: PointMap, chosen: BoolArray) -> _Samples:
    rows, columns = np.nonzero(chosen & points.known)
    distance_m, sigma_m = points.distance_m[rows, columns], points.sigma_m[rows, columns]
    sigma = at_least_usual(sigma_m, sigma_m) / distance_m**2
    return _Samples(
        rows=rows,
        columns=columns,
        rays=points.rays[rows, columns],
        inverse=1 / distance_m,
        sigma=sigma,
        shape=chosen.shape,
    )


def _split(samples: _Samples, least_pixels: int) -> list[tuple[FloatArray, BoolArray]]:
    """Planes with their points, and what is left, in connected parts, as curved."""
    found: list[tuple[FloatArray, BoolArray]] = []
    left, bent = np.ones(len(samples.rows), dtype=bool), np.zeros(len(samples.rows), dtype=bool)
    while left.sum() >= least_pixels and len(found) < _MOST_PARTS:
        rest = np.flatnonzero(left)
        among = samples.only(left)
        best = _largest_plane(among.thinned(), least_pixels)
        if best is None:
            break
        plane, on = _grown_from(among, *best)
        if on.sum() < least_pixels:
            break
        chosen = np.zeros_like(left)
        chosen[rest[on]] = True
        left &= ~chosen
        if _is_bent(samples.only(chosen), plane):
            bent |= chosen
        else:
            found.append((plane, chosen))
    return found + [(np.full(3, np.nan), part) for part in _connected(samples, left | bent)]


def _is_bent(samples: _Samples, plane: FloatArray) -> bool:
    """Tell whether points that may each lie on a plane say together that they lie on a bent surface.

    Far away a column is no deeper than a point is uncertain; but all of its middle lies before the plane.
    """
    off = (samples.inverse - samples.rays @ plane) / samples.sigma
    x, y = (values - values.mean() for values in (samples.columns, samples.rows))
    x, y = (values / max(float(np.abs(values).max()), 1.0) for values in (x, y))
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1) / samples.sigma[:, None]
    terms /= np.maximum(np.linalg.norm(terms, axis=0), np.finfo(np.float64).tiny)
    bend = terms @ np.linalg.lstsq(terms, off, rcond=None)[0]
    explained, whole = float(np.mean(bend**2)), float(np.mean(off**2))
    return explained > _BENT_SHARE * whole and explained > _BENT_SIGMAS**2


def _largest_plane(samples: _Samples, least_pixels: int) -> tuple[FloatArray, tuple[int, int]] | None:
    """The plane with most connected points that ends at an edge, and a pixel on it; None where there is none."""
    best: tuple[FloatArray, tuple[int, int]] | None = None
    count = least_pixels / samples.step**2 - 1
    generator = np.random.default_rng(0)
    seeds = generator.permutation(len(samples.rows))[:_TRIALS]
    for seed in seeds:
        near = (np.abs(samples.rows - samples.rows[seed]) <= _SEED_PX) & (
            np.abs(samples.columns - samples.columns[seed]) <= _SEED_PX
        )
        fitted = _grown(samples, near, int(seed))
        if fitted is not None and fitted[1].sum() > count and not _bends(samples, *fitted, int(seed)):
            best = fitted[0], (int(samples.rows[seed]), int(samples.columns[seed]))
            count = float(fitted[1].sum())
    return best


def _grown_from(samples: _Samples, plane: FloatArray, pixel: tuple[int, int]) -> tuple[FloatArray, BoolArray]:
    """A plane that was found among few points, fitted to all of them about a pixel."""
    seed = int(np.flatnonzero((samples.rows == pixel[0]) & (samples.columns == pixel[1]))[0])
    on = _about(samples, _off(samples, plane) <= _SIGMAS, seed)
    fitted = _grown(samples, on, seed)
    return (plane, on) if fitted is None else fitted


def _grown(samples: _Samples, start: BoolArray, seed: int) -> tuple[FloatArray, BoolArray] | None:
    """A plane through a window, fitted again and again to the points about its seed that lie on it."""
    on = start
    plane = np.zeros(3)
    for _ in range(_ROUNDS):
        if on.sum() < 3:
            return None
        plane = _fit(samples, on)
        on = _about(samples, _off(samples, plane) <= _SIGMAS, seed)
    return plane, on


def _fit(samples: _Samples, on: BoolArray) -> FloatArray:
    weight = 1 / samples.sigma[on]
    return np.asarray(np.linalg.lstsq(samples.rays[on] * weight[:, None], samples.inverse[on] * weight, rcond=None)[0])


def _off(samples: _Samples, plane: FloatArray) -> FloatArray:
    """(N,) standard deviations by which points miss a plane."""
    return np.asarray(np.abs(samples.rays @ plane - samples.inverse) / samples.sigma)


def _bends(samples: _Samples, plane: FloatArray, on: BoolArray, seed: int) -> bool:
    """Tell whether a plane takes in many more points when it may miss by more: a surface that goes on, bending."""
    wider = _about(samples, _off(samples, plane) <= _WIDER * _SIGMAS, seed)
    return bool(wider.sum() > _MOST_GROWTH * on.sum())


def _about(samples: _Samples, chosen: BoolArray, seed: int) -> BoolArray:
    """The chosen points that hang together with the seed."""
    if not chosen[seed]:
        return np.zeros_like(chosen)
    number = _numbers(samples, chosen)
    return np.asarray(number == number[seed]) & chosen


def _numbers(samples: _Samples, chosen: BoolArray) -> IntArray:
    """(N,) number of the connected area of each chosen point; 0 of the others."""
    step = samples.step
    mask = np.zeros((samples.shape[0] // step + 1, samples.shape[1] // step + 1), np.uint8)
    mask[samples.rows[chosen] // step, samples.columns[chosen] // step] = 1
    number = cv2.connectedComponents(mask, connectivity=4)[1]
    return np.asarray(number[samples.rows // step, samples.columns // step], dtype=np.int64)


def _connected(samples: _Samples, chosen: BoolArray) -> list[BoolArray]:
    number = _numbers(samples, chosen)
    return [number == k for k in range(1, int(number.max(initial=0)) + 1)]
