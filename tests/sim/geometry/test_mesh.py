"""Meshes: what is found out about them, and what is refused by name."""

import numpy as np
import pytest

from sim.errors import SimulationError
from sim.geometry.checks import mesh_faults
from sim.geometry.mesh import Mesh
from sim.geometry.quads import quads_from_triangles
from sim.scenes.gridded import LIBRARY, corner, paper_room, room, room_with_box

SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
CUBE = np.array([[x, y, z] for z in (0.0, 1) for y in (0.0, 1) for x in (0.0, 1)])
INWARDS = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 2, 6, 4], [1, 5, 7, 3], [0, 4, 5, 1], [2, 3, 7, 6]])


def moved(polygon, x, y, z):
    return polygon + np.array([x, y, z])


SHELF = moved(SQUARE, 0, 0, 2.0)


def kinds(vertices, **options):
    return {problem.kind: problem for problem in mesh_faults(np.asarray(vertices, dtype=float), **options)}


def sphere(n_rings, n_sectors, inwards=True):
    """A ball of radius 1 m: triangles at the poles, flat trapezoids between."""
    polar, around = np.linspace(0, np.pi, n_rings + 1)[1:-1], np.arange(n_sectors) * 2 * np.pi / n_sectors
    ring = np.stack(
        [
            np.sin(polar)[:, None] * np.cos(around),
            np.sin(polar)[:, None] * np.sin(around),
            np.cos(polar)[:, None] + 0 * around,
        ],
        axis=2,
    )
    points = np.concatenate([ring.reshape(-1, 3), [[0, 0, 1.0], [0, 0, -1.0]]])
    top, bottom = len(points) - 2, len(points) - 1
    polygons = []
    for k in range(n_sectors):
        after, last = (k + 1) % n_sectors, (n_rings - 2) * n_sectors
        polygons += [[top, after, k], [bottom, last + k, last + after]]
        for row in range(n_rings - 2):
            a, b = row * n_sectors, (row + 1) * n_sectors
            polygons.append([a + k, a + after, b + after, b + k])
    return points, polygons if inwards else [p[::-1] for p in polygons]


def test_a_cube_seen_from_inside_is_closed_convex_and_has_six_regions():
    mesh = Mesh.from_arrays("cube", CUBE, INWARDS, 0.5)
    assert mesh.closed
    assert mesh.convex
    assert len(np.unique(mesh.region)) == 6
    assert len(mesh.occluders) == 0
    assert np.allclose(mesh.areas, 1)
    assert ((0.5 - mesh.centres) * mesh.normals).sum(axis=1) == pytest.approx(0.5)


def test_a_cube_seen_from_outside_is_neither_and_hides_what_is_behind_it():
    mesh = Mesh.from_arrays("block", CUBE, INWARDS[:, ::-1], 0.5)
    assert not mesh.closed
    assert not mesh.convex
    assert len(mesh.occluders) == 6


def test_triangles_quads_and_padded_rows_give_the_same_mesh():
    mixed = Mesh.from_arrays("mixed", CUBE, [*INWARDS[:5].tolist(), [2, 3, 7], [2, 7, 6]], 0.5)
    padded = np.array([*INWARDS[:5].tolist(), [2, 3, 7, -1], [2, 7, 6, -1]])
    assert np.array_equal(Mesh.from_arrays("padded", CUBE, padded, 0.5).vertices, mixed.vertices)
    assert mixed.closed
    assert mixed.areas[5:].tolist() == [0.5, 0.5]
    assert np.allclose(mixed.centres[5], CUBE[[2, 3, 7]].mean(axis=0))
    assert mixed.region[5] == mixed.region[6]


@pytest.mark.parametrize("inwards", [True, False])
def test_only_the_inside_of_a_ball_is_convex_and_closed(inwards):
    mesh = Mesh.from_arrays("ball", *sphere(8, 16, inwards), 0.5)
    assert mesh.convex == inwards
    assert mesh.closed == inwards


