"""Occlusion: exact answers by symmetry and closed form, bounds, and rays that know nothing of clipping."""

import warnings
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim import _kernel
from sim.errors import SimulationError
from sim.form_factors import form_factors
from sim.form_factors.factors import ClosureWarning
from sim.form_factors.occlusion import segments_blocked, visible_fraction, visible_fraction_of_pairs
from sim.form_factors.visibility import visible_fraction_of_pairs_by_rays as visible_by_rays
from sim.geometry.mesh import Mesh
from sim.scenes.gridded import paper_room, room_with_box

BOX = np.array([[1.9, 1.9, 0.0], [2.9, 2.9, 1.0]])


def rectangle(x, y, z, facing_up=True):
    """(4, 3) corners at a height."""
    corners = np.array([(x[0], y[0], z), (x[1], y[0], z), (x[1], y[1], z), (x[0], y[1], z)], dtype=float)
    return corners if facing_up else corners[::-1]


def screen(x, z=0.5):
    return rectangle(x, (0, 1), z)


def mesh(*polygons):
    return Mesh(name="test", vertices=np.array(polygons, dtype=float), reflectance=np.full(len(polygons), 0.5))


@dataclass(frozen=True, eq=False)
class Screened(Mesh):
    """Patches with screens that are no patches."""

    screens: tuple[np.ndarray, ...] = ()

    @property
    def occluders(self):
        return np.array(self.screens).reshape(-1, 4, 3)


def screened(screens, plates=None):
    plates = np.array((FLOOR, CEILING) if plates is None else plates, dtype=float)
    return Screened(name="test", vertices=plates, reflectance=np.full(len(plates), 0.5), screens=tuple(screens))


FLOOR, CEILING = rectangle((0, 1), (0, 1), 0), rectangle((0, 1), (0, 1), 1, facing_up=False)


def between_plates(*screens, points=6, plates=(FLOOR, CEILING)):
    """The visible share of the two plates past some screens."""
    surface = screened(screens, plates)
    return visible_fraction_of_pairs(surface, np.array([0]), np.array([1]), points=points)[0]


