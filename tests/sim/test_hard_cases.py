"""Numerical stability: every hard case against its exact or bounding answer.

`python benchmarks/hard_cases.py` prints the figures, docs/explanation/hard-cases.md shows them.
"""

import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from calibration.structured_light.correspondence import PixelReason
from calibration.structured_light.decode import decode_gray
from calibration.structured_light.gray import gray_code_patterns
from sim.compensation import STRATEGIES, compensate
from sim.errors import SimulationError
from sim.form_factors import form_factors
from sim.geometry.checks import mesh_faults
from sim.geometry.mesh import Mesh
from sim.geometry.optics import Lens, Pose
from sim.geometry.scene import intersect
from sim.light.radiosity import Radiosity
from sim.light.transport_of_scene import coaxial_transport
from sim.scenes.library import furnace, paper_room, parallel_plates, room
from sim.scenes.meshes import grid_of_quad, integrating_sphere, sloped_room, wedge

ROOT = Path(__file__).parents[2]
SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
FACING = np.array([[0.0, 0, 1], [0, 1, 1], [1, 1, 1], [1, 0, 1]])
"""The square 1 m above, lit side down."""


@pytest.fixture
def measured(record_property):
    """Hold a figure to its limit and keep it for the table."""

    def hold(what, value, limit):
        record_property(what, f"{value:.1e} (limit {limit:.0e})")
        assert value <= limit

    return hold


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


# Reflectance and closure


@pytest.fixture(scope="module")
def closed_room():
    return form_factors(paper_room())


@pytest.mark.parametrize("rho", [0.9, 0.99, 0.999, 0.9999])
def test_a_furnace_is_right_however_close_to_one_its_reflectance(closed_room, measured, rho):
    solution = Radiosity(closed_room, rho, tolerance=1e-13).solution(np.ones(576))
    error = np.abs(solution.B - 1 / (1 - rho)).max()
    measured("relative error of B", error * (1 - rho), 1e-11 / (1 - rho))
    # The bound is for these form factors; what they are off adds closure times rho / (1 - rho).
    assert error <= solution.error_bound + closed_room.closure_max * rho / (1 - rho) ** 2


@pytest.mark.parametrize("rho", [0.5, 0.9, 0.99])
def test_a_closure_defect_is_amplified_as_foretold(closed_room, measured, rho):
    defect = 1e-4
    wrong = replace(closed_room, matrix=closed_room.matrix * (1 + defect), row_sums=closed_room.row_sums * (1 + defect))
    B = Radiosity(wrong, rho).solve(np.ones(576))
    foretold = 1 / (1 - rho * (1 + defect))
    measured("departure from 1 / (1 - rho (1 + defect))", np.abs(B / foretold - 1).max(), 1e-9)


@pytest.mark.filterwarnings("ignore::sim.form_factors.factors.ClosureWarning")
def test_the_papers_quadrature_brightens_a_furnace_within_its_row_sums(measured):
    factors = form_factors(paper_room(), "paper")
    for rho in (0.7, 0.9):
        B = Radiosity(factors, rho).solve(np.ones(576))
        low, high = (1 / (1 - rho * bound) for bound in (factors.row_sums.min(), factors.row_sums.max()))
        assert low <= B.min()
        assert B.max() <= high
    with pytest.raises(SimulationError, match="never fades"):
        Radiosity(factors, 0.985)


def test_reflectance_one_in_a_closed_room_is_refused(closed_room):
    with pytest.raises(SimulationError, match="never fades"):
        Radiosity(closed_room, 1.0)


def test_without_reflectance_radiosity_is_emission(closed_room):
    E = np.random.default_rng(0).random(576)
    assert np.array_equal(Radiosity(closed_room, 0.0).solve(E), E)


# Integrating sphere


