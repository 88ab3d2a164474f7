"""Rays from facets and onto them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from sim import _kernel
from sim.arrays import FloatArray, IntArray
from sim.geometry.mending.remarks import Facets
from sim.geometry.scene import hits_of_tracer
from sim.geometry.topology import extent

LIFT = 1e-6
"""Of the scene's size: rays begin this far above their facet."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Tracing:
    """Facets with a tree over them."""

    corners: FloatArray
    """(T, 3, 3) [m]."""
    along: FloatArray
    """(T, 3) unit vectors along the first edge."""
    normals: FloatArray
    """(T, 3)."""
    lift_m: float
    tracer: _kernel.Tracer

    @classmethod
    def of(cls, facets: Facets) -> Tracing:
        """Build the tree."""
        corners = facets.corners
        a, b, c = np.moveaxis(corners, 1, 0)
        along = (b - a) / np.linalg.norm(b - a, axis=1, keepdims=True)
        normals = np.cross(b - a, c - a)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        frames = np.stack([corners.mean(axis=1), along, np.cross(normals, along), normals], axis=1)
        frames = np.ascontiguousarray(frames.reshape(-1, 12))
        return cls(
            corners=corners,
            along=along,
            normals=normals,
            lift_m=LIFT * extent(corners),
            tracer=_kernel.Tracer(np.zeros((0, 15)), np.ascontiguousarray(facets.patches), frames),
        )

    def points(self, facet: IntArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return (N, 3) points of facets, even over each for (N, 2) even numbers [m], and the normals there."""
        share = np.where(u.sum(axis=1, keepdims=True) > 1, 1 - u, u)
        a, b, c = np.moveaxis(self.corners[facet], 1, 0)
        return a + share[:, :1] * (b - a) + share[:, 1:] * (c - a), self.normals[facet]

    def directions(self, facet: IntArray, u: FloatArray) -> FloatArray:
        """Return (N, 3) unit directions from facets, by the cosine to the normal for (N, 2) even numbers."""
        along, normals = self.along[facet], self.normals[facet]
        angle, radius = 2 * np.pi * u[:, :1], np.sqrt(u[:, 1:])
        level = np.cos(angle) * along + np.sin(angle) * np.cross(normals, along)
        return np.asarray(radius * level + np.sqrt(1 - radius**2) * normals)

    def first_met(self, origins: FloatArray, directions: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return (N,) facet met first, -1 none; cosine there, below 0 from behind; distance [m]."""
        hits = hits_of_tracer(self.tracer, origins, directions)
        return hits.face, hits.cos_incidence, hits.distance

    def nearest_along(self, places: FloatArray, normals: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return (N,) facet that lies nearest below or above a place along a normal, lit side up, and how far [m].

        Where there is none, the facet with the nearest middle.
        """
        found = []
        for sign in (-1.0, 1.0):
            facet, cosine, distance = self.first_met(places - sign * self.lift_m * normals, sign * normals)
            good = (facet >= 0) & (sign * cosine < 0)
            found.append((facet, np.where(good, distance, np.inf)))
        (below, down_m), (above, up_m) = found
        facet, distance_m = np.where(down_m <= up_m, below, above), np.minimum(down_m, up_m)
        lost = np.flatnonzero(~np.isfinite(distance_m))
        if len(lost):
            distance_m[lost], facet[lost] = KDTree(self.corners.mean(axis=1)).query(places[lost])
        return facet, distance_m