def exchange(surface):
    """(P, P) exchange areas as if nothing were in the way, which the form factors rightly warn of."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ClosureWarning)
        half = np.triu(form_factors(surface, visibility="none").matrix * surface.areas[:, None], 1)
    return half + half.T


@pytest.fixture(scope="module")
def box_scene():
    scene = room_with_box()
    return scene, exchange(scene)


def uncovered_share(scene):
    """(P,) share of each patch that does not lie under the box."""
    share = np.ones(scene.n_patches)
    floor = scene.faces[0].patches
    low, high = scene.vertices[floor].min(axis=1)[:, :2], scene.vertices[floor].max(axis=1)[:, :2]
    overlap = np.maximum(np.minimum(high, BOX[1, :2]) - np.maximum(low, BOX[0, :2]), 0).prod(axis=1)
    share[floor] -= overlap / scene.areas[floor]
    return share


def test_a_screen_half_way_over_half_the_plates_hides_half():
    # A segment is cut if its middle lies in the screen, and turning the pair about its centre swaps the halves.
    assert between_plates(screen((0, 0.5))) == pytest.approx(0.5, abs=2e-4)


def test_a_screen_larger_than_the_plates_hides_everything():
    assert between_plates(rectangle((-1, 2), (-1, 2), 0.3)) == 0


def test_a_screen_beside_the_shaft_hides_nothing():
    assert between_plates(screen((1.0, 2.0))) == 1
    assert between_plates(rectangle((-1, 2), (-1, 2), 1.5)) == 1


def test_strips_thinner_than_a_patch_hide_together_what_the_whole_screen_hides():
    edges = np.linspace(0, 1, 11)
    hidden = [1 - between_plates(screen(edges[k : k + 2]), points=16) for k in range(10)]
    assert min(hidden) > 0.01
    assert sum(hidden) == pytest.approx(1, abs=1e-3)


def test_occluders_that_overlap_do_not_count_twice():
    half = between_plates(screen((0, 0.5)))
    assert between_plates(screen((0, 0.3)), screen((0.2, 0.5))) == pytest.approx(half, abs=1e-12)
    assert between_plates(screen((0, 0.5)), screen((0, 0.5))) == pytest.approx(half, abs=1e-12)
    assert between_plates(screen((0, 0.5)), screen((0, 0.5))[::-1]) == pytest.approx(half, abs=1e-12)


def test_a_screen_cut_into_pieces_hides_as_much_as_the_whole():
    edges = np.linspace(0, 0.5, 13)
    pieces = [screen(edges[k : k + 2]) for k in range(12)]
    corners = screen((0, 0.5))
    triangles = [corners[[0, 1, 2, 2]], corners[[0, 2, 3, 3]]]
    assert between_plates(*pieces) == pytest.approx(between_plates(corners), abs=1e-12)
    assert between_plates(*triangles) == pytest.approx(between_plates(corners), abs=1e-12)


def test_a_screen_of_very_many_pieces_is_left_to_rays_and_still_hides_half():
    x, y = np.linspace(0, 0.5, 11), np.linspace(0, 1, 21)
    pieces = [rectangle(x[i : i + 2], y[j : j + 2], 0.5) for i in range(10) for j in range(20)]
    found = visible_fraction(screened(pieces), np.ones((2, 2)))
    assert found.rays > 0
    assert found.fraction == pytest.approx([0.5], abs=0.01)


def test_a_screen_next_to_a_plate_hides_its_own_area_of_it():
    # At a millionth of the gap all light of the plate below the screen is stopped, and none of the rest.
    hidden = mesh(rectangle((0, 0.25), (0, 1), 0), rectangle((0.25, 1), (0, 1), 0), CEILING)
    parts = exchange(hidden)[2, :2]
    assert between_plates(screen((0, 0.25), z=1e-6)) == pytest.approx(parts[1] / parts.sum(), abs=1e-5)


def test_a_wall_that_stands_on_a_patch_leaves_exactly_the_part_before_it():
    lamp = rectangle((1, 2), (0, 1), 1, facing_up=False)
    parts = exchange(mesh(rectangle((0, 0.3), (0, 1), 0), rectangle((0.3, 1), (0, 1), 0), lamp))[2, :2]
    wall = np.array([(0.3, -50, 0), (0.3, 50, 0), (0.3, 50, 50), (0.3, -50, 50)])
    through = wall - (0, 0, 20)
    for blade in (wall, wall[::-1], through):
        for plates in ((FLOOR, lamp), (lamp, FLOOR)):
            assert between_plates(blade, plates=plates) == pytest.approx(parts[1] / parts.sum(), rel=1e-6)


def test_screens_that_pierce_each_other_agree_with_rays():
    tilted = np.array([(0.2, -0.2, 0.1), (0.2, 1.2, 0.1), (0.9, 1.2, 0.9), (0.9, -0.2, 0.9)])
    surface = screened([screen((0.1, 0.8)), tilted, screen((0.3, 0.5), 0.7)])
    pair = np.array([0]), np.array([1])
    rays = visible_by_rays(surface, *pair, rays_per_pair=1 << 16)
    assert 0.05 < rays[0] < 0.95
    assert visible_fraction_of_pairs(surface, *pair, points=16) == pytest.approx(rays, abs=1e-3)


def test_rows_of_the_box_scene_sum_to_the_uncovered_share(box_scene):
    scene, areas = box_scene
    for quality, limit in (("exact", 2e-4), ("fair", 1e-3), ("quick", 3e-3)):
        occluded = areas.copy()
        visible_fraction(scene, areas, quality).apply(occluded)
        assert np.abs(occluded.sum(axis=1) / scene.areas - uncovered_share(scene)).max() < limit


def test_a_patch_wholly_under_the_box_exchanges_nothing(box_scene):
    scene, areas = box_scene
    occluded = areas.copy()
    visible_fraction(scene, areas).apply(occluded)
    under = uncovered_share(scene) < 1e-9
    assert under.sum() == 4
    assert not occluded[under].any()


def test_occlusion_is_symmetric_and_only_takes_light_away(box_scene):
    scene, areas = box_scene
    occluded = areas.copy()
    visible_fraction(scene, areas, "quick").apply(occluded)
    assert np.array_equal(occluded, occluded.T)
    assert ((occluded >= 0) & (occluded <= areas)).all()
    assert (areas <= np.minimum.outer(scene.areas, scene.areas)).all()


def test_partly_hidden_pairs_converge_within_the_stated_errors(box_scene):
    scene, areas = box_scene
    found = {points: visible_fraction(scene, areas, points=points) for points in (2, 6, 12)}
    results = {}
    for points, visible in found.items():
        results[points] = areas.copy()
        visible.apply(results[points])
    partly = (results[12] > 0) & (results[12] < areas)
    assert 15_000 * 2 < partly.sum() < 17_000 * 2
    error = {points: np.linalg.norm((results[points] - results[12])[partly]) for points in (2, 6)}
    scale = np.linalg.norm(results[12][partly])
    assert error[2] < 0.03 * scale
    assert error[6] < 0.0015 * scale


def test_the_box_scene_agrees_with_rays_pair_by_pair(box_scene):
    scene, areas = box_scene
    found = visible_fraction(scene, areas)
    some = np.flatnonzero(found.fraction > 0)[::160]
    first, second = found.first[some], found.second[some]
    rays = visible_by_rays(scene, first, second, rays_per_pair=4096)
    assert np.abs(found.fraction[some] - rays).max() < 0.02
    difference = areas[first, second] * (found.fraction[some] - rays)
    assert np.linalg.norm(difference) < 3e-3 * np.linalg.norm(areas[first, second] * rays)


def segments(scene, first, second, n):
    """Begin, end (n⁴, 3) and weight cos cos' / r² (n⁴,) of segments, one in each cell of the four edges."""
    cells = np.stack(np.meshgrid(*[np.arange(n)] * 4), axis=-1).reshape(-1, 4)
    u, v, s, t = ((cells + np.random.default_rng(7).random(cells.shape)) / n).T[..., None]
    ends = []
    for patch, along_u, along_v in ((first, u, v), (second, s, t)):
        a, b, _, d = scene.vertices[patch]
        ends.append(a + along_u * (b - a) + along_v * (d - a))
    along = ends[1] - ends[0]
    leaves, arrives = np.maximum(along @ scene.normals[first], 0), np.maximum(-along @ scene.normals[second], 0)
    return *ends, leaves * arrives / (along**2).sum(axis=1) ** 2