def test_the_facets_of_a_sphere_tend_to_its_factors(measured):
    spread = []
    for subdivisions in (1, 2, 3):
        sphere = integrating_sphere(subdivisions)
        factors = form_factors(sphere, "polygon", tolerance=1e-9)
        measured(f"closure, {sphere.n_patches} facets", factors.closure_max, 1e-9)
        apart = np.linalg.norm(sphere.centres[:, None] - sphere.centres, axis=2) > 0.7
        exact = sphere.areas / sphere.areas.sum()
        spread.append(np.abs(factors.matrix / exact - 1)[apart].mean())
        measured(
            f"mean of |F_ij / (A_j / 4 pi R²) - 1|, {sphere.n_patches} facets", spread[-1], 0.04 / 2**subdivisions * 2
        )
    # Facets are not equilateral: their normals are off the centroids' radii by a share of their size.
    assert spread[0] / spread[1] > 1.8
    assert spread[1] / spread[2] > 1.8


def test_the_sphere_itself_is_solved_exactly_for_any_light(measured):
    sphere, rho = integrating_sphere(2), 0.95
    share = sphere.areas / sphere.areas.sum()
    matrix = np.tile(share, (len(share), 1))
    np.fill_diagonal(matrix, 0)
    factors = form_factors(sphere, "polygon")
    exact = replace(factors, matrix=matrix, row_sums=1 - share)
    E = np.random.default_rng(1).random(len(share))
    B = Radiosity(exact, rho, tolerance=1e-14).solve(E)
    # B_i = E_i + rho (M - share_i B_i): flat facets do not see themselves; M is the mean of B.
    loss = share / (1 + rho * share)
    mean = (loss @ E) / (1 - rho * loss.sum())
    measured("relative error of B", np.abs(B * (1 + rho * share) / (E + rho * mean) - 1).max(), 1e-12)


# Pairs of patches


@pytest.mark.parametrize("degrees", [1, 5, 30, 60, 90, 120, 150, 175, 179])
def test_wedges_of_any_angle_agree_with_lambert(measured, degrees):
    mesh = wedge(degrees)
    factor = form_factors(mesh, "polygon", tolerance=1e-10).matrix[0, 1]
    expected = reference_factor(mesh.vertices[0], mesh.vertices[1])
    measured("relative error of F", abs(factor / expected - 1), 1e-8)


@pytest.mark.parametrize("degrees", [1, 10, 45, 90, 135, 170, 179])
def test_long_wedges_tend_to_crossed_strings(measured, degrees):
    # Infinitely long strips: F = 1 - sin(angle / 2). Ends cost less than a width in the length, from above none.
    length = 1000.0
    factor = form_factors(wedge(degrees, length), "polygon", tolerance=1e-10).matrix[0, 1]
    infinite = 1 - np.sin(np.radians(degrees) / 2)
    assert factor < infinite
    measured("1 - F / F infinite", 1 - factor / infinite, 1 / length)


def test_the_axis_parallel_wedge_is_the_same_in_closed_form(measured):
    mesh = wedge(90)
    exact, polygon = (form_factors(mesh, method).matrix[0, 1] for method in ("closed_form", "polygon"))
    assert exact == pytest.approx(0.200043776075, abs=1e-12)
    measured("difference of polygon and closed form", abs(polygon / exact - 1), 1e-6)


def test_patches_that_share_a_vertex_only_agree_with_lambert(measured):
    wall = np.array([[1.0, 1, 0], [1, 2, 0], [1, 2, 1], [1, 1, 1]])[::-1]
    factor = form_factors(pair(SQUARE, wall), "polygon", tolerance=1e-10).matrix[0, 1]
    measured("relative error of F", abs(factor / reference_factor(SQUARE, wall) - 1), 1e-8)


@pytest.mark.parametrize("gap", [1e-6, 1e-5, 1e-4, 1e-3, 1e-2])
@pytest.mark.parametrize("method", ["closed_form", "polygon"])
def test_plates_with_a_gap_of_nearly_nothing_agree_with_the_textbook(measured, method, gap):
    factor = form_factors(parallel_plates((1, 1), gap, 1.0), method, "none").matrix[0, 1]
    measured("error of F", abs(factor - opposed(1 / gap, 1 / gap)), 1e-8 if method == "closed_form" else 1e-6)


