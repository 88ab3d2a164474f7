"""What senders that are not even change: patches send one number each, while their light varies within them.

Light steps within a sender where a shadow or the lamp's picture ends, and a receiver beside it sees that. Rays leave
receivers evenly; where each lands, the sender's light is known: that of the sixteenth of the patch, and of the lamp
that of the very point. What differs from the patch's mean is what the receiver's light is wrong by. Two streams, with
rays and light of sixteenths of their own, leave no bias by noise in its square.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sim.arrays import FloatArray, IntArray
from sim.geometry.adaptive_patches import AdaptivePatches
from sim.geometry.rays import trace
from sim.light.gloss.exchange import cosine_directions, points_on
from sim.light.gloss.walks import even_points
from sim.light.lighting import Emission, Lighting
from sim.planning.linear_light import PIECES

RECEIVERS_AT_A_TIME = 1 << 11
"""Their rays' places among sixteenths take some 100 MB."""
ABOVE = 1e-9
"""Of the surface's size, by which rays begin above the patch that they leave."""
VARIES = 1e-12
"""Variance of the lamp's light within a patch, from which it is asked for at points."""


@dataclass(frozen=True, eq=False, kw_only=True)
class UnevenSenders:
    """Light within patches, and what they are taken to send of it."""

    cells: AdaptivePatches
    light: Lighting
    lit: Emission
    """Of the cells."""
    pieces: tuple[FloatArray, FloatArray]
    """Two times (16, P) what the irradiance of sixteenths, without the lamp, has over their patch's mean, with noise
    that is independent; pieces as ``cells.quarters().quarters()``; 1 = white."""

    @cached_property
    def places(self) -> FloatArray:
        """(16, P, 3) centres of sixteenths. [m]."""
        return self.cells.quarters().quarters().centres.reshape(PIECES, -1, 3)

    def shifts(self, rays: int, seed: int) -> tuple[FloatArray, FloatArray]:
        """Return twice (P,) the irradiance that senders of one number miss, with noise that is independent.

        Parameters
        ----------
        rays : int
            From each patch.
        seed : int
            Of the rays.
        """
        one, other = (self._shift(stream, rays, seed) for stream in (0, 1))
        return one, other

    def _shift(self, stream: int, rays: int, seed: int) -> FloatArray:
        cells, points = self.cells, even_points(rays, 4)
        above_m = ABOVE * float(np.ptp(cells.vertices.reshape(-1, 3), axis=0).max())
        found = []
        for first in range(0, cells.n_patches, RECEIVERS_AT_A_TIME):
            some = np.arange(first, min(first + RECEIVERS_AT_A_TIME, cells.n_patches))
            random = np.random.default_rng((seed, stream, first))
            chances = ((points + random.uniform(size=(len(some), 1, 4))) % 1.0).reshape(-1, 4)
            patch = np.repeat(some, rays)
            begin = points_on(cells, patch, chances[:, :2]) + above_m * cells.normals[patch]
            ways = cosine_directions(cells, patch, chances[:, 2:])
            hits = trace(cells, begin, ways)
            met = np.flatnonzero((hits.patch >= 0) & (hits.cos_incidence > 0))
            missed = np.zeros(len(patch))
            landed = begin[met] + hits.distance[met, None] * ways[met]
            missed[met] = self._missed(hits.patch[met], landed, stream)
            found.append(missed.reshape(-1, rays).mean(axis=1))
        return np.concatenate(found)

    def _missed(self, sender: IntArray, points_m: FloatArray, stream: int) -> FloatArray:
        """(N,) radiosity that patches have at points over that which they are taken to send."""
        cells, nearest, least = self.cells, np.zeros(len(sender), dtype=np.intp), np.full(len(sender), np.inf)
        for k in range(PIECES):
            squared = ((self.places[k, sender] - points_m) ** 2).sum(axis=1)
            nearest, least = np.where(squared < least, k, nearest), np.minimum(squared, least)
        over = self.pieces[stream][nearest, sender]
        edged = np.flatnonzero(self.lit.variance[sender] > VARIES)
        on = sender[edged]
        lamp = self.light.irradiance(points_m[edged], cells.normals[on], cells.region[on])
        over[edged] += lamp - self.lit.irradiance[on]
        return np.asarray(cells.reflectance[sender] * over)