def test_the_box_scene_agrees_with_embree(box_scene):
    rtcore_scene = pytest.importorskip("embreex.rtcore_scene")
    triangles = pytest.importorskip("embreex.mesh_construction")
    scene, areas = box_scene
    embree = rtcore_scene.EmbreeScene()
    triangles.TriangleMesh(embree, scene.occluders[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3, 3).astype(np.float32))
    found = visible_fraction(scene, areas)
    for k in np.flatnonzero(found.fraction > 0)[::800]:
        begin, end, weight = segments(scene, found.first[k], found.second[k], 11)
        along = (end - begin).astype(np.float32)
        # A little is left out at both ends: in single precision a ray may meet the face that it begins on.
        begin = (begin + 1e-5 * (end - begin)).astype(np.float32)
        hits = embree.run(begin, along, query="OCCLUDED", dists=np.full(len(along), 0.99998, dtype=np.float32))
        assert found.fraction[k] == pytest.approx(weight[hits == -1].sum() / weight.sum(), abs=5e-3)


def test_pairs_culled_as_free_or_as_hidden_are_so_for_rays():
    scene = room_with_box(patch_size_m=0.8)
    areas = exchange(scene)
    fraction = np.ones_like(areas)
    visible_fraction(scene, areas).apply(fraction)
    first, second = np.nonzero(np.triu(areas))
    rays = visible_by_rays(scene, first, second, rays_per_pair=64)
    found = fraction[first, second]
    assert (rays[found == 1] == 1).all()
    assert (rays[found == 0] < 1e-12).all()
    assert (found == 0).any()


def test_the_listed_pairs_get_the_numbers_of_the_matrix(box_scene):
    scene, areas = box_scene
    found = visible_fraction(scene, areas, "quick")
    listed = visible_fraction_of_pairs(scene, found.first, found.second, "quick")
    assert np.allclose(listed, found.fraction, rtol=0, atol=1e-12)
    assert visible_fraction_of_pairs(scene, np.array([0]), np.array([1])) == 1


def test_neither_turning_nor_scaling_the_scene_changes_what_is_visible():
    scene = room_with_box(patch_size_m=0.8)
    here = Mesh(name="here", vertices=scene.vertices, reflectance=scene.reflectance)
    found = visible_fraction(here, exchange(scene))
    turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    moved = Mesh(name="moved", vertices=10 * scene.vertices @ turn.T + 50, reflectance=scene.reflectance)
    again = visible_fraction_of_pairs(moved, found.first, found.second)
    assert np.abs(again - found.fraction).max() < 1e-2
    assert (np.abs(again - found.fraction) > 1e-9).mean() < 0.02


