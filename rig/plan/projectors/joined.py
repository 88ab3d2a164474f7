"""All projectors of a plan as one picture: their pixels in a row, each with the light of every projector there.

Where pictures overlap, the projector that the room file names first says what is wanted; the others show the same at
the same place, and their light adds up. So each pixel's own place answers to one unknown, as with one projector.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array

from rig.plan.projectors.view import ProjectorView
from sim.geometry.interpolation import bilinear
from sim.geometry.scene import Hits

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, eq=False, kw_only=True)
class JoinedViews:
    """The pixels of K projectors one after the other, n in all; light in the first projector's unit."""

    views: tuple[ProjectorView, ...]

    @property
    def black(self) -> float:
        """The least light of a black pixel among the projectors, white = 1."""
        return min(one.black for one in self.views)

    @cached_property
    def parts(self) -> tuple[slice, ...]:
        """Where each projector's pixels are."""
        ends = np.cumsum([0, *(one.lens.n_pixels for one in self.views)])
        return tuple(slice(int(a), int(b)) for a, b in pairwise(ends))

    @cached_property
    def scale(self) -> FloatArray:
        """(n,) each pixel's unit over the first projector's, less what it never stops sending: see ``residue``."""
        first = self.views[0].lux_per_unit
        return self.spread([one.lux_per_unit / first * (1 - self._always(one)) for one in self.views])

    @cached_property
    def residue(self) -> FloatArray:
        """(n,) what a projector with less contrast than the best sends always, as a picture on top of any other."""
        return self.spread([self._always(one) / (1 - self._always(one)) for one in self.views])

    def _always(self, one: ProjectorView) -> float:
        """The share e of white with which e + (1 - e) black = this projector's own black."""
        return (one.black - self.black) / (1 - self.black)

    def spread(self, values: Sequence[float]) -> FloatArray:
        """Return (n,) a number of each projector at each of its pixels."""
        return np.repeat(np.array(values, dtype=np.float64), [one.lens.n_pixels for one in self.views])

    @cached_property
    def hits(self) -> Hits:
        """What each pixel meets."""
        all_ = [one.hits for one in self.views]
        return Hits(
            face=np.concatenate([one.face for one in all_]),
            patch=np.concatenate([one.patch for one in all_]),
            distance=np.concatenate([one.distance for one in all_]),
            uv=np.concatenate([one.uv for one in all_]),
            cos_incidence=np.concatenate([one.cos_incidence for one in all_]),
        )

    @cached_property
    def points_m(self) -> FloatArray:
        """(n, 3) where the pixels end [m]."""
        return np.concatenate([one.points_m for one in self.views])

    @cached_property
    def _met(self) -> list[list[tuple[FloatArray, FloatArray]]]:
        """What projector j does at the points of projector i: [i][j]."""
        return [
            [
                (other.lens.pixel_grid(), one.own_irradiance) if one is other else other.places_of(one)
                for other in self.views
            ]
            for one in self.views
        ]

    @cached_property
    def irradiance(self) -> FloatArray:
        """(n,) of all projectors' white at each pixel's place; the first projector's unit."""
        scale = np.array([self.scale[part.start] for part in self.parts])
        return np.concatenate([scale @ np.stack([light for _, light in row]) for row in self._met])

    @cached_property
    def times_lit(self) -> IntArray:
        """(n,) how many projectors reach each pixel's place, 1 at least."""
        times = [(np.stack([light for _, light in row]) > 0).sum(axis=0) for row in self._met]
        return np.asarray(np.maximum(np.concatenate(times), 1), np.intp)

    @cached_property
    def footprints_m2(self) -> FloatArray:
        """(n,) area of each pixel; where K pictures overlap, a Kth of it, so that their sum is what is lit [m²]."""
        return np.concatenate([one.footprints_m2 for one in self.views]) / self.times_lit

    @cached_property
    def content(self) -> csr_array:
        """(n, n) what is wanted at each pixel, of the pictures: its own, or that of the first projector there."""
        rows, columns, values = [], [], []
        for i, row in enumerate(self._met):
            free = np.ones(len(row[0][1]), dtype=bool)
            for j in range(i):
                xy, light = row[j]
                taken = np.flatnonzero(free & (light > 0))
                lens = self.views[j].lens
                y, x, weights = bilinear(xy[taken], lens.width_px, lens.height_px)
                rows.append(self.parts[i].start + np.repeat(taken, 4))
                columns.append(self.parts[j].start + (y * lens.width_px + x).ravel())
                values.append(weights.ravel())
                free[taken] = False
            own = self.parts[i].start + np.flatnonzero(free)
            rows.append(own)
            columns.append(own)
            values.append(np.ones(len(own)))
        n = self.parts[-1].stop
        where = np.concatenate(rows), np.concatenate(columns)
        return csr_array(coo_array((np.concatenate(values), where), shape=(n, n)))
