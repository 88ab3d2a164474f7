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
from numpy.typing import NDArray

from sim.arrays import FloatArray
from sim.form_factors.sampled import tree_of
from sim.geometry.adaptive_patches import PIECES, AdaptivePatches
from sim.light.lighting import Emission, Lighting

RAYS_AT_A_TIME = 1 << 19
"""Where they land takes some 20 MB."""
OTHER_STREAM = 1 << 16
"""Rays other than those that tell the light of sixteenths."""
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
        """(P, 16, 3) centres of sixteenths. [m]."""
        centres = self.cells.sixteenths().centres
        return np.ascontiguousarray(centres.reshape(PIECES, -1, 3).swapaxes(0, 1))

    def shifts(self, rays: int, seed: int) -> tuple[FloatArray, FloatArray]:
        """Return twice (P,) the irradiance that senders of one number miss, with noise that is independent.

        Parameters
        ----------
        rays : int
            From each patch: a power of 2, of which they are most even.
        seed : int
            Of the rays.
        """
        one, other = (
            self._shift(np.ascontiguousarray(pieces.T), rays, seed + OTHER_STREAM + stream)
            for stream, pieces in enumerate(self.pieces)
        )
        return one, other

    def _shift(self, pieces: FloatArray, rays: int, stream: int) -> FloatArray:
        tree, count = tree_of(self.cells), self.cells.n_patches
        found, at_a_time = np.empty(count), max(RAYS_AT_A_TIME // rays, 1)
        for first in range(0, count, at_a_time):
            rows = np.arange(first, min(first + at_a_time, count))
            met = np.empty((len(rows), rays), np.int32)
            landed_m, over = np.empty((*met.shape, 3)), np.empty(met.shape)
            tree.land(rows, stream, self.places, pieces, met=met, landed=landed_m, has=over)
            self._add_lamp(met, landed_m, over)
            found[rows] = (np.where(met >= 0, self.cells.reflectance[met], 0.0) * over).mean(axis=1)
        return found

    def _add_lamp(self, met: NDArray[np.int32], landed_m: FloatArray, over: FloatArray) -> None:
        """Add what the lamp's light has over its patch's mean where rays land, if it varies there."""
        edged = np.nonzero((met >= 0) & (self.lit.variance > VARIES)[met])
        on = met[edged]
        lamp = self.light.irradiance(landed_m[edged], self.cells.normals[on], self.cells.region[on])
        over[edged] += lamp - self.lit.irradiance[on]
