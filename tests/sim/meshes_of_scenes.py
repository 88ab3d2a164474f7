"""The patches of a gridded scene as a mesh, in quads or in triangles."""

import numpy as np

from sim.geometry.mesh import Mesh


def as_mesh(scene):
    return Mesh(
        name=scene.name,
        vertices=scene.vertices,
        reflectance=scene.reflectance,
        convex=scene.convex,
        closed=scene.closed,
        region=scene.region,
    )


def as_triangles(scene):
    a, b, c, d = np.moveaxis(scene.vertices, 1, 0)
    vertices = np.stack([np.stack([a, b, c, c], axis=1), np.stack([a, c, d, d], axis=1)], axis=1).reshape(-1, 4, 3)
    twice = [np.repeat(values, 2) for values in (scene.reflectance, scene.region)]
    return Mesh(
        name="triangles",
        vertices=vertices,
        reflectance=twice[0],
        convex=scene.convex,
        closed=scene.closed,
        region=twice[1],
    )
