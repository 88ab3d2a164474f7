"""What pixels see of the light on a mesh."""

from __future__ import annotations

import numpy as np
import pytest

from sim.geometry.mesh import Mesh
from sim.geometry.optics import Lens, Pose, rays_at
from sim.geometry.rays import trace
from sim.geometry.scene import intersect
from sim.light.transport_of_scene import smooth_view
from sim.scenes.gridded import room
from sim.scenes.meshes import integrating_sphere

LENS = Lens(width_px=80, height_px=60, focal_px=(50.0, 50.0), principal_point_px=(39.5, 29.5))
POSE = Pose.look_at((1.0, 1.1, 1.2), (3.0, 4.0, 1.0))
ROOM = room((4.0, 4.5, 2.5), 0.5, 0.6)


def as_mesh(scene):
    """The same patches as a mesh, each wall a region."""
    return Mesh(
        name="mesh",
        vertices=scene.vertices,
        reflectance=scene.reflectance,
        region=scene.region,
        convex=True,
        closed=True,
    )


def rays():
    return rays_at(LENS, POSE, LENS.pixel_grid())


def seen_by(mesh, reflectance=1.0):
    hits = trace(mesh, POSE.position_m, rays())
    return hits, smooth_view(mesh, hits, np.full(len(hits.patch), reflectance))


def test_even_light_is_seen_evenly_whatever_the_patches_are():
    mesh = integrating_sphere(2, radius_m=4.0, reflectance=0.7)
    hits, view = seen_by(mesh, 0.35)
    assert (hits.patch >= 0).all()
    assert view @ np.full(mesh.n_patches, 0.7 * 3.0) == pytest.approx(0.35 * 3.0, rel=1e-9)


def test_light_that_rises_evenly_along_a_wall_is_seen_so():
    mesh = as_mesh(ROOM)
    hits, view = seen_by(mesh)
    points = POSE.position_m + hits.distance[:, None] * rays()
    slope = np.array([0.3, -0.2, 0.4])
    # A patch beside an edge has no neighbours beyond it: there the light is level.
    inner = ((points > 0.5) & (points < np.array([3.5, 4.0, 2.0]))) | np.isclose(points % np.array([4.0, 4.5, 2.5]), 0)
    inner = inner.all(axis=1)
    assert inner.sum() > 500
    light = view @ (0.6 * (2.0 + mesh.centres @ slope))
    assert light[inner] == pytest.approx(2.0 + points[inner] @ slope, abs=1e-9)


def test_a_mesh_of_a_rooms_patches_shows_nearly_what_the_room_shows():
    light = np.random.default_rng(3).uniform(0.9, 1.1, ROOM.n_patches)
    hits = intersect(ROOM, POSE.position_m, rays())
    gridded = smooth_view(ROOM, hits, np.ones(len(hits.patch))) @ light
    _, view = seen_by(as_mesh(ROOM))
    assert np.abs(view @ light - gridded).mean() < 0.25 * light.std()


def test_light_does_not_leak_from_one_wall_to_another():
    mesh = as_mesh(ROOM)
    hits, view = seen_by(mesh)
    lit = (mesh.region == 3).astype(float)
    light = view @ lit
    assert light[hits.face != 3].max() == 0
    assert light[hits.face == 3] == pytest.approx(1 / 0.6)


def test_a_black_patch_is_spoken_for_by_its_neighbours():
    reflectance = np.full(ROOM.n_patches, 0.6)
    reflectance[::7] = 0.0
    mesh = as_mesh(ROOM.with_reflectance(reflectance))
    _, view = seen_by(mesh)
    light = view @ (reflectance * 5.0)
    assert np.isfinite(light).all()
    assert light[light > 0] == pytest.approx(5.0)
    assert (light > 0).mean() > 0.95


def test_a_pixel_that_meets_nothing_sees_nothing():
    wall = room((4.0, 4.5, 2.5), 0.5, 0.6, ("y1",))
    mesh = Mesh(name="wall", vertices=wall.vertices, reflectance=wall.reflectance)
    hits, view = seen_by(mesh)
    assert (hits.patch < 0).any()
    assert (view @ np.ones(mesh.n_patches))[hits.patch < 0].max() == 0
