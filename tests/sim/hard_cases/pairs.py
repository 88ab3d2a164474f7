"""Pairs of patches and their factors by formulae that are not the product's."""

import numpy as np

from sim.geometry.mesh import Mesh

SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
FACING = np.array([[0.0, 0, 1], [0, 1, 1], [1, 1, 1], [1, 0, 1]])
"""The square 1 m above, lit side down."""


def pair(first, second, **claims):
    return Mesh(name="pair", vertices=np.stack([first, second]), reflectance=np.full(2, 0.5), **claims)


def lambert(points, normal, polygon):
    """(N,) factor from points with one normal to a polygon above their horizon (Lambert 1760)."""
    corners = polygon - points[:, None]
    after = np.roll(corners, -1, axis=1)
    across = np.cross(after, corners)
    length = np.linalg.norm(across, axis=2)
    angle = np.arctan2(length, (corners * after).sum(axis=2))
    cosine = across @ normal / np.where(length > 0, length, 1)
    return (angle * cosine).sum(axis=1) / (2 * np.pi)


def reference_factor(rectangle, polygon, steps=60):
    """F by Lambert's formula, integrated by the tanh-sinh rule, which does not mind what happens at edges."""
    t = np.linspace(-3.1, 3.1, steps)
    x = 1 / (1 + np.exp(-np.pi * np.sinh(t)))
    w = np.pi * np.cosh(t) * x * (1 - x)
    w /= w.sum()
    u, v = (axis.ravel() for axis in np.meshgrid(x, x))
    edge_u, edge_v = rectangle[1] - rectangle[0], rectangle[3] - rectangle[0]
    normal = np.cross(edge_u, edge_v)
    points = rectangle[0] + u[:, None] * edge_u + v[:, None] * edge_v
    return np.outer(w, w).ravel() @ lambert(points, normal / np.linalg.norm(normal), polygon)


def opposed(x, y):
    """F of two aligned rectangles, sizes over distance x and y (Incropera, table 13.2)."""
    rx, ry = np.sqrt(1 + x * x), np.sqrt(1 + y * y)
    logarithm = np.log(rx * ry / np.sqrt(1 + x * x + y * y))
    arcs = x * ry * np.arctan(x / ry) + y * rx * np.arctan(y / rx) - x * np.arctan(x) - y * np.arctan(y)
    return 2 / (np.pi * x * y) * (logarithm + arcs)
