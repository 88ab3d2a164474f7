"""Room corners with things in them: scenes that hide much of themselves, of as many facets as one asks for."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from sim.arrays import FloatArray
from sim.errors import SimulationError
from sim.geometry.mesh import Mesh
from sim.scenes.meshes import grid_of_quad, icosphere

CORNER_M = 2.0
"""Edge of the floor and of the two walls."""
THINGS_SHARE = 0.6
"""Of the facets, on what stands in the corner."""
WALLS_SHARE = 0.1
"""Of the facets, on the walls at least."""
FEWEST, MOST = 100, 1_000_000
"""Facets."""


def corner_with_ball(facets: int = 2144, reflectance: float = 0.6) -> Mesh:
    """Return a floor and two walls of 2 m, and a wavy ball of 0.45 m radius before them.

    Parameters
    ----------
    facets : int
        About how many triangles there are: most of them on the ball.
    reflectance : float
        Of all surfaces, in [0, 1].

    Returns
    -------
    Mesh

    Raises
    ------
    SimulationError
        For fewer than 100 or more than a million facets.
    """
    subdivisions = _subdivisions(THINGS_SHARE * _checked(facets))
    if 20 * 4**subdivisions > (1 - WALLS_SHARE) * facets:
        subdivisions -= 1
    ball = icosphere(subdivisions)
    x, y, z = np.moveaxis(ball, 2, 0)
    radius = 0.45 * (1 + 0.12 * np.sin(5 * x) * np.sin(4 * y + 1) * np.cos(6 * z))
    ball = ball * radius[..., None] + (1.0, 1.0, 0.75)
    return _mesh("corner-with-ball", [*_walls(facets - len(ball)), ball], reflectance)


def random_corner(seed: int, facets: int = 2000) -> Mesh:
    """Return a floor and two walls with three to eight balls, boxes and domes anywhere in them, which may overlap.

    Parameters
    ----------
    seed : int
        Other things in other places, and other reflectances.
    facets : int
        About how many there are.

    Returns
    -------
    Mesh

    Raises
    ------
    SimulationError
        For fewer than 100 or more than a million facets.
    """
    rng = np.random.default_rng(seed)
    count = int(rng.integers(3, 9))
    each = max(20, int(THINGS_SHARE * _checked(facets) / count))
    makers = (_ball, _box, _dome)
    things = [makers[int(rng.integers(len(makers)))](each, rng) for _ in range(count)]
    walls = _walls(max(facets - sum(len(thing) for thing in things), int(WALLS_SHARE * facets)))
    reflectance = rng.uniform(0.2, 0.9, 3 + count)
    return _mesh(f"random-corner-{seed}", [*walls, *things], reflectance)


def _checked(facets: int) -> int:
    if not FEWEST <= facets <= MOST:
        raise SimulationError(f"{facets} facets; a cluttered corner has {FEWEST:,} ... {MOST:,}")
    return facets


def _subdivisions(facets: float) -> int:
    return max(0, round(math.log(facets / 20, 4)))


def _mesh(name: str, parts: list[FloatArray], reflectance: ArrayLike) -> Mesh:
    """Triangles (N, 3, 3) of each part, with one reflectance or one a part."""
    vertices = np.concatenate(parts)
    shares = np.repeat(np.broadcast_to(reflectance, len(parts)), [len(part) for part in parts])
    return Mesh(name=name, vertices=vertices[:, [0, 1, 2, 2]], reflectance=shares)


def _walls(facets: int) -> list[FloatArray]:
    """Floor and two walls, each a grid of squares cut into two triangles."""
    cells = max(1, round(np.sqrt(facets / 6)))
    zero, x, y, z = np.zeros(3), *(CORNER_M * np.eye(3))
    corners = ([zero, x, x + y, y], [zero, y, y + z, z], [zero, z, z + x, x])
    grids = (grid_of_quad(quad, cells, cells) for quad in corners)
    return [np.concatenate([grid[:, [0, 1, 2]], grid[:, [0, 2, 3]]]) for grid in grids]


def _placed(triangles: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Turned about the vertical, and moved to a random place off floor and walls."""
    angle = rng.uniform(0, 2 * np.pi)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    return np.asarray(triangles @ turn.T + rng.uniform(0.35, 1.7, 3))


def _ball(facets: int, rng: np.random.Generator) -> FloatArray:
    return _placed(rng.uniform(0.1, 0.3) * icosphere(_subdivisions(facets)), rng)


def _box(facets: int, rng: np.random.Generator) -> FloatArray:
    cells = max(1, round(np.sqrt(facets / 12)))
    corner, size = np.array([-1, -1, -1]), 2 * np.eye(3)
    sides = [(i, (i + 1) % 3, (i + 2) % 3) for i in range(3)]
    low = [(corner, size[k], size[j]) for _, j, k in sides]
    high = [(corner + size[i], size[j], size[k]) for i, j, k in sides]
    quads = [np.stack([p, p + u, p + u + v, p + v]) for p, u, v in low + high]
    grids = np.concatenate([grid_of_quad(quad, cells, cells) for quad in quads])
    triangles = np.concatenate([grids[:, [0, 1, 2]], grids[:, [0, 2, 3]]])
    return _placed(triangles * rng.uniform(0.08, 0.3, 3), rng)


def _dome(facets: int, rng: np.random.Generator) -> FloatArray:
    """An open half of a sphere, lit inside and, as a second sheet, outside."""
    triangles = icosphere(_subdivisions(facets))
    half = triangles[triangles.mean(axis=1)[:, 2] > 0]
    return _placed(rng.uniform(0.15, 0.3) * np.concatenate([half, 0.97 * half[:, [0, 2, 1]]]), rng)