def test_a_large_ball_is_convex_until_a_corner_is_pushed_in():
    points, polygons = sphere(80, 120)
    mesh = Mesh.from_arrays("ball", points, polygons, 0.5)
    assert mesh.convex
    triangles = [t for q in polygons for t in ([q[:3], [q[0], *q[2:]]] if len(q) == 4 else [q])]
    pushed = points.copy()
    pushed[4000] *= 0.99
    dented = Mesh.from_arrays("dented", pushed, triangles, 0.5)
    assert not dented.convex
    assert dented.closed
    assert 0 < len(dented.occluders) < 300


def test_a_scene_and_its_mesh_agree():
    scene = room_with_box(patch_size_m=0.4)
    mesh = Mesh.from_arrays("same", scene.vertices.reshape(-1, 3), np.arange(4 * scene.n_patches).reshape(-1, 4), 0.7)
    assert np.allclose(mesh.areas, scene.areas)
    assert np.allclose(mesh.normals, scene.normals)
    assert np.allclose(mesh.centres, scene.centres)
    assert not mesh.convex
    assert mesh.closed == scene.closed
    assert np.array_equal(np.unique(mesh.region), np.unique(scene.region))
    assert all(len(np.unique(mesh.region[scene.region == face])) == 1 for face in np.unique(scene.region))


def test_occluders_that_are_rectangles_are_merged_and_cover_the_same_area():
    scene = room_with_box(patch_size_m=0.4)
    mesh = Mesh(name="box", vertices=scene.vertices, reflectance=scene.reflectance)
    assert len(mesh.occluders) == len(scene.occluders) == 5
    both = [np.sort(np.round(surface.occluders.mean(axis=1), 9), axis=0) for surface in (mesh, scene)]
    assert np.allclose(*both)


def test_regions_of_triangles_are_merged_or_left_but_never_changed_in_area():
    wall = np.array([[0, 1, 2, 2], [0, 2, 3, 3]])
    for shift in range(4):
        triangles = np.roll(SQUARE, shift, axis=0)[wall]
        for turned in (triangles, triangles[:, [1, 2, 0, 0]], triangles[:, [2, 0, 1, 1]]):
            behind = moved(SQUARE[::-1], 0, 0, -1.0)[None]
            occluders = Mesh(
                name="wall", vertices=np.concatenate([turned, behind]), reflectance=np.full(3, 0.5)
            ).occluders
            diagonals = np.cross(occluders[:, 2] - occluders[:, 0], occluders[:, 3] - occluders[:, 1])
            assert np.linalg.norm(diagonals, axis=1).sum() / 2 == pytest.approx(2)


def test_an_l_shaped_wall_stays_in_its_patches():
    shape = np.concatenate([SQUARE, moved(SQUARE, 1, 0, 0), moved(SQUARE, 0, 1, 0)])
    behind = SQUARE[::-1] - (0, 0, 1)
    mesh = Mesh(name="l", vertices=np.concatenate([shape, behind]).reshape(-1, 4, 3), reflectance=np.full(4, 0.5))
    assert len(np.unique(mesh.region)) == 2
    assert len(mesh.occluders) == 4


def test_patches_of_unequal_size_may_meet_and_still_close_a_room():
    coarse, fine = room((2, 2, 2), 1.0), room((2, 2, 2), 0.25)
    floor = fine.vertices[fine.faces[0].patches]
    vertices = np.concatenate([floor, coarse.vertices[coarse.faces[0].n_patches :]])
    mesh = Mesh.from_arrays("mixed", vertices.reshape(-1, 3), np.arange(4 * len(vertices)).reshape(-1, 4), 0.5)
    assert mesh.closed
    assert mesh.convex
    assert len(np.unique(mesh.region)) == 6
    notes = mesh_faults(mesh, thorough=True)
    assert [note.kind for note in notes] == ["t-junction"]
    assert not notes[0].refused


