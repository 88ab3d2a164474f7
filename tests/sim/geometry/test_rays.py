"""Rays and segments: the native kernel against its definition, in scenes and in the meshes of their patches."""

import numpy as np
import pytest

from sim import _kernel
from sim.geometry.rays import blocked, trace
from sim.geometry.scene import intersect
from sim.reference.rays import intersect as intersect_reference
from sim.scenes.gridded import corner, paper_room, room, room_with_box
from tests.sim.meshes_of_scenes import as_mesh, as_triangles


@pytest.mark.parametrize("level", ["baseline", "avx2", "avx512", "avx512vbmi"])
def test_rays_meet_what_the_numpy_reference_says(level, request):
    if level not in _kernel.instruction_sets():
        pytest.skip(f"this processor lacks {level}")
    request.addfinalizer(lambda: _kernel.set_instruction_set(_kernel.best_instruction_set()))
    _kernel.set_instruction_set(level)
    rng = np.random.default_rng(1)
    directions = rng.normal(size=(3000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for scene in (paper_room(), room_with_box(0.5), corner()):
        for origin in (np.array([1.1, 0.9, 0.7]), rng.random((3000, 3)) * (1.8, 1.8, 1.8)):
            found, wanted = intersect(scene, origin, directions), intersect_reference(scene, origin, directions)
            assert np.array_equal(found.face, wanted.face)
            assert np.array_equal(found.patch, wanted.patch)
            assert np.allclose(found.distance, wanted.distance, rtol=1e-12)
            met = wanted.face >= 0
            assert np.allclose(found.uv[met], wanted.uv[met], atol=1e-12)
            assert np.allclose(found.cos_incidence[met], wanted.cos_incidence[met], atol=1e-12)


def test_rays_along_a_face_and_into_the_open_meet_nothing():
    scene = room(faces=["floor"])
    hits = intersect(scene, (1.0, 1.0, 1.0), np.array([[1.0, 0, 0], [0, 0, 1.0], [0, 0, -1.0]]))
    assert hits.face.tolist() == [-1, -1, 0]
    assert np.isinf(hits.distance[:2]).all()
    assert hits.distance[2] == pytest.approx(1.0)


@pytest.mark.parametrize("build", [as_mesh, as_triangles])
def test_rays_meet_a_mesh_where_they_meet_the_scene_it_came_from(build):
    scene = room_with_box(0.5)
    mesh = build(scene)
    directions = np.random.default_rng(2).normal(size=(4000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    on_scene, on_mesh = intersect(scene, (1.1, 0.9, 0.7), directions), trace(mesh, (1.1, 0.9, 0.7), directions)
    assert np.array_equal(on_mesh.face, on_scene.face)
    assert np.array_equal(on_mesh.patch * scene.n_patches // mesh.n_patches, on_scene.patch)
    assert np.allclose(on_mesh.distance, on_scene.distance, rtol=1e-10)
    assert np.allclose(on_mesh.cos_incidence, on_scene.cos_incidence, atol=1e-10)


def test_a_box_stops_the_segments_that_pass_through_it_and_no_others():
    scene = room_with_box(0.5)  # the box: 1.9 ... 2.9 m in x and y, 0 ... 1 m in z
    start = np.array([[1.0, 2.4, 0.5], [1.0, 2.4, 1.5], [1.0, 2.4, 0.5], [2.4, 2.4, 1.0]])
    end = np.array([[4.0, 2.4, 0.5], [4.0, 2.4, 1.5], [1.9, 2.4, 0.5], [2.4, 2.4, 2.4]])
    for surface in (scene, as_triangles(scene)):
        assert blocked(surface, start, end).tolist() == [True, False, False, False]