@pytest.mark.parametrize("width", [1e-1, 1e-2, 1e-3])
def test_slivers_facing_each_other_agree_with_the_textbook(measured, width):
    first, second = SQUARE * (1, width, 1), FACING * (1, width, 1)
    expected = opposed(1, width)
    for method, limit in (("closed_form", 1e-8), ("polygon", 1e-6)):
        factor = form_factors(pair(first, second), method).matrix[0, 1]
        measured(f"relative error of F, {method}", abs(factor / expected - 1), limit)


def test_slivers_along_a_shared_edge_agree_with_lambert(measured):
    sliver = np.array([[0.0, 0, 0], [0, 1, 0], [0, 1, 1e-3], [0, 0, 1e-3]])
    factors = form_factors(pair(SQUARE, sliver), "polygon", tolerance=1e-9).matrix
    measured("relative error of F", abs(factors[1, 0] / reference_factor(sliver, SQUARE) - 1), 1e-6)


@pytest.mark.parametrize("place", ["opposite", "at the edge"])
def test_patches_a_thousand_times_larger_agree_with_lambert(measured, place):
    small = FACING * 1e-3 if place == "opposite" else SQUARE[:, [2, 0, 1]] * 1e-3
    small = small + (np.array([0.5, 0.5, 0.5]) if place == "opposite" else np.array([0, 0.5, 0]))
    factors = form_factors(pair(SQUARE, small), "polygon", tolerance=1e-9).matrix
    measured("relative error of F small to large", abs(factors[1, 0] / reference_factor(small, SQUARE) - 1), 1e-7)
    assert factors[0, 1] == pytest.approx(1e-6 * factors[1, 0], rel=1e-12)


@pytest.mark.parametrize("method", ["closed_form", "polygon", "paper"])
def test_coplanar_patches_exchange_exactly_nothing(method):
    turn = np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1]])
    floor = grid_of_quad(SQUARE, 4, 4)
    mesh = Mesh(
        name="floor", vertices=floor if method == "closed_form" else floor @ turn.T + 0.1, reflectance=np.full(16, 0.5)
    )
    assert not form_factors(mesh, method).matrix.any()


@pytest.mark.parametrize("method", ["closed_form", "polygon"])
def test_a_patch_cut_by_anothers_horizon_counts_with_its_upper_part(measured, method):
    floor = SQUARE * (0.9, 1, 1)
    wall = np.array([[1.0, 0, -0.5], [1, 0, 0.5], [1, 1, 0.5], [1, 1, -0.5]])
    upper = wall * (1, 1, 0) + np.maximum(wall, 0) * (0, 0, 1)
    cut = form_factors(pair(floor, wall), method, "none", tolerance=1e-9).matrix[0, 1]
    expected = reference_factor(floor, upper)
    measured("relative error of F", abs(cut / expected - 1), 1e-7)


def test_a_patch_wholly_behind_another_gets_exactly_nothing():
    behind = SQUARE + np.array([0, 0, -1.0])
    assert not form_factors(pair(SQUARE, behind), "polygon", "none").matrix.any()


# Rooms and occluders


