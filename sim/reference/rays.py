"""Rays on a gridded scene in plain numpy, face by face."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sim.arrays import FloatArray
from sim.geometry.scene import Face, Hits, Scene

EDGE_TOLERANCE = 1e-9
"""How far outside [0, 1] a ray may meet a face and still hit it, so that none leaks through an edge."""


def intersect(scene: Scene, origin_m: ArrayLike, directions: FloatArray) -> Hits:
    """Return what ``sim.geometry.scene.intersect`` finds; a face met from behind still stops a ray."""
    origin = np.asarray(origin_m, dtype=np.float64)
    n = len(directions)
    hit_face, patch = np.full(n, -1, dtype=np.intp), np.full(n, -1, dtype=np.intp)
    distance, uv, cosine = np.full(n, np.inf), np.zeros((n, 2)), np.zeros(n)
    for index, face in enumerate(scene.faces):
        at, here_uv, here_cosine = meet(face, origin, directions)
        nearer = at < distance
        hit_face[nearer], distance[nearer] = index, at[nearer]
        uv[nearer], cosine[nearer] = here_uv[nearer], here_cosine[nearer]
    for index, face in enumerate(scene.faces):
        lit = (hit_face == index) & (cosine > 0)
        patch[lit] = face.patch_at(uv[lit])
    return Hits(face=hit_face, patch=patch, distance=distance, uv=uv, cos_incidence=cosine)


def meet(face: Face, origin: FloatArray, directions: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the distance (infinite for a miss), face coordinates and cosine of incidence of rays on one face."""
    towards = directions @ face.normal
    height = (origin - face.origin_m) @ face.normal
    moving = np.where(np.abs(towards) > 1e-15, towards, np.inf)
    at = -height / moving
    relative = origin - face.origin_m
    size_u, size_v = face.size_m
    u = (relative @ face.axes[0] + at * (directions @ face.axes[0])) / size_u
    v = (relative @ face.axes[1] + at * (directions @ face.axes[1])) / size_v
    low, high = -EDGE_TOLERANCE, 1 + EDGE_TOLERANCE
    inside = (at > 1e-12) & (u >= low) & (u <= high) & (v >= low) & (v <= high)
    uv = np.clip(np.stack([u, v], axis=-1), 0.0, 1.0)
    return np.where(inside, at, np.inf), uv, -towards