def test_one_missing_patch_opens_a_room_and_its_neighbours_are_named():
    scene = paper_room()
    with pytest.raises(SimulationError, match=r"open: 4 patches: 0 at .*11 at .*287 at .*442 at .*closed=False"):
        Mesh(name="hole", vertices=scene.vertices[1:], reflectance=scene.reflectance[1:], closed=True)
    assert not Mesh.from_arrays("hole", scene.vertices[1:].reshape(-1, 3), np.arange(2300).reshape(-1, 4), 0.5).closed


def test_a_room_lit_from_outside_is_not_closed():
    with pytest.raises(SimulationError, match=r"inverted: 576 patches.*lit from outside"):
        Mesh(name="inside out", vertices=paper_room().vertices[:, ::-1], reflectance=np.full(576, 0.5), closed=True)


def test_a_mesh_called_convex_must_be():
    scene = room_with_box(patch_size_m=0.8)
    with pytest.raises(SimulationError, match=r"not convex: .* patches"):
        Mesh(name="box", vertices=scene.vertices, reflectance=scene.reflectance, convex=True)


def fault(vertices):
    return np.stack([SQUARE, moved(SQUARE, 1, 0, 0), vertices])


BAD = {
    "not finite": moved(SHELF, 0, np.nan, 0),
    "degenerate": SHELF[[0, 1, 1, 2]],
    "self-intersecting": SHELF[[0, 2, 1, 3]],
    "non-convex": np.array([[0, 0, 2], [1, 0, 2], [0.2, 0.2, 2], [0, 1, 2]]),
    "non-planar": SHELF + np.outer([0, 0, 0, 1], [0, 0, 1e-3]),
    "duplicate": SQUARE[[2, 3, 0, 1]],
    "inverted": (moved(SQUARE, 0, 1, 0))[::-1],
}


@pytest.mark.parametrize("kind", BAD)
def test_bad_patches_are_refused_by_kind_and_number(kind):
    vertices = fault(BAD[kind])
    found = kinds(vertices)
    assert set(found) == {kind}
    assert 2 in found[kind].patches
    assert found[kind].refused
    with pytest.raises(SimulationError, match=rf"mesh bad: bad geometry\n  {kind}: .*2 "):
        Mesh(name="bad", vertices=vertices, reflectance=np.full(3, 0.5))


@pytest.mark.parametrize(
    "patch",
    [
        SHELF[[0, 0, 0, 0]],
        SHELF[[0, 1, 0, 1]],
        SHELF[[0, 1, 2, 0]],
        SHELF[0] + np.outer([0, 1, 2, 3], [1.0, 0, 0]),
        SHELF[0] + np.outer([0, 1, 2, 2], [1.0, 0, 0]),
    ],
    ids=["point", "there and back", "triangle closed by its first corner", "line", "flat triangle"],
)
def test_patches_without_area_are_degenerate(patch):
    assert set(kinds(fault(patch))) == {"degenerate"}


def test_a_symmetric_bow_tie_is_one_although_its_area_vector_is_nothing():
    assert set(kinds(fault(SHELF[[0, 1, 3, 2]]))) == {"self-intersecting"}


def test_the_limit_of_flatness_is_said_with_the_figure():
    bent = kinds(fault(SHELF + np.outer([0, 0, 0, 1], [0, 0, 1e-3])))["non-planar"]
    assert "0.25 mm off its plane, limit 0.0014 mm" in bent.message
    assert kinds(fault(SHELF + np.outer([0, 0, 0, 1], [0, 0, 1e-6]))) == {}


def test_slivers_of_one_to_a_million_are_patches():
    assert kinds(fault(SHELF * (1, 1e-6, 1))) == {}


@pytest.mark.parametrize(("factor", "guess"), [(1000, "millimetres taken for metres"), (0.0001, "metres taken for")])
def test_a_wrong_unit_is_guessed(factor, guess):
    found = kinds(paper_room().vertices * factor)
    assert set(found) == {"scale"}
    assert guess in found["scale"].message


