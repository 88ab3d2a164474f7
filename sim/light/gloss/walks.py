"""Rays that go on from glossy patches: where each leg lands, and how much of its light goes that way.

Legs of one walk that starts with the share 1 send back at most 1 of its light matte: the share that goes on from a
patch is at most its gloss, and matte reflectance and gloss together are at most 1.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sim.arrays import BoolArray, FloatArray, IntArray
from sim.geometry.rays import trace
from sim.geometry.scene import Hits
from sim.geometry.surface import Surface
from sim.light.gloss.lobe import frames_of, lobe_directions
from sim.light.gloss.material import Gloss

MOST_LEGS = 24
"""Of a walk: with a gloss of 0.7 a ten-thousandth is left."""
LEAST_SHARE = 1e-4
"""Of a walk's light: what is less is not followed."""
LIFT = 1e-9
"""Of the surface's size, by which rays begin above the patch that they leave; rays are traced in double precision."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Arrivals:
    """Light of N walks that comes to places on patches."""

    walk: IntArray
    """(N,) number of the walk."""
    patch: IntArray
    """(N,) that each comes to."""
    points_m: FloatArray
    """(N, 3) where [m]."""
    directions: FloatArray
    """(N, 3) along which, unit vectors."""
    share: FloatArray
    """(N,) of the walk's light that comes along."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LightLeg(Arrivals):
    """One leg of N walks that meet something, traced."""

    hits: Hits

    def of(self, chosen: BoolArray | IntArray) -> LightLeg:
        """Return some of them."""
        return LightLeg(
            walk=self.walk[chosen],
            patch=self.patch[chosen],
            hits=hits_of(self.hits, chosen),
            points_m=self.points_m[chosen],
            directions=self.directions[chosen],
            share=self.share[chosen],
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class GlossySurface:
    """A surface with its gloss, and its size."""

    surface: Surface
    gloss: Gloss
    lift_m: float

    @classmethod
    def of(cls, surface: Surface, gloss: Gloss) -> GlossySurface:
        """Return both, held to each other. Raises SimulationError."""
        gloss.refuse_light_creating(surface)
        size = float(np.linalg.norm(np.ptp(np.asarray(surface.vertices).reshape(-1, 3), axis=0)))
        return cls(surface=surface, gloss=gloss, lift_m=LIFT * size)

    def lifted(self, patch: IntArray, points_m: FloatArray) -> FloatArray:
        """Return (N, 3) points a little above their patches [m]."""
        return np.asarray(points_m + self.lift_m * self.surface.normals[patch])

    def first_leg(
        self, origins_m: FloatArray, directions: FloatArray, share: FloatArray, walk: IntArray | None = None
    ) -> LightLeg:
        """Return where rays land that meet a patch from its lit side.

        Parameters
        ----------
        origins_m : (3,) or (N, 3) array
            [m]
        directions : (N, 3) array
            Unit vectors.
        share : (N,) array
            Of light at the beginning.
        walk : (N,) int array, optional
            Numbers of the walks; None: 0, 1, 2 ...

        Returns
        -------
        LightLeg
        """
        hits = trace(self.surface, origins_m, directions)
        met = np.flatnonzero(hits.patch >= 0)
        begin = np.broadcast_to(origins_m, directions.shape)[met]
        return LightLeg(
            walk=met if walk is None else walk[met],
            patch=hits.patch[met],
            hits=hits_of(hits, met),
            points_m=begin + hits.distance[met, None] * directions[met],
            directions=directions[met],
            share=share[met],
        )

    def further(self, begin: Arrivals, chances: FloatArray, random: np.random.Generator) -> Iterator[LightLeg]:
        """Follow light on from glossy patches, leg by leg, as far as it matters.

        Parameters
        ----------
        begin : Arrivals
            On glossy patches.
        chances : (N, 2) array
            That choose the first direction; ``random`` chooses those after.
        random : numpy.random.Generator

        Yields
        ------
        LightLeg
        """
        for _ in range(MOST_LEGS):
            directions, weight = self.reflected(begin.patch, begin.directions, chances)
            share = begin.share * self.gloss.share[begin.patch] * weight
            on = np.flatnonzero(share > 0)
            from_m = self.lifted(begin.patch[on], begin.points_m[on])
            leg = self.first_leg(from_m, directions[on], share[on], begin.walk[on])
            yield leg
            begin = leg.of(np.flatnonzero(leg.share * self.gloss.share[leg.patch] > LEAST_SHARE))
            if not len(begin.walk):
                return
            chances = random.uniform(size=(len(begin.walk), 2))

    def reflected(self, patch: IntArray, directions: FloatArray, chances: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return (N, 3) where rays go on from the lobes of patches, and (N,) their weights, at most 1."""
        axes = frames_of(self.surface.normals[patch])
        outgoing = -np.einsum("nij,nj->ni", axes, directions)
        outgoing[:, 2] = np.maximum(outgoing[:, 2], 1e-9)
        local, weight = lobe_directions(outgoing, self.gloss.roughness[patch], chances)
        return np.einsum("nij,ni->nj", axes, local), weight


def hits_of(hits: Hits, chosen: BoolArray | IntArray) -> Hits:
    """Return some hits."""
    return Hits(
        face=hits.face[chosen],
        patch=hits.patch[chosen],
        distance=hits.distance[chosen],
        uv=hits.uv[chosen],
        cos_incidence=hits.cos_incidence[chosen],
    )


def even_points(count: int, dimensions: int) -> FloatArray:
    """Return (count, dimensions) points that fill a unit cube evenly, the same ones always.

    References
    ----------
    M. Roberts, The unreasonable effectiveness of quasirandom sequences, 2018: steps of powers of the root of
    x^(d + 1) = x + 1.
    """
    root = 2.0
    for _ in range(60):
        root = (1 + root) ** (1 / (dimensions + 1))
    steps = root ** -np.arange(1.0, dimensions + 1)
    return np.asarray((0.5 + np.arange(1, count + 1)[:, None] * steps) % 1.0)