def room_of_unequal_patches():
    coarse, fine = room((2, 2, 2), 1.0), room((2, 2, 2), 0.25)
    vertices = [fine.vertices[fine.faces[0].patches], coarse.vertices[coarse.faces[0].n_patches :]]
    corners = np.concatenate(vertices)
    return Mesh.from_arrays("unequal", corners.reshape(-1, 3), np.arange(corners.size // 3).reshape(-1, 4), 0.5)


def test_a_room_of_unequal_patches_loses_nothing_at_its_corners(measured):
    measured("closure, patches 1 : 4", form_factors(room_of_unequal_patches()).closure_max, 1e-10)
    measured("closure, polygons", form_factors(room_of_unequal_patches(), "polygon", tolerance=1e-9).closure_max, 1e-8)


def test_a_rotated_room_under_a_sloped_ceiling_keeps_its_light(measured):
    turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    factors = form_factors(sloped_room(0.8, turn * np.linalg.det(turn)), "polygon", tolerance=1e-9)
    measured("closure", factors.closure_max, 1e-8)


def two_rooms():
    """A room parted from wall to wall by a sheet without thickness, both sides lit."""
    scene = room((2, 1, 1), 0.5)
    sheet = np.array([[1.0, 0, 0], [1, 1, 0], [1, 1, 1], [1, 0, 1]])
    vertices = np.concatenate([scene.vertices, [sheet, sheet[::-1]]])
    return Mesh.from_arrays("two rooms", vertices.reshape(-1, 3), np.arange(len(vertices) * 4).reshape(-1, 4), 0.5)


def test_no_light_leaks_past_a_sheet_that_parts_a_room(measured):
    mesh = two_rooms()
    assert [problem.kind for problem in mesh_faults(mesh) if problem.kind != "t-junction"] == ["contact"]
    matrix = form_factors(mesh).matrix
    left = np.where(np.abs(mesh.centres[:, 0] - 1) < 1e-9, mesh.normals[:, 0] < 0, mesh.centres[:, 0] < 1)
    measured("largest factor through the sheet", matrix[left][:, ~left].max(), 1e-15)
    measured("row sums", np.abs(matrix.sum(axis=1) - 1).max(), 1e-5)


def strip_between(low, high):
    """Two plates, and half-way between them a strip from one edge to the other."""
    strip = SQUARE * (high - low, 1, 1) + np.array([low, 0, 0.5])
    return Mesh(name="strip", vertices=np.stack([SQUARE, FACING, strip]), reflectance=np.full(3, 0.5))


def hidden_share(low, high, steps=1000):
    """Share that the strip hides, by Lambert's factor of its shadow on the upper plate at points of the lower."""
    gauss, weights = np.polynomial.legendre.leggauss(20)
    x, y = np.meshgrid((np.arange(steps) + 0.5) / steps, (gauss + 1) / 2, indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    west, east = (np.clip(2 * rim - points[:, 0], 0, 1) for rim in (low, high))
    south, north = np.clip(-points[:, 1], 0, 1), np.clip(2 - points[:, 1], 0, 1)
    corners = [(west, south), (west, north), (east, north), (east, south)]
    shadow = np.stack([np.stack([a, b, np.ones(x.size)], axis=1) for a, b in corners], axis=1)
    factor = lambert(points, np.array([0.0, 0, 1]), shadow).reshape(x.shape)
    return factor.mean(axis=0) @ weights / 2 / opposed(1, 1)


@pytest.mark.parametrize("width", [0.1, 1e-2, 1e-3])
def test_occluders_thinner_than_a_patch_hide_their_share(measured, width):
    rims = [0.0, 0.5 - width / 2, 0.5 + width / 2, 1.0]
    free = form_factors(pair(SQUARE, FACING)).matrix[0, 1]
    hidden = [1 - form_factors(strip_between(*strip)).matrix[0, 1] / free for strip in pairwise(rims)]
    # Strips that tile the plane between the plates hide, one after the other, exactly everything.
    measured("hidden shares of strips that tile the plane, off 1", abs(sum(hidden) - 1), 1e-12)
    expected = hidden_share(rims[1], rims[2])
    measured("relative error of the thin strip's share", abs(hidden[1] / expected - 1), 5e-3)


def test_a_wall_between_two_plates_hides_all():
    mesh = Mesh(
        name="wall",
        vertices=np.stack([SQUARE, FACING, SQUARE * (1.2, 1.2, 1) + (-0.1, -0.1, 0.5)]),
        reflectance=np.full(3, 0.5),
    )
    assert form_factors(mesh).matrix[0, 1] == 0


@pytest.mark.filterwarnings("ignore::sim.form_factors.factors.ClosureWarning")
def test_occluded_factors_lie_between_nothing_and_the_free_ones():
    box = Mesh.from_arrays(
        "block",
        np.array([[x, y, z] for z in (0.4, 0.6) for y in (0.4, 0.6) for x in (0.4, 0.6)]),
        np.array([[0, 2, 3, 1], [4, 5, 7, 6], [0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3]]),
        0.5,
    )
    scene = furnace(0.25)
    mesh = Mesh(
        name="block in room", vertices=np.concatenate([scene.vertices, box.vertices]), reflectance=np.full(102, 0.5)
    )
    free, occluded = (form_factors(mesh, visibility=visibility).matrix for visibility in ("none", "exact"))
    assert (occluded >= 0).all()
    assert (occluded <= free).all()
    exchange = mesh.areas[:, None] * occluded
    assert np.allclose(exchange, exchange.T, rtol=1e-14, atol=0)


# Light and devices


LENS = Lens.from_horizontal_field_of_view(48, 36, 90.0)
POSE = Pose.look_at((1.2, 1.2, 1.2), (4.8, 4.8, 1.0))


def landed(transport, scene):
    """Flux of a white picture on all patches."""
    E, _ = transport.radiosity_of(np.ones(LENS.n_pixels))
    return (scene.areas * E / scene.reflectance).sum()


SENT = LENS.n_pixels / (LENS.focal_px[0] * LENS.focal_px[1])


def test_half_lit_patches_get_the_light_that_lands_on_them(closed_room, measured):
    scene = paper_room()
    by_area = coaxial_transport(scene, closed_room, LENS, POSE, convention="physical", emission_rule="area")
    measured("flux landed over flux sent, off 1", abs(landed(by_area, scene) / SENT - 1), 1e-12)
    by_mean = coaxial_transport(scene, closed_room, LENS, POSE, convention="physical", emission_rule="pixel_mean")
    # Equation 5 takes half-lit patches for lit ones: light is created.
    created = landed(by_mean, scene) / SENT - 1
    measured("light created by equation 5", created, 0.3)
    assert created > 0.02


@pytest.mark.parametrize("height_m", [1e-3, 1e-6])
def test_grazing_light_arrives_complete(closed_room, measured, height_m):
    scene = paper_room()
    pose = Pose.look_at((1.2, 1.3, height_m), (4.8, 3.9, height_m))
    transport = coaxial_transport(scene, closed_room, LENS, pose, convention="physical", emission_rule="area")
    assert np.isfinite(transport.direct_matrix.data).all()
    assert (transport.direct_matrix.data >= 0).all()
    measured("flux landed over flux sent, off 1", abs(landed(transport, scene) / SENT - 1), 1e-12)


def test_a_projector_on_the_floor_lights_what_lies_above_it():
    pose = Pose.look_at((1.2, 1.3, 0.0), (4.8, 3.9, 0.0))
    up = np.random.default_rng(5).normal(size=(1000, 3))
    up[:, 2] = np.abs(up[:, 2])
    above = intersect(paper_room(), pose.position_m, up / np.linalg.norm(up, axis=1, keepdims=True))
    below = intersect(paper_room(), pose.position_m, -up / np.linalg.norm(up, axis=1, keepdims=True))
    assert (above.patch >= 0).all()
    assert (above.face > 0).all()
    assert (below.patch == -1).all()


def test_black_wanted_everywhere_is_black_shown(closed_room):
    transport = coaxial_transport(paper_room(), closed_room, LENS, POSE)
    for name in STRATEGIES:
        result = compensate(name, transport, np.zeros(LENS.n_pixels))
        assert not result.projector_image.any(), name
        assert result.residual_rms == 0, name


def test_black_wanted_in_half_of_the_picture_divides_by_nothing(closed_room):
    # Equation 16 has L'_c / B', nought over nought where black is wanted.
    transport = coaxial_transport(paper_room(), closed_room, LENS, POSE)
    target = np.where(np.arange(LENS.n_pixels) < LENS.n_pixels / 2, 0.0, 0.5)
    for name in STRATEGIES:
        image = compensate(name, transport, target).projector_image
        assert np.isfinite(image).all(), name
        assert ((image >= 0) & (image <= 1)).all(), name


def test_unlit_and_unseen_patches_are_accounted_for(closed_room, measured):
    # A uniform grey that nothing clips: exact with unlit patches solved for, 18 levels of 255 off in the paper.
    transport = coaxial_transport(paper_room(), closed_room, LENS, POSE, emission_rule="area")
    lit = np.asarray(transport.emission.sum(axis=1)).ravel() > 0
    assert 0.1 < lit.mean() < 0.9
    E, B = transport.radiosity_of(np.ones(LENS.n_pixels))
    assert not E[~lit].any()
    assert (B[~lit] > 0).all()
    target = np.full(LENS.n_pixels, 0.5)
    exact = compensate("exact", transport, target, lower=-np.inf, upper=np.inf)
    measured("exact: rms from the target", exact.residual_rms / 0.5, 1e-9)
    paper = compensate("paper", transport, target, lower=-np.inf, upper=np.inf)
    measured("paper: rms from the target", paper.residual_rms / 0.5, 0.5)
    assert paper.residual_rms > 0.02


def gray_code_pictures(ambient):
    """What a camera sees that looks at the projector's pixels one to one, with other light in each picture."""
    patterns = list(gray_code_patterns((48, 64)))
    return {
        pattern.name: 10 + pattern.codes * (100 / 255) + level
        for pattern, level in zip(patterns, ambient(len(patterns)), strict=True)
    }


@pytest.mark.parametrize(
    "ambient",
    [
        lambda n: np.zeros(n),
        lambda n: np.full(n, 140.0),
        lambda n: 30 * np.random.default_rng(8).random(n),
        lambda n: 80.0 * (np.arange(n) % 4 < 2),
    ],
    ids=["dark", "steady", "flickering", "blinking"],
)
def test_gray_code_is_read_in_ambient_light_weaker_than_the_projector(ambient):
    found = decode_gray(gray_code_pictures(ambient), (48, 64), contrast_limit=20, bit_limit=10)
    assert found.valid.mean() > 0.99
    columns = np.tile(np.arange(64.0), (48, 1))
    assert np.array_equal(found.projector_xy_px[..., 0][found.valid], columns[found.valid])


def test_saturated_pixels_get_no_code():
    found = decode_gray(
        gray_code_pictures(lambda n: np.full(n, 160.0)), (48, 64), contrast_limit=20, bit_limit=10, saturation=255
    )
    assert (found.reason == PixelReason.SATURATED).all()


# Precision and size


@pytest.mark.parametrize("rho", [0.7, 0.99, 0.999])
def test_single_precision_is_off_by_no_more_than_its_rounding_amplified(closed_room, measured, rho):
    E = np.random.default_rng(6).random(576)
    double = Radiosity(closed_room, rho).solve(E)
    single = Radiosity(closed_room.in_single_precision(), rho).solve(E)
    measured("relative difference", np.abs(single / double - 1).max(), 2**-24 * (1 + rho / (1 - rho)))
    mixed = Radiosity(closed_room, rho, precision="mixed").solve(E)
    measured("relative difference, refined", np.abs(mixed / double - 1).max(), 1e-10)


@pytest.mark.parametrize("patch_size_m", [0.4, 0.2, 0.1])
def test_finer_patches_keep_closure_and_reciprocity(measured, patch_size_m):
    scene = paper_room(patch_size_m=patch_size_m)
    factors = form_factors(scene)
    measured(f"closure, {scene.n_patches} patches", factors.closure_max, 1e-10)
    some = np.random.default_rng(7).integers(scene.n_patches, size=(2, 10_000))
    there, back = (scene.areas[a] * factors.matrix[a, b] for a, b in (some, some[::-1]))
    assert np.allclose(there, back, rtol=4e-16, atol=0)


# The table


def test_every_test_that_the_table_names_exists():
    page = (ROOT / "docs/explanation/hard-cases.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`(test_\w+)`", page))
    defined = {
        name
        for path in (ROOT / "tests").rglob("test_*.py")
        for name in re.findall(r"^def (test_\w+)", path.read_text(encoding="utf-8"), re.MULTILINE)
    }
    assert named - defined == set()
    here = set(re.findall(r"^def (test_\w+)", Path(__file__).read_text(encoding="utf-8"), re.MULTILINE))
    assert here - named - {"test_every_test_that_the_table_names_exists"} == set()