def test_the_one_inverted_patch_of_a_room_is_named_not_its_neighbours():
    vertices = paper_room().vertices.copy()
    vertices[[17, 300]] = vertices[[17, 300]][:, ::-1]
    assert kinds(vertices)["inverted"].patches == (17, 300)


def test_all_faults_are_told_together_and_ten_of_each_are_named():
    vertices = paper_room().vertices.copy()
    vertices[5, 0] = np.inf
    vertices[20:40, 2] = vertices[20:40, 1]
    with pytest.raises(SimulationError) as refusal:
        Mesh(name="bad", vertices=vertices, reflectance=np.full(576, 0.5))
    lines = str(refusal.value).splitlines()
    assert lines[1].startswith("  not finite: 1 patch: 5 at")
    assert lines[2].startswith("  degenerate: 20 patches: 20 at")
    assert "29 at" in lines[2]
    assert "30 at" not in lines[2]
    assert "and 10 more" in lines[2]


PARTITION = np.array([[0.5, 0.2, -0.5], [0.5, 0.8, -0.5], [0.5, 0.8, 0.5], [0.5, 0.2, 0.5]])


@pytest.mark.parametrize(
    ("patch", "kind"),
    [
        (PARTITION, "intersecting"),
        (moved(PARTITION, 0, 0.5, 0), "intersecting"),
        (moved(PARTITION, 0, 0, 0.5), None),
        ((moved(PARTITION, 0.5, 0, 0.5))[::-1], None),
        (moved(PARTITION, 0, 1.0, 0), None),
        (moved(SQUARE, 0.5, 0.3, 0), "overlapping"),
        (SQUARE / 2 + (0.2, 0.2, 0), "overlapping"),
        ((SQUARE / 2 + (0.2, 0.2, 0))[::-1], "contact"),
        (moved(SQUARE, 1, 0.5, 0), None),
        (moved(SQUARE, 0.5, 0.5, 1e-5), None),
        (SQUARE[[0, 1, 2, 2]] / 4 + (0.7, 0.1, 0), "overlapping"),
        (SQUARE[[0, 1, 2, 2]] + (1, 1, 0), None),
    ],
    ids=[
        "through", "through the rim", "stands on it", "stands on its edge", "beside", "half over", "within",
        "back to back", "along an edge", "just above", "triangle within", "at a corner",
    ],
)  # fmt: skip
def test_patches_that_cross_are_told_from_those_that_touch(patch, kind):
    found = kinds(np.stack([SQUARE, patch]), thorough=True)
    assert set(found) - {"t-junction"} == ({kind} if kind else set())
    if kind:
        assert found[kind].patches == (0, 1)
        assert found[kind].refused == (kind != "contact")


def test_small_patches_that_pierce_a_large_one_are_all_found():
    rng = np.random.default_rng(0)
    place = np.append(rng.uniform(0.5, 9, (40, 2)), np.linspace(-0.1, 0.1, 40)[:, None], axis=1)
    small = PARTITION * 0.1 + place[:, None]
    found = kinds(np.concatenate([(SQUARE * 10)[None], small]), thorough=True)["intersecting"]
    through = np.flatnonzero(np.abs(place[:, 2]) < 0.05) + 1
    pairs_with_floor = [p for p in found.patches if p]
    assert set(through) <= set(pairs_with_floor)


