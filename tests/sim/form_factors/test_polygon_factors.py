"""Form factors of any flat polygons against closed forms, plain quadrature, and what must be conserved."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sim import _kernel
from sim.errors import SimulationError
from sim.form_factors.polygon import (
    TOLERANCE_OF_SAMPLES,
    exchange_areas,
    exchange_areas_of_pairs,
)
from sim.geometry.mesh import Mesh
from sim.geometry.scene import Face, Scene
from sim.reference import closed_form
from sim.reference.polygon import exchange_area as exchange_area_reference
from sim.reference.polygon import point_to_polygon
from sim.scenes.gridded import furnace, paper_room
from sim.scenes.meshes import grid_of_quad, integrating_sphere, sloped_room
from tests.sim.plates import wedge

TURN = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()


def mesh_of(*polygons, turn=TURN):
    corners = [np.asarray(polygon, dtype=float) for polygon in polygons]
    quads = [np.concatenate([p, p[-1:]]) if len(p) == 3 else p for p in corners]
    return Mesh(name="polygons", vertices=np.array(quads) @ turn.T, reflectance=np.zeros(len(quads)))


def exchange_area(first, second, tolerance=1e-9):
    return exchange_areas(mesh_of(first, second), tolerance=tolerance)[0, 1]


def rectangle(origin, u, v):
    origin, u, v = (np.array(vector, dtype=float) for vector in (origin, u, v))
    return np.array([origin, origin + u, origin + u + v, origin + v])


def closed_exchange_area(first, second):
    faces = [
        Face(name=str(k), origin_m=r[0], edge_u_m=r[1] - r[0], edge_v_m=r[3] - r[0], rows=1, columns=1, first_patch=k)
        for k, r in enumerate((first, second))
    ]
    return closed_form.exchange_areas(Scene("pair", tuple(faces), np.zeros(2), convex=True))[0, 1]


def turned_paper_room():
    scene = paper_room()
    return Mesh(
        name="turned", vertices=scene.vertices @ TURN.T, reflectance=scene.reflectance
    ), closed_form.exchange_areas(scene)


def relative_errors(found, exact):
    seen = exact > 0
    assert (found[~seen] == 0).all()
    return np.abs(found[seen] / exact[seen] - 1)


def test_the_turned_unit_cube_has_its_known_factors():
    cube = Mesh(name="cube", vertices=furnace(patch_size_m=1.0).vertices @ TURN.T, reflectance=np.zeros(6))
    factors = exchange_areas(cube, tolerance=1e-11)
    assert factors[0, 1] == pytest.approx(0.199824895698, abs=1e-12)
    assert np.allclose(factors[0, 2:], 0.200043776075, atol=1e-12, rtol=0)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-6, 1e-8])
def test_every_pair_of_a_turned_room_is_within_the_tolerance(tolerance):
    mesh, exact = turned_paper_room()
    # The closed form itself is known to some 1e-9.
    assert relative_errors(exchange_areas(mesh, tolerance=tolerance), exact).max() < tolerance + 4e-9


@pytest.mark.parametrize(("samples", "bar"), [(9, 2e-4), (25, 1e-6)])
def test_samples_reach_their_bar_under_a_sloped_ceiling(samples, bar):
    room = sloped_room(rotation=TURN)
    assert room.n_patches == 576
    found = exchange_areas(room, samples=samples)
    assert relative_errors(found, exchange_areas(room, tolerance=1e-11)).max() < bar
    rng = np.random.default_rng(2)
    first, second = np.nonzero(np.triu(found))
    for k in rng.choice(len(first), 60, replace=False):
        a, b = room.vertices[[first[k], second[k]]]
        assert found[first[k], second[k]] == pytest.approx(exchange_area_reference(a, b, 8), rel=bar)


@pytest.mark.parametrize("tolerance", [1e-4, 1e-9])
def test_row_sums_of_a_closed_sloped_room_are_one(tolerance):
    room = sloped_room(rotation=TURN)
    sums = exchange_areas(room, tolerance=tolerance).sum(axis=1) / room.areas
    assert np.abs(sums - 1).max() < tolerance / 10


def test_row_sums_inside_a_sphere_are_one_and_factors_tend_to_the_share_of_the_area():
    excess = []
    for subdivisions in (1, 2):
        sphere = integrating_sphere(subdivisions)
        factors = exchange_areas(sphere, tolerance=1e-8) / sphere.areas[:, None]
        assert np.abs(factors.sum(axis=1) - 1).max() < 1e-10
        far = sphere.centres @ sphere.centres.T < 0.5
        excess.append(float((factors / (sphere.areas / sphere.areas.sum()))[far].mean() - 1))
    # A sphere's factors are A_j / (4 pi R^2); flat triangles come near with the square of their size.
    assert excess[1] == pytest.approx(excess[0] / 4, rel=0.1)


@pytest.mark.parametrize("gap_m", [1e-6, 1e-5, 1e-4, 1e-3, 1e-2])
@pytest.mark.parametrize("shift_m", [0.0, 0.3])
def test_plates_almost_in_touch(gap_m, shift_m):
    below, above = rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0)), rectangle((shift_m, 0, gap_m), (0, 1, 0), (1, 0, 0))
    assert exchange_area(below, above) == pytest.approx(closed_exchange_area(below, above), rel=1e-9)


@pytest.mark.parametrize("gap_m", [1e-6, 1e-4, 1e-2])
def test_plates_turned_against_each_other_lose_only_what_the_rim_lets_out(gap_m):
    below = rectangle((-0.5, -0.5, 0), (1, 0, 0), (0, 1, 0))
    turn = Rotation.from_euler("z", 45, degrees=True).as_matrix()
    above = rectangle((-0.5, -0.5, gap_m), (0, 1, 0), (1, 0, 0)) @ turn.T
    octagon = 2 * (np.sqrt(2) - 1)
    rim = 8 * (np.sqrt(2) - 1) * gap_m
    assert abs(exchange_area(below, above) - octagon) < rim
    quarters = exchange_areas(mesh_of(below, *grid_of_quad(above, 2, 2)), tolerance=1e-9)[0, 1:]
    assert quarters.sum() == pytest.approx(exchange_area(below, above), rel=2e-9)


@pytest.mark.parametrize("size_m", [1e-3, 1e-2])
@pytest.mark.parametrize(
    "small",
    [
        lambda s: rectangle((0.5, 0.5, 0.1 * s), (0, s, 0), (s, 0, 0)),
        lambda s: rectangle((0.5, 0.5, 1.0), (0, s, 0), (s, 0, 0)),
        lambda s: rectangle((0, 0, 0), (0, s, 0), (0, 0, s)),
        lambda s: rectangle((0, 0.3, 0), (0, s, 0), (0, 0, s)),
        lambda s: rectangle((0, 0, 0), (0, 1, 0), (0, 0, s)),
        lambda s: rectangle((0, 0.2, s), (0, s, 0), (0, 0, 1)),
    ],
    ids=["close above", "far above", "in the corner", "on an edge", "sliver on an edge", "upright sliver"],
)
def test_small_patches_and_slivers_by_a_large_one(size_m, small):
    floor, other = rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0)), small(size_m)
    assert exchange_area(floor, other) == pytest.approx(closed_exchange_area(floor, other), rel=1e-9)


@pytest.mark.parametrize("angle_degrees", [1, 5, 30, 90, 150, 175, 179])
class TestWedges:
    def test_a_closed_prism_loses_no_light(self, angle_degrees):
        a, b = wedge(angle_degrees).vertices
        lid = np.array([a[2], a[3], b[2], b[3]])
        left, right = np.array([a[0], b[2], a[3]]), np.array([a[1], a[2], b[3]])
        lid, left, right = (_towards(polygon, a.mean(axis=0) + b.mean(axis=0)) for polygon in (lid, left, right))
        prism = mesh_of(*(a, b, lid, left, right))
        sums = exchange_areas(prism, tolerance=1e-10).sum(axis=1) / prism.areas
        assert np.abs(sums - 1).max() < 1e-10

    def test_parts_add_up_to_the_whole(self, angle_degrees):
        a, b = wedge(angle_degrees).vertices
        parts = exchange_areas(mesh_of(a, *grid_of_quad(b, 3, 2)), tolerance=1e-10)[0, 1:]
        assert parts.sum() == pytest.approx(exchange_area(a, b), rel=1e-9)

    def test_a_long_one_follows_the_textbook(self, angle_degrees):
        long = wedge(angle_degrees, length_m=1000.0)
        # Incropera's table 13.1: two infinitely long plates of one width.
        textbook = 1 - np.sin(np.radians(angle_degrees) / 2)
        assert exchange_areas(long)[0, 1] / 1000 == pytest.approx(textbook, rel=1e-3)

    def test_plain_quadrature_agrees(self, angle_degrees):
        a, b = wedge(angle_degrees, widths_m=(0.7, 1.3)).vertices
        assert exchange_area(a, b) == pytest.approx(exchange_area_reference(a, b, 40), rel=1e-5)


def _towards(polygon, point):
    normal = np.cross(polygon[1] - polygon[0], polygon[2] - polygon[0])
    return polygon if normal @ (point / 2 - polygon[0]) > 0 else polygon[::-1]


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), distance=st.floats(0.0, 8.0), tolerance=st.sampled_from([1e-3, 1e-5, 1e-8]))
def test_any_two_triangles_agree_with_plain_quadrature(seed, distance, tolerance):
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(2, 3, 3))
    b += distance * np.array([0.6, 0.0, 0.8])
    found = exchange_area(a, b, tolerance)
    plain = [exchange_area_reference(*pair, order) for order in (24, 32) for pair in ((a, b), (b, a))]
    assert found == pytest.approx(plain[-1], rel=tolerance, abs=2 * np.ptp(plain) + 1e-15)


def test_gauss_points_keep_the_error_that_their_bound_promises():
    rng = np.random.default_rng(4)
    turns = Rotation.random(200, random_state=rng).as_matrix()
    quad = np.array([[-1, -0.6, 0], [1, -0.5, 0], [0.7, 0.6, 0], [-0.9, 0.4, 0]])
    away = rng.normal(size=(100, 3))
    away *= (np.exp(rng.uniform(0.8, 3.5, 100)) / np.linalg.norm(away, axis=1))[:, None]
    polygons = quad @ turns.transpose(0, 2, 1)
    polygons[100:] += away[:, None]
    mesh, first, second = mesh_of(*polygons), np.arange(100), np.arange(100, 200)
    exact = np.array([exchange_area_reference(polygons[k], polygons[100 + k], 20) for k in range(100)])
    whole = exact > 0
    for tolerance in (1e-2, 1e-4, 1e-6, 1e-8):
        found = exchange_areas_of_pairs(mesh, first, second, tolerance)
        assert np.allclose(found[whole], exact[whole], rtol=tolerance, atol=1e-12)


def test_patches_behind_in_one_plane_or_turned_away_get_nothing():
    floor = rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0))
    beside = rectangle((1, 0, 0), (1, 0, 0), (0, 1, 0))
    away = rectangle((0, 0, 1), (1, 0, 0), (0, 1, 0))
    behind = rectangle((0, 0, -1), (1, 0, 0), (0, 1, 0))
    assert (exchange_areas(mesh_of(floor, beside, away, behind)) == 0).all()


def test_a_patch_cut_by_the_others_plane_counts_with_its_part_above():
    floor = rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0))
    upper, through = (rectangle((0, 0, low), (0, 1, 0), (0, 0, 1 - low)) for low in (0, -1))
    assert exchange_area(floor, through) == pytest.approx(closed_exchange_area(floor, upper), rel=1e-9)


def test_exchange_areas_are_symmetric_and_never_above_the_smaller_area():
    rng = np.random.default_rng(7)
    triangles = rng.normal(size=(60, 3, 3)) * np.exp(rng.normal(size=(60, 1, 1)))
    mesh = mesh_of(*triangles)
    exchange = exchange_areas(mesh)
    assert (exchange == exchange.T).all()
    assert (exchange >= 0).all()
    assert (exchange <= np.minimum.outer(mesh.areas, mesh.areas)).all()


def test_listed_pairs_have_the_bits_of_the_matrix_in_either_order():
    room = sloped_room(patch_size_m=0.8)
    rng = np.random.default_rng(3)
    first, second = rng.integers(0, room.n_patches, (2, 3000))
    matrix = exchange_areas(room, tolerance=1e-5)
    assert (exchange_areas_of_pairs(room, first, second, 1e-5) == matrix[first, second]).all()
    assert exchange_areas_of_pairs(room, [], [], 1e-5).shape == (0,)


def test_threads_and_instruction_sets_give_the_same_bits():
    room = sloped_room(patch_size_m=0.8)
    exact = exchange_areas(room)
    best, threads = _kernel.best_instruction_set(), _kernel.threads()
    try:
        _kernel.set_threads(1)
        assert (exchange_areas(room) == exact).all()
        for level in _kernel.instruction_sets():
            _kernel.set_instruction_set(level)
            assert (exchange_areas(room) == exact).all()
    finally:
        _kernel.set_instruction_set(best)
        _kernel.set_threads(threads)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), size=st.sampled_from([0.1, 1.0, 50.0]), offset=st.sampled_from([0.0, 100.0]))
def test_factors_know_neither_unit_nor_place(seed, size, offset):
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(2, 3, 3))
    moved = exchange_area(size * (a + offset), size * (b + offset), 1e-6) / size**2
    assert moved == pytest.approx(exchange_area(a, b, 1e-6), rel=1e-5, abs=1e-9)


def test_the_factor_to_half_the_sky_is_half_and_to_all_of_it_one():
    far = 1e6 * rectangle((-1, -1, 0), (0, 2, 0), (2, 0, 0)) + (0, 0, 1)
    point, up = np.zeros((1, 3)), np.array([[0.0, 0, 1]])
    assert point_to_polygon(point, up, far) == pytest.approx(1, abs=1e-5)
    tilted = np.array([[1.0, 0, 0]])
    assert point_to_polygon(point, tilted, far) == pytest.approx(0.5, abs=1e-5)


@pytest.mark.parametrize("samples", [0, -9, 8, 49])
def test_samples_without_a_tolerance_are_refused(samples):
    with pytest.raises(SimulationError, match=", ".join(map(str, TOLERANCE_OF_SAMPLES))):
        exchange_areas(sloped_room(2.4), samples=samples)


@pytest.mark.parametrize("tolerance", [0.0, -1e-6, 1e-15, 0.5, np.nan])
def test_tolerances_out_of_reach_are_refused(tolerance):
    with pytest.raises(SimulationError, match="tolerance"):
        exchange_areas(sloped_room(2.4), tolerance=tolerance)


def test_pairs_that_are_none_are_refused():
    room = sloped_room(2.4)
    with pytest.raises(SimulationError, match="one length"):
        exchange_areas_of_pairs(room, [0, 1], [2])
    for wrong in (-1, room.n_patches):
        with pytest.raises(SimulationError, match=f"0 ... {room.n_patches - 1}"):
            exchange_areas_of_pairs(room, [0], [wrong])


def test_scenes_of_meshes_are_closed_and_look_inwards():
    for mesh in (sloped_room(1.2, rotation=TURN), integrating_sphere(1)):
        assert np.abs((mesh.areas[:, None] * mesh.normals).sum(axis=0)).max() < 1e-12
        inwards = mesh.vertices.reshape(-1, 3).mean(axis=0) - mesh.centres
        assert ((inwards * mesh.normals).sum(axis=1) > 0).all()


def test_scenes_of_meshes_refuse_what_they_cannot_build():
    for build in (
        lambda: sloped_room(0.0),
        lambda: sloped_room(rotation=np.diag([1, 1, -1])),
        lambda: integrating_sphere(-1),
    ):
        with pytest.raises(SimulationError):
            build()


@pytest.mark.parametrize("gap", [1e-5, 1.2e-7, 1e-9])
def test_edges_that_lie_side_by_side_a_rounding_apart_give_what_edges_that_touch_give(gap):
    """A corner of a room moved by the last bit of single precision took a minute and a half."""
    floor = rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0))
    touching = exchange_area(floor, rectangle((0, 0, 0), (0, 0, 1), (1, 0, 0)))
    for lower in ((gap, gap), (0, gap), (-gap / 2, gap / 2)):
        wall = [[0, -gap, lower[0]], [0, -gap, 1], [1, -gap, 1], [1, -gap, lower[1]]]
        assert exchange_area(floor, wall) == pytest.approx(touching, abs=3 * gap)
        assert exchange_area(wall, floor) == pytest.approx(exchange_area(floor, wall), rel=1e-9)
