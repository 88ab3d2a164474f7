"""Final gather in plain numpy: every point from every patch."""

from __future__ import annotations

import numpy as np

from sim.arrays import FloatArray
from sim.geometry.surface import Surface


def irradiance(surface: Surface, radiosity: FloatArray, points_m: FloatArray, normals: FloatArray) -> FloatArray:
    """Return what ``sim.picture.gather.irradiance`` finds, for convex surfaces above every point's horizon."""
    corners = surface.vertices[None] - points_m[:, None, None]
    following = np.roll(corners, -1, axis=2)
    across = np.cross(following, corners)
    length = np.linalg.norm(across, axis=-1)
    angle = np.arctan2(length, (corners * following).sum(axis=-1))
    projected = np.einsum("npck,nk->npc", across, normals)
    factor = np.where(length > 0, angle * projected / np.where(length > 0, length, 1.0), 0.0).sum(axis=2) / (2 * np.pi)
    return np.asarray(np.maximum(factor, 0.0) @ radiosity)