@pytest.mark.parametrize("name", LIBRARY)
def test_the_library_scenes_have_no_fault(name):
    assert mesh_faults(LIBRARY[name](0.4), thorough=True) == ()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((CUBE, [[0, 1]], 0.5), r"patch 0 has 2 corners"),
        ((CUBE, [[0, 1, 2], [0, 1, 3, 2, 4]], 0.5), r"patch 1 has 5 corners"),
        ((CUBE, [[0, 1, 8]], 0.5), r"patch 0 has corners \[0, 1, 8, 8\], there are 0 \.\.\. 7"),
        ((CUBE, np.array([[0, -1, 2, 3]]), 0.5), r"patch 0 has corners"),
        ((CUBE, np.zeros((1, 5), dtype=int), 0.5), r"shape \(1, 5\)"),
        ((CUBE, np.zeros((1, 4)), 0.5), r"type float64"),
        ((CUBE[:, :2], INWARDS, 0.5), r"expected \(V, 3\)"),
        ((CUBE, INWARDS[:0], 0.5), r"P > 0"),
        ((CUBE, INWARDS, 1.5), r"must lie in 0 \.\.\. 1"),
        ((CUBE, INWARDS, [0.5, np.nan, 0.5, 0.5, 0.5, 0.5]), r"must lie in 0 \.\.\. 1"),
        ((CUBE, INWARDS, [0.5, 0.5]), r"shape \(2,\) for 6 patches"),
    ],
)
def test_arrays_that_are_no_mesh_are_refused(arguments, message):
    with pytest.raises(SimulationError, match=message):
        Mesh.from_arrays("wrong", *arguments)


def test_another_reflectance_shares_the_geometry():
    mesh = Mesh.from_arrays("cube", CUBE, INWARDS, 0.5)
    other = mesh.with_reflectance(0.25)
    assert other.vertices is mesh.vertices
    assert other.closed
    assert other.reflectance.tolist() == [0.25] * 6
    assert mesh.reflectance.tolist() == [0.5] * 6
    with pytest.raises(SimulationError, match=r"0 \.\.\. 1"):
        mesh.with_reflectance(-0.1)


def test_given_regions_do_not_spare_the_checks():
    with pytest.raises(SimulationError, match="degenerate"):
        Mesh(name="bad", vertices=fault(BAD["degenerate"]), reflectance=np.full(3, 0.5), region=np.arange(3))


def test_regions_may_be_given():
    mesh = Mesh.from_arrays("cube", CUBE, INWARDS, 0.5, region=np.arange(6)[::-1])
    assert mesh.region.tolist() == [5, 4, 3, 2, 1, 0]
    with pytest.raises(SimulationError, match=r"region of shape \(2,\)"):
        Mesh.from_arrays("cube", CUBE, INWARDS, 0.5, region=[0, 1])


def test_an_open_corner_is_convex_but_not_closed():
    scene = corner()
    mesh = Mesh.from_arrays("corner", scene.vertices.reshape(-1, 3), np.arange(4 * scene.n_patches).reshape(-1, 4), 0.7)
    assert mesh.convex
    assert not mesh.closed


def test_split_squares_are_joined_again():
    scene = room((1.2, 1.0, 0.8), 0.2)
    corners = np.arange(4 * scene.n_patches).reshape(-1, 4)
    triangles = np.concatenate([corners[:, [0, 1, 2]], corners[:, [2, 3, 0]]])
    polygons, first = quads_from_triangles(scene.vertices.reshape(-1, 3), triangles, np.zeros(len(triangles)))
    assert len(polygons) == scene.n_patches
    assert np.array_equal(first, np.arange(scene.n_patches))
    mesh = Mesh.from_arrays("joined", scene.vertices.reshape(-1, 3), polygons, 0.5)
    assert np.allclose(mesh.centres, scene.centres)
    assert mesh.closed


def test_triangles_of_two_groups_or_two_planes_stay_apart():
    fold = np.concatenate([SQUARE, [[1, 1, 1.0]]])
    for points, triangles, group in (
        (SQUARE, [[0, 1, 2], [0, 2, 3]], [0, 1]),
        (fold, [[0, 1, 2], [0, 4, 3]], [0, 0]),
        (fold, [[0, 1, 4], [0, 4, 3]], [0, 0]),
        (np.array([[0, 0, 0], [1, 0, 0], [0.2, 0.2, 0], [0, 1.0, 0]]), [[0, 1, 2], [0, 2, 3]], [0, 0]),
    ):
        polygons, _ = quads_from_triangles(points, np.array(triangles), group)
        assert (polygons[:, 3] == -1).all()
        assert len(polygons) == 2
