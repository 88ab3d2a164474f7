"""SurfacePlaces of a camera's picture: some pixels of one surface side by side, whose global light is alike."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array
from scipy.spatial import KDTree

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.intp]

_ACROSS = 80
"""SurfacePlaces along a picture's width: a lobe of roughness 0.1 seen from a few metres is ten of them wide."""
_LEAST_SIZE_PX = 5.0
"""Of a place: small cameras have fewer of them."""
_LEAST_PIXELS = 6
"""Of a place: fewer tell too little."""
ALIKE, _REACH = 1.0, 2.6
"""Standard deviation, in places, within which the model is wrong alike, and where it is cut off."""
WORTH = 2 * np.pi * ALIKE**2
"""Independent places that a mean with such weights is worth: half of 4πσ², for it is not quite alike within them."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SurfacePlaces:
    """Where a light transport is learned."""

    of_pixel: IntArray
    """(H, W) number of each pixel's place; -1 for none."""
    face: IntArray
    """(H, W) surface that each pixel sees."""
    centre: FloatArray
    """(N, 3) column, row in units of places, and the surface, far apart."""

    @property
    def count(self) -> int:
        """How many there are."""
        return len(self.centre)

    def mean_of(self, weight: FloatArray | None = None) -> csr_array:
        """Return (N, H W) matrix that makes means over places, of pixels weighted alike or by (H, W)."""
        pixels = np.flatnonzero(self.of_pixel.ravel() >= 0)
        place = self.of_pixel.ravel()[pixels]
        value = np.ones(len(pixels)) if weight is None else weight.ravel()[pixels]
        total = np.bincount(place, value, self.count)
        each = np.where(total[place] > 0, value / np.where(total > 0, total, 1.0)[place], 0.0)
        return csr_array((each, (place, pixels)), shape=(self.count, self.of_pixel.size))

    def alike(self) -> csr_array:
        """Return (N, N) matrix that makes means over places about each of one surface, the near ones first."""
        pairs = KDTree(self.centre).query_pairs(_REACH * ALIKE, output_type="ndarray")
        both = np.concatenate([pairs, pairs[:, ::-1], np.repeat(np.arange(self.count)[:, None], 2, axis=1)])
        apart = np.linalg.norm(self.centre[both[:, 0]] - self.centre[both[:, 1]], axis=1)
        weight = np.exp(-(apart**2) / (2 * ALIKE**2))
        near = csr_array((weight, (both[:, 0], both[:, 1])), shape=(self.count,) * 2)
        return csr_array(diags_array(1 / near.sum(axis=1)) @ near)

    def spread_out(self, values: FloatArray, where: BoolArray) -> FloatArray:
        """Return (H, W) values (N,) of places, smooth between them along each surface; 0 outside of `where`."""
        known = self.of_pixel >= 0
        picture = np.where(known, values[self.of_pixel], 0.0)
        smooth = np.zeros(self.of_pixel.shape)
        wide_px = 0.5 * _size_px(self.of_pixel.shape)
        for name in np.unique(self.face[where]):
            of_face = where & (self.face == name)
            rows, columns = (slice(index.min(), index.max() + 1) for index in np.nonzero(of_face))
            on = (known & of_face)[rows, columns].astype(np.float64)
            weight = cv2.GaussianBlur(on, (0, 0), wide_px)
            total = cv2.GaussianBlur(picture[rows, columns] * on, (0, 0), wide_px)
            found = np.where(weight > 0, total / np.maximum(weight, np.finfo(float).tiny), 0.0)
            smooth[rows, columns] = np.where(of_face[rows, columns], found, smooth[rows, columns])
        return smooth


def places_of(lit: BoolArray, face: IntArray) -> SurfacePlaces:
    """Cut the lit pixels (H, W) of each face (H, W) into places."""
    size_px = _size_px(lit.shape)
    row, column = (np.floor(index / size_px).astype(np.intp) for index in np.nonzero(lit))
    keys = np.stack([face[lit], row, column], axis=1)
    unique, number, count = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    kept = count >= _LEAST_PIXELS
    renamed = np.where(kept, np.cumsum(kept) - 1, -1)
    of_pixel = np.full(lit.shape, -1, dtype=np.intp)
    of_pixel[lit] = renamed[number.ravel()]
    centre = unique[kept][:, [2, 1, 0]] * np.array([1.0, 1.0, 1000.0])
    return SurfacePlaces(of_pixel=of_pixel, face=face, centre=centre)


def _size_px(shape: tuple[int, ...]) -> float:
    """Side of a place."""
    return max(shape[1] / _ACROSS, _LEAST_SIZE_PX)
