"""Form factors against constants, textbook formulae and conservation laws."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.errors import SimulationError
from sim.form_factors import ClosureWarning, form_factors
from sim.geometry.scene import Face, Scene
from sim.scenes.gridded import furnace, paper_room, room, room_with_box
from tests.sim.plates import parallel_plates

UNIT_CUBE_OPPOSITE = 0.199824895698
UNIT_CUBE_ADJACENT = 0.200043776075


def test_the_unit_cube_has_its_known_factors():
    matrix = form_factors(furnace(patch_size_m=1.0)).matrix
    assert matrix[0, 1] == pytest.approx(UNIT_CUBE_OPPOSITE, abs=1e-12)
    assert np.allclose(matrix[0, 2:], UNIT_CUBE_ADJACENT, atol=1e-12, rtol=0)


def test_patches_of_the_unit_cube_add_up_to_its_faces():
    scene = furnace(patch_size_m=0.2)
    factors = form_factors(scene).matrix
    floor, ceiling, wall = (scene.faces[k].patches for k in (0, 1, 2))
    assert factors[floor, ceiling].sum(axis=1).mean() == pytest.approx(UNIT_CUBE_OPPOSITE, abs=1e-11)
    assert factors[floor, wall].sum(axis=1).mean() == pytest.approx(UNIT_CUBE_ADJACENT, abs=1e-11)


@pytest.mark.parametrize(("side_m", "gap_m"), [(1.0, 0.1), (1.0, 1.0), (2.0, 0.7), (0.3, 3.0)])
def test_opposed_squares_agree_with_the_textbook(side_m, gap_m):
    ratio = side_m / gap_m
    root = np.sqrt(1 + ratio**2)
    # Incropera's table 13.2: aligned parallel rectangles, here squares.
    textbook = (2 / (np.pi * ratio**2)) * (
        np.log((1 + ratio**2) / np.sqrt(1 + 2 * ratio**2))
        + 2 * ratio * root * np.arctan(ratio / root)
        - 2 * ratio * np.arctan(ratio)
    )
    plates = parallel_plates((side_m, side_m), gap_m, side_m)
    assert form_factors(plates).matrix[0, 1] == pytest.approx(textbook, rel=1e-10)


def test_far_apart_patches_follow_the_point_formula():
    scene = parallel_plates((0.01, 0.01), 10.0, 0.01)
    assert form_factors(scene).matrix[0, 1] == pytest.approx(1e-4 / (np.pi * 100), rel=1e-5)


def test_two_patches_one_apart_at_an_edge_agree_with_random_sampling():
    scene = room((0.4, 0.8, 0.4), 0.4, faces=("floor", "x0"))
    rng = np.random.default_rng(1)
    floor = scene.vertices[0, 0] + rng.random((400_000, 3)) * (0.4, 0.4, 0)
    wall = scene.vertices[3, 0] + rng.random((400_000, 3)) * (0, 0.4, 0.4)
    line = wall - floor
    squared = (line**2).sum(axis=1)
    estimate = 0.16 * np.mean(line[:, 2] * -line[:, 0] / (np.pi * squared**2))
    assert form_factors(scene).matrix[0, 3] == pytest.approx(estimate, rel=0.02)


@settings(deadline=None, max_examples=15)
@given(st.tuples(*[st.floats(0.5, 3.0)] * 3), st.floats(0.2, 0.6), st.floats(0.05, 0.95))
def test_any_closed_room_keeps_all_its_light_and_reciprocity(size_m, patch_size_m, reflectance):
    scene = room(size_m, patch_size_m, reflectance)
    factors = form_factors(scene)
    exchange = scene.areas[:, None] * factors.matrix
    assert factors.closure_max < 1e-10
    assert np.allclose(exchange, exchange.T, rtol=1e-14, atol=0)
    assert (factors.matrix >= 0).all()


def test_the_paper_room_closes_and_the_papers_quadrature_does_not():
    exact = form_factors(paper_room())
    with pytest.warns(ClosureWarning, match=r"1\.0004 to 1\.0869"):
        quadrature = form_factors(paper_room(), "paper")
    assert exact.closure_max < 1e-10
    assert quadrature.row_sums.min() == pytest.approx(1.0004, abs=5e-5)
    assert quadrature.row_sums.max() == pytest.approx(1.0869, abs=5e-5)
    assert quadrature.spectral_radius == pytest.approx(1.0197, abs=5e-5)
    assert np.abs(np.linalg.eigvals(quadrature.matrix)).max() == pytest.approx(quadrature.spectral_radius, rel=1e-9)


def test_far_pairs_of_the_quadrature_agree_with_the_closed_form():
    scene = paper_room()
    with pytest.warns(ClosureWarning):
        quadrature = form_factors(scene, "paper").matrix
    exact = form_factors(scene).matrix
    distance = np.linalg.norm(scene.centres[:, None] - scene.centres[None], axis=2)
    far = (distance > 2.4) & (exact > 0)
    assert np.abs(quadrature[far] / exact[far] - 1).max() < 0.01


def test_a_turned_room_has_the_same_factors():
    scene = room((2.0, 1.0, 1.5), 0.5)
    angle = 0.4
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    faces = [
        Face(
            name=f.name,
            origin_m=turn @ f.origin_m,
            edge_u_m=turn @ f.edge_u_m,
            edge_v_m=turn @ f.edge_v_m,
            rows=f.rows,
            columns=f.columns,
            first_patch=f.first_patch,
        )
        for f in scene.faces
    ]
    turned = Scene("turned", tuple(faces), scene.reflectance, convex=True)
    assert np.allclose(form_factors(turned).matrix, form_factors(scene).matrix, atol=1e-13)


def test_faces_at_odd_angles_are_refused_by_name():
    floor = Face(
        name="floor",
        origin_m=np.zeros(3),
        edge_u_m=np.array([1.0, 0, 0]),
        edge_v_m=np.array([0, 1.0, 0]),
        rows=1,
        columns=1,
        first_patch=0,
    )
    leaning = Face(
        name="leaning",
        origin_m=np.zeros(3),
        edge_u_m=np.array([0, 1.0, 0]),
        edge_v_m=np.array([0.3, 0, 1.0]),
        rows=1,
        columns=1,
        first_patch=1,
    )
    scene = Scene("wedge", (floor, leaning), np.full(2, 0.5), convex=True)
    with pytest.raises(SimulationError, match=r"floor and leaning .* neither parallel nor perpendicular"):
        form_factors(scene, "closed_form")


def test_an_unknown_method_is_refused_with_the_choices():
    with pytest.raises(SimulationError, match="closed_form, polygon, paper"):
        form_factors(furnace(), "magic")


def test_an_occluder_only_takes_light_away():
    scene = room_with_box(patch_size_m=0.8)
    with pytest.warns(ClosureWarning, match="occluders are left out"):
        free = form_factors(scene, visibility="none").matrix
    occluded = form_factors(scene).matrix
    assert (occluded >= 0).all()
    assert (occluded <= free).all()
    exchange = scene.areas[:, None] * occluded
    assert np.array_equal(exchange > 0, exchange.T > 0)
    assert np.allclose(exchange, exchange.T, rtol=1e-12)


def test_the_room_with_a_box_nearly_closes():
    # Closed but for the floor under the box.
    scene = room_with_box(patch_size_m=0.4)
    sums = form_factors(scene).row_sums
    uncovered = [face.patches for face in scene.faces if face.name != "floor"]
    assert all(np.abs(sums[patches] - 1).max() < 1e-3 for patches in uncovered)


def test_a_wall_between_two_plates_darkens_them():
    plates = parallel_plates((1.0, 1.0), 1.0, 1.0)
    u, v = np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
    shield = Face(
        name="shield", origin_m=np.array([0, 0, 0.5]), edge_u_m=u, edge_v_m=v, rows=1, columns=1, first_patch=2
    )
    scene = Scene("shielded", (*plates.faces, shield), np.full(3, 0.5), convex=False)
    assert form_factors(scene).matrix[0, 1] == 0


def test_a_half_shield_blocks_what_lies_behind_it():
    plates = parallel_plates((1.0, 1.0), 1.0, 1.0)
    half = Face(
        name="half",
        origin_m=np.array([0, 0, 0.5]),
        edge_u_m=np.array([0.5, 0, 0]),
        edge_v_m=np.array([0, 1.0, 0]),
        rows=1,
        columns=1,
        first_patch=2,
    )
    scene = Scene("half shielded", (*plates.faces, half), np.full(3, 0.5), convex=False)
    factors = form_factors(scene, rays_per_pair=4096).matrix
    # Plane symmetry: a segment misses the shield if its middle lies in the free half, and half of them do.
    assert factors[0, 1] / UNIT_CUBE_OPPOSITE == pytest.approx(0.5, abs=0.01)


def test_kept_within_closure_no_row_creates_light_and_light_goes_both_ways_alike():
    scene = room_with_box(patch_size_m=0.8)
    with pytest.warns(ClosureWarning, match="occluders are left out"):
        kept = form_factors(scene, visibility="none", keep_within_closure=True)
    assert kept.closure_max > 0.01
    assert kept.row_sums.max() <= 1 + 1e-12
    assert np.allclose(kept.row_sums, kept.matrix.sum(axis=1), rtol=1e-12)
    exchange = scene.areas[:, None] * kept.matrix
    assert np.allclose(exchange, exchange.T, rtol=1e-12)
