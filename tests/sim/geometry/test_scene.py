"""Scenes and rays."""

import numpy as np
import pytest

from sim.errors import SimulationError
from sim.geometry.scene import Face, Scene, intersect
from sim.scenes.gridded import LIBRARY, corner, paper_room, room, room_with_box


def test_the_paper_room_is_the_papers():
    scene = paper_room()
    assert scene.n_patches == 576
    assert scene.areas.sum() == pytest.approx(2 * 4.8 * 4.8 + 4 * 4.8 * 2.4)
    assert paper_room(ceiling=False).n_patches == 432


def test_every_normal_points_into_the_room():
    scene = room((3.0, 2.0, 1.0), 0.5)
    towards_middle = np.array([1.5, 1.0, 0.5]) - scene.centres
    assert ((towards_middle * scene.normals).sum(axis=1) > 0).all()


def test_the_boxs_normals_point_out_of_the_box():
    scene = room_with_box()
    box = np.concatenate([np.arange(f.n_patches) + f.first_patch for f in scene.faces if f.name.startswith("box")])
    outwards = scene.centres[box] - np.array([2.4, 2.4, 0.5])
    assert ((outwards * scene.normals[box]).sum(axis=1) > 0).all()


def test_a_ray_at_each_patch_centre_hits_that_patch():
    scene = room((3.0, 2.0, 1.0), 0.5)
    eye = np.array([1.1, 0.7, 0.4])
    hits = intersect(scene, eye, scene.centres - eye)
    assert np.array_equal(hits.patch, np.arange(scene.n_patches))
    assert np.allclose(hits.distance, 1.0)
    assert (hits.cos_incidence > 0).all()


def test_no_ray_leaks_from_a_closed_room():
    rng = np.random.default_rng(3)
    directions = rng.normal(size=(20_000, 3))
    corners = np.array([[x, y, z] for x in (0, 4.8) for y in (0, 4.8) for z in (0, 2.4)]) - (1.2, 1.3, 1.1)
    rays = np.concatenate([directions, corners])
    assert (intersect(paper_room(), (1.2, 1.3, 1.1), rays).patch >= 0).all()


def test_an_open_side_lets_rays_out():
    hits = intersect(corner(), (1.0, 1.0, 1.0), np.array([[1.0, 0, 0], [-1.0, 0, 0]]))
    assert hits.face[0] == -1
    assert hits.patch[1] >= 0
    assert np.isinf(hits.distance[0])


def test_a_face_met_from_behind_stops_the_ray_but_is_no_patch():
    hits = intersect(corner(), (-1.0, 1.0, 1.0), np.array([[1.0, 0.0, 0.0]]))
    assert hits.face[0] == 1
    assert hits.patch[0] == -1
    assert hits.cos_incidence[0] < 0


def test_the_box_hides_the_floor_behind_it():
    eye, behind = np.array([1.0, 2.4, 0.5]), np.array([4.0, 2.4, 0.0])
    scene = room_with_box()
    name = scene.faces[intersect(scene, eye, (behind - eye)[None]).face[0]].name
    assert name == "box x0"


@pytest.mark.parametrize("name", LIBRARY)
def test_finer_patches_leave_the_surface_as_it_is(name):
    assert LIBRARY[name](0.25).areas.sum() == pytest.approx(LIBRARY[name](0.5).areas.sum())


def test_reflectance_by_face_reaches_its_patches():
    scene = room((1, 1, 1), 0.5, {"floor": 0.2, "x0": 0.9}, faces=("floor", "x0"))
    assert np.array_equal(scene.reflectance, [0.2] * 4 + [0.9] * 4)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: room(faces=("floor", "roof")), "unknown room faces roof"),
        (lambda: room(patch_size_m=0.0), "above 0"),
        (lambda: room(size_m=(1, -1, 1)), "above 0"),
        (lambda: room(reflectance=1.2), "0 ... 1"),
        (lambda: room(reflectance={"floor": 0.5}), "no reflectance for face ceiling"),
    ],
)
def test_impossible_rooms_are_refused(build, message):
    with pytest.raises(SimulationError, match=message):
        build()


def test_impossible_faces_are_refused():
    x, y = np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
    with pytest.raises(SimulationError, match="instead of 90"):
        Face(name="skew", origin_m=np.zeros(3), edge_u_m=x, edge_v_m=x + y, rows=1, columns=1, first_patch=0)
    with pytest.raises(SimulationError, match="above 0"):
        Face(name="sliver", origin_m=np.zeros(3), edge_u_m=x, edge_v_m=0 * y, rows=1, columns=1, first_patch=0)
    with pytest.raises(SimulationError, match="at least 1 x 1"):
        Face(name="empty", origin_m=np.zeros(3), edge_u_m=x, edge_v_m=y, rows=0, columns=1, first_patch=0)


def test_a_scene_whose_faces_do_not_follow_each_other_is_refused():
    face = Face(
        name="floor",
        origin_m=np.zeros(3),
        edge_u_m=np.array([1.0, 0, 0]),
        edge_v_m=np.array([0, 1.0, 0]),
        rows=1,
        columns=1,
        first_patch=3,
    )
    with pytest.raises(SimulationError, match="first patch 3, expected 0"):
        Scene("gap", (face,), np.array([0.5]), True)
