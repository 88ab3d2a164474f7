"""Form factors of flat polygons that see each other whole, by plain numpy: Gauss points times Lambert's formula.

For convex scenes only: no patch reaches behind another's plane, so nothing is clipped. Where two patches touch,
what a point sees of the other bends like x log x towards the common edge: there the points are crowded by a
substitution that is flat at both ends.
"""

from __future__ import annotations

import numpy as np

from sim.arrays import BoolArray, FloatArray, IntArray
from sim.geometry.surface import Surface

NEAR = 3.0
"""Pairs whose centres are closer than this many patch diagonals take the higher order."""
ORDER_TOUCHING, ORDER_NEAR, ORDER_FAR = 32, 10, 6


def exchange_reference(surface: Surface) -> FloatArray:
    """(P, P) exchange areas A_i F_ij above the diagonal, 0 below it [m²]."""
    exchange = np.zeros((surface.n_patches, surface.n_patches))
    diagonal = np.linalg.norm(surface.vertices[:, 2] - surface.vertices[:, 0], axis=1)
    for patch in range(surface.n_patches - 1):
        others = np.arange(patch + 1, surface.n_patches)
        away = np.linalg.norm(surface.centres[others] - surface.centres[patch], axis=1)
        near = away < NEAR * np.maximum(diagonal[others], diagonal[patch])
        touching = near.copy()
        touching[near] = _touch(surface.vertices[patch], surface.vertices[others[near]], 1e-9 * diagonal[patch])
        kinds = ((touching, ORDER_TOUCHING), (near & ~touching, ORDER_NEAR), (~near, ORDER_FAR))
        for some, order in kinds:
            exchange[patch, others[some]] = _exchange(surface, patch, others[some], order)
    return exchange


def largest_relative_error(matrix: FloatArray, surface: Surface, exchange: FloatArray) -> float:
    """Largest relative error of the form factors of pairs that see each other."""
    i, j = np.nonzero(exchange > 1e-14 * exchange.max())
    return float(np.abs(matrix[i, j] * surface.areas[i] / exchange[i, j] - 1).max())


def _touch(corners: FloatArray, others: FloatArray, distance_m: float) -> BoolArray:
    """(K,) whether a polygon shares a corner with each of the others."""
    apart = np.linalg.norm(others[:, :, None] - corners, axis=-1)
    return np.asarray((apart < distance_m).any(axis=(1, 2)))


def _exchange(surface: Surface, patch: int, others: IntArray, order: int) -> FloatArray:
    points, weights = _gauss_points(surface.vertices[patch], order)
    lambert = _lambert(points, surface.normals[patch], surface.vertices[others])
    return np.asarray(weights @ lambert)


def _gauss_points(corners: FloatArray, order: int) -> tuple[FloatArray, FloatArray]:
    """(n, 3) points of a quadrilateral or triangle and their areas (n,) [m, m²]."""
    nodes, weights = _rule(order)
    u, v = (part.ravel() for part in np.meshgrid(nodes, nodes))
    shape = np.stack([(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v], axis=1)
    a, b, c, d = corners
    along_u = np.outer(1 - v, b - a) + np.outer(v, c - d)
    along_v = np.outer(1 - u, d - a) + np.outer(u, c - b)
    area = np.linalg.norm(np.cross(along_u, along_v), axis=1)
    return shape @ corners, np.outer(weights, weights).ravel() * area


def _rule(order: int) -> tuple[FloatArray, FloatArray]:
    """Gauss nodes and weights on 0 ... 1; those for touching patches crowded towards both ends."""
    nodes, weights = np.polynomial.legendre.leggauss(order)
    t, weights = (nodes + 1) / 2, weights / 2
    if order < ORDER_TOUCHING:
        return t, weights
    return t**3 * (10 - 15 * t + 6 * t**2), weights * 30 * t**2 * (1 - t) ** 2


def _lambert(points: FloatArray, normal: FloatArray, polygons: FloatArray) -> FloatArray:
    """(points, polygons) share of the light of each point that meets each polygon."""
    to_corner = polygons - points[:, None, None]
    following = np.roll(to_corner, -1, axis=2)
    across = np.cross(to_corner, following)
    sine = np.linalg.norm(across, axis=-1)
    angle = np.arctan2(sine, (to_corner * following).sum(axis=-1))
    edge = angle * (across @ normal) / np.where(sine > 0, sine, 1.0)
    # Corners run counter-clockwise seen from the point: the sum is negative.
    return np.asarray(np.maximum(-edge.sum(axis=-1) / (2 * np.pi), 0.0))
