"""Where rays meet any surface, gridded scene or mesh."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from sim import _kernel
from sim.arrays import BoolArray, FloatArray
from sim.geometry.optics import Lens, Pose, undistorted
from sim.geometry.scene import Hits, Scene, hits_of_tracer, intersect
from sim.geometry.surface import Surface
from sim.kept import Kept

TOUCHING_M = 1e-6
"""Nearer to a surface a device stands on it."""
HARDLY_ANY_LOST = 0.9
"""Share of rays that meet something within a closed surface, whose seams may let some through."""
_tracer = Kept[Surface, _kernel.Tracer]("_tracer")


def tracer_of(surface: Surface) -> _kernel.Tracer:
    """Return a surface's tracer, built once: gridded rectangles of a scene, or a tree of boxes over the patches."""
    if isinstance(surface, Scene):
        return surface.tracer
    return _tracer.once(surface, lambda: _tracer_over(surface))


def _tracer_over(surface: Surface) -> _kernel.Tracer:
    frames = np.concatenate([surface.centres[:, None], plane_axes(surface), surface.normals[:, None]], axis=1)
    corners = np.ascontiguousarray(surface.vertices, dtype=np.float64)
    return _kernel.Tracer(np.zeros((0, 15)), corners, np.ascontiguousarray(frames.reshape(-1, 12)))


def plane_axes(surface: Surface) -> FloatArray:
    """Return (P, 2, 3) two unit axes in each patch's plane: along its first edge, and across it."""
    along = surface.vertices[:, 1] - surface.vertices[:, 0]
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    return np.stack([along, np.cross(surface.normals, along)], axis=1)


def trace(surface: Surface, origin_m: ArrayLike, directions: ArrayLike) -> Hits:
    """Return the nearest hit of each ray, as ``scene.intersect`` does in a scene; a mesh's patches stop light too.

    Parameters
    ----------
    surface : Surface
    origin_m : (3,) or (N, 3) array
        Where the rays begin. [m]
    directions : (N, 3) array
        Unit directions.

    Returns
    -------
    Hits
        Of a mesh, ``face`` is the region that is met, and ``uv`` the place about the patch's centroid [m].
    """
    if isinstance(surface, Scene):
        return intersect(surface, origin_m, np.asarray(directions))
    hits = hits_of_tracer(tracer_of(surface), origin_m, directions)
    return replace(hits, face=np.where(hits.face >= 0, surface.region[hits.face], -1))


def blocked(surface: Surface, start_m: FloatArray, end_m: FloatArray) -> BoolArray:
    """Return (N,) bool: something of the surface stands between two points, (N, 3) each [m]."""
    stopped = np.empty(len(start_m), dtype=np.uint8)
    tracer_of(surface).blocked(np.ascontiguousarray(start_m), np.ascontiguousarray(end_m), stopped)
    return stopped.astype(bool)


def stands_in_air(surface: Surface, point_m: ArrayLike) -> bool:
    """Return whether a point has lit sides around it: most of what is met, and nothing is touched.

    Parameters
    ----------
    surface : Surface
    point_m : (3,) array
        [m]

    Returns
    -------
    bool
        Of 98 rays all around, more meet lit sides than backs. False in or behind a wall, in a box, outside of a closed
        room, and where nothing is met; a sheet with one lit side may show its back.
    """
    hits = trace(surface, point_m, _all_around())
    met = hits.face >= 0
    if surface.closed and met.mean() < HARDLY_ANY_LOST:
        return False  # on a wall, half of the rays begin behind it
    lit = met & (hits.cos_incidence > 0)
    return bool(2 * lit.sum() > met.sum() and hits.distance[met].min() >= TOUCHING_M)


def _all_around() -> FloatArray:
    """(98, 3) unit directions over the sphere, none along a wall of a box."""
    grid = np.stack(np.meshgrid(*[(-2.1, -1.03, 0.07, 1.11, 2.05)] * 3), axis=-1).reshape(-1, 3)
    outer = grid[np.abs(grid).max(axis=1) > 2]
    return np.asarray(outer / np.linalg.norm(outer, axis=1, keepdims=True))


def device_of(lens: Lens, pose: Pose) -> _kernel.Device:
    """Return lens and pose as the kernel wants them.

    Raises
    ------
    SimulationError
        If the lens's distortion folds the image over (seen at its border).
    """
    x = np.linspace(-0.5, lens.width_px - 0.5, 65)
    y = np.linspace(-0.5, lens.height_px - 0.5, 65)
    border = [(x, y[:1]), (x, y[-1:]), (x[:1], y), (x[-1:], y)]
    undistorted(lens, np.concatenate([np.stack(np.meshgrid(*side), axis=-1).reshape(-1, 2) for side in border]))
    numbers = np.array([*lens.focal_px, *lens.principal_point_px, *lens.distortion], dtype=np.float64)
    rotation = np.ascontiguousarray(pose.rotation)
    return _kernel.Device(
        width=lens.width_px, height=lens.height_px, lens=numbers, rotation=rotation, position=pose.position_m
    )


def low_discrepancy(n: int) -> FloatArray:
    """Return (n, 4) even points in the unit cube: the additive sequence of four dimensions' generalised golden ratio.

    M. Roberts, The unreasonable effectiveness of quasirandom sequences, 2018.
    """
    ratio = 1.0
    for _ in range(64):
        ratio = (1 + ratio) ** (1 / 5)
    steps = ratio ** -np.arange(1.0, 5.0)
    return np.asarray((0.5 + np.outer(np.arange(1, n + 1), steps)) % 1.0)