def test_a_convex_scene_costs_no_work_and_no_rays(monkeypatch):
    scene = paper_room(patch_size_m=0.8)
    for function in ("visible_of_matrix", "visible_of_pairs"):
        monkeypatch.setattr(_kernel, function, lambda *_: pytest.fail("looked for occluders"))
    found = visible_fraction(scene, exchange(scene))
    assert len(found.first) == found.rays == 0
    assert visible_fraction_of_pairs(scene, np.array([0]), np.array([100])) == 1


def test_the_number_of_threads_changes_no_bit(box_scene):
    scene, areas = box_scene
    threads = _kernel.threads()
    results = []
    for count in (1, 3):
        _kernel.set_threads(count)
        results.append(visible_fraction(scene, areas, "quick").fraction)
    _kernel.set_threads(threads)
    assert np.array_equal(*results)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6))
def test_random_screens_keep_the_share_in_bounds_and_more_screens_hide_more(seed):
    random = np.random.default_rng(seed)
    screens = []
    for _ in range(3):
        centre, u, v = random.uniform(0.2, 0.8, 3), random.normal(size=3), random.normal(size=3)
        v -= (u @ v) / (u @ u) * u
        u, v = (0.25 * edge / np.linalg.norm(edge) for edge in (u, v))
        screens.append(np.array([centre + a * u + b * v for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]))
    shares = np.array([between_plates(*screens[:count], points=8) for count in range(4)])
    assert ((shares >= 0) & (shares <= 1)).all()
    assert (np.diff(shares) < 0.01).all()


def enters_box(begin, end):
    """(n,) the segment passes through the box: the slab test, which knows no polygons."""
    along = end - begin
    at = (BOX[:, None] - begin) / along
    return np.minimum(at.max(axis=0).min(axis=1), 1) > np.maximum(at.min(axis=0).max(axis=1), 0)


def test_segments_are_blocked_exactly_if_they_enter_the_box():
    scene = room_with_box()
    points = np.random.default_rng(5).uniform((0, 0, 0), (4.8, 4.8, 2.4), (2, 40_000, 3))
    outside = ~((points > BOX[0]) & (points < BOX[1])).all(axis=2).any(axis=0)
    begin, end = points[:, outside]
    expected = enters_box(begin, end)
    assert 0.05 < expected.mean() < 0.5
    assert np.array_equal(segments_blocked(scene, begin, end), expected)


def test_segments_among_thousands_of_triangles_agree_with_each_triangle_alone():
    random = np.random.default_rng(6)
    triangles = random.uniform(0, 1, (2000, 1, 3)) + random.normal(0, 0.02, (2000, 3, 3))
    surface = screened(triangles[:, [0, 1, 2, 2]])
    begin, end = random.uniform(0, 1, (2, 300, 3))
    expected = np.zeros(300, dtype=bool)
    for a, b, c in surface.occluders[:, :3]:
        # Barycentric coordinates of the crossing.
        edges = np.stack(np.broadcast_arrays(b - a, c - a, begin - end), axis=2)
        u, v, t = np.linalg.solve(edges, (begin - a)[..., None])[..., 0].T
        expected |= (u > 0) & (v > 0) & (u + v < 1) & (t > 0) & (t < 1)
    assert 0.1 < expected.mean() < 0.9
    assert np.array_equal(segments_blocked(surface, begin, end), expected)


def test_a_segment_that_begins_on_an_occluder_is_not_blocked_by_it():
    surface = screened([screen((0, 1))])
    begin, end = np.array([[0.5, 0.5, 0.5], [0.5, 0.5, 0.0]]), np.full((2, 3), (0.4, 0.5, 1.0))
    assert segments_blocked(surface, begin, end).tolist() == [False, True]


def test_bad_arguments_are_refused():
    surface = screened([screen((0, 1))])
    with pytest.raises(SimulationError, match="shape"):
        visible_fraction(surface, np.ones((3, 3)))
    with pytest.raises(SimulationError, match="quick, fair, exact"):
        visible_fraction(surface, np.ones((2, 2)), "best")
    with pytest.raises(SimulationError, match=r"1 \.\.\. 64"):
        visible_fraction(surface, np.ones((2, 2)), points=0)
    with pytest.raises(SimulationError, match=r"0 \.\.\. 1"):
        visible_fraction_of_pairs(surface, np.array([0]), np.array([2]))
    with pytest.raises(SimulationError, match="shapes"):
        visible_fraction_of_pairs(surface, np.array([0]), np.array([1, 2]))
    with pytest.raises(SimulationError, match=r"\(n, 3\)"):
        segments_blocked(surface, np.zeros((2, 3)), np.zeros((3, 3)))
