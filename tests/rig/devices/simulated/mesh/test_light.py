"""Light in a world of triangles obeys physics: closed forms, energy, shadows where geometry says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rig.devices.simulated.mesh.exchange import Exchange
from rig.devices.simulated.mesh.light_grid import Partitions, make_light_grid
from rig.devices.simulated.mesh.scene import TriangleScene
from rig.devices.simulated.mesh.tracer import Tracer
from rig.devices.simulated.mesh.world import MeshWorld, exchange_of
from rig.devices.simulated.settings import SimulationSettings
from rig.devices.simulated.world import SimulatedWorld
from rig.devices.simulated.worlds.shapes import block, quad, sheet
from tests.rig.devices.simulated.mesh.scenes_of_tests import (
    CAMERA,
    PROJECTOR,
    FloatArray,
    scene_of,
    settings_of,
    walls,
    with_box,
)

pytest.importorskip("embreex")
WHITE = np.ones(PROJECTOR, np.float32)


def world_of(scene: TriangleScene, **changes: object) -> MeshWorld:
    settings = settings_of(**changes)
    return MeshWorld(settings, exchange_of(scene, settings), CAMERA, PROJECTOR)


@pytest.fixture(scope="module")
def furnished() -> MeshWorld:
    return world_of(scene_of(with_box(), 0.6))


def even_light(exchange: Exchange, reflectance: float) -> FloatArray:
    """Irradiance at the nodes in front where every surface emits 1 and reflects alike."""
    exchange.require(np.arange(exchange.grid.n_nodes))
    cells = np.ones(2 * exchange.grid.n_cells, np.float32)
    nothing = np.zeros(2 * exchange.grid.n_nodes, np.float32)
    return exchange.irradiance(cells, nothing, reflectance * cells)[: exchange.grid.n_nodes].astype(float)


@pytest.mark.parametrize("reflectance", [0.2, 0.8])
def test_a_closed_room_that_glows_evenly_is_a_furnace(reflectance: float) -> None:
    exchange = exchange_of(scene_of(walls()), settings_of(rays=64))
    np.testing.assert_allclose(even_light(exchange, reflectance), 1 / (1 - reflectance), rtol=1e-4)


def test_light_from_one_spot_of_a_sphere_is_the_same_everywhere_in_it() -> None:
    def place(angle: FloatArray, elevation: FloatArray) -> FloatArray:
        around = np.cos(elevation)
        return np.stack([around * np.cos(angle), around * np.sin(angle), np.sin(elevation)], axis=-1)

    ball = sheet(place, np.linspace(0, 2 * np.pi, 33), np.linspace(-np.pi / 2, np.pi / 2, 17))
    exchange = exchange_of(scene_of({"ball": ball}), settings_of(cell_size_m=0.4, rays=1024))
    grid, rho = exchange.grid, 0.7
    exchange.require(grid.n_nodes + np.arange(grid.n_nodes))  # the side that looks inwards
    emission = np.zeros(2 * grid.n_cells, np.float32)
    lit = np.flatnonzero(grid.cell_corners_m.mean(axis=1)[:, 2] > 0.8)
    emission[grid.n_cells + lit] = 1.0
    nothing = np.zeros(2 * grid.n_nodes, np.float32)
    found = exchange.irradiance(emission, nothing, np.full(2 * grid.n_cells, rho, np.float32))[grid.n_nodes :]
    flux, area = grid.cell_area_m2[lit].sum(), grid.cell_area_m2.sum()
    # Every point of a sphere sees every other alike: E = flux / (A (1 - rho)).
    assert found.mean() == pytest.approx(flux / (area * (1 - rho)), rel=0.01)
    assert found.std() / found.mean() < 0.06  # facets that share a corner with the lit ones see a polyhedron


@pytest.mark.parametrize(("gap_m", "expected"), [(1.0, 0.1998), (0.5, 0.4153), (2.0, 0.0686)])
def test_parallel_squares_exchange_what_the_textbook_says(gap_m: float, expected: float) -> None:
    # View factor of two opposite unit squares, e.g. Howell, configuration C-11.
    plates = {"low": quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), "high": quad((0, 0, gap_m), (0, 1, 0), (1, 0, 0))}
    exchange = exchange_of(scene_of(plates), settings_of(cell_size_m=0.1, rays=2048))
    grid = exchange.grid
    low = np.flatnonzero(exchange.scene.material[grid.node_facet] == 0)
    exchange.require(low)
    emission = np.zeros(2 * grid.n_cells, np.float32)
    emission[: grid.n_cells][exchange.scene.material[grid.facet_of_cell] == 1] = 1.0
    found = (exchange.views @ emission)[: grid.n_nodes]
    area = exchange.node_area_m2
    assert np.average(found[low], weights=area[low]) == pytest.approx(expected, rel=0.01)


def test_all_of_the_projectors_light_lands_in_a_closed_room(furnished: MeshWorld) -> None:
    areas = np.tile(furnished.exchange.grid.cell_area_m2, 2)
    landed = (furnished._sent.landing @ WHITE.ravel() * areas).sum()
    assert landed == pytest.approx(furnished.settings.projector.flux, rel=1e-5)


def test_light_adds_up(furnished: MeshWorld) -> None:
    a, b = np.random.default_rng(5).uniform(size=(2, *PROJECTOR)).astype(np.float32)
    one, other, both = (furnished.light_of(picture) for picture in (a, b, a + b))
    np.testing.assert_allclose(one.direct + other.direct, both.direct, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(one.global_ + other.global_, both.global_, rtol=1e-3, atol=1e-6)


def test_a_shadow_lies_where_the_lens_is_hidden(furnished: MeshWorld) -> None:
    light, surface = furnished.light_of(WHITE), furnished.surface
    points = surface.points_m.reshape(-1, 3) + 1e-4 * surface.normals.reshape(-1, 3)
    lens = furnished.projector.position_m
    clear = furnished.exchange.tracer.clear(points, lens).reshape(CAMERA)
    facing = np.einsum("ijk,ijk->ij", lens - surface.points_m, surface.normals) > 0
    lit = light.direct > 0
    inside = lit_inside(clear & facing)
    # Pixels whose neighbours are all alike: in the middle of light, or of shadow.
    assert lit[inside & in_picture(furnished)].all()
    assert not lit[lit_inside(~(clear & facing))].any()
    assert lit_inside(~clear & facing).sum() > 5  # there is a shadow


def lit_inside(mask: np.ndarray) -> np.ndarray:
    """Pixels that are true with all their neighbours."""
    wide = np.pad(mask, 1)
    return np.logical_and.reduce([wide[1 + a : 49 + a, 1 + b : 65 + b] for a in (-1, 0, 1) for b in (-1, 0, 1)])


def in_picture(world: MeshWorld) -> np.ndarray:
    from rig.devices.simulated.optics import pixels_of

    xy = pixels_of(world.projector, world.surface.points_m)
    return np.asarray((xy > 0).all(axis=-1) & (xy < (PROJECTOR[1] - 1, PROJECTOR[0] - 1)).all(axis=-1))


def box_settings(as_mesh: bool) -> SimulationSettings:
    faces = dict.fromkeys(("floor", "ceiling", "x0", "x1", "y0", "y1"), 0.65)
    settings = settings_of(cell_size_m=0.12, rays=512)
    if as_mesh:
        return settings
    table = settings.model_dump(by_alias=True) | {"scene": None, "size_m": (3.0, 3.0, 2.4), "reflectance": faces}
    return SimulationSettings.model_validate(table)


def test_a_box_of_triangles_looks_like_the_box_of_walls() -> None:
    walls_world = SimulatedWorld(box_settings(False), CAMERA, PROJECTOR)
    settings = box_settings(True)
    mesh_world = MeshWorld(settings, exchange_of(scene_of(walls(), 0.65), settings), CAMERA, PROJECTOR)
    box, mesh = (world.light_of(WHITE) for world in (walls_world, mesh_world))
    assert mesh.global_.mean() == pytest.approx(box.global_.mean(), rel=0.005)
    assert np.abs(mesh.global_ / box.global_ - 1).mean() < 0.01
    lit = box.direct > 0.5 * np.median(box.direct[box.direct > 0])
    assert np.median(np.abs(mesh.direct / np.maximum(box.direct, 1e-9) - 1)[lit]) < 1e-4
    np.testing.assert_allclose(mesh_world.surface.points_m, walls_world.surface.points_m, atol=1e-5)
    np.testing.assert_allclose(mesh_world.surface.normals, walls_world.surface.normals, atol=1e-6)


def test_room_light_is_that_of_a_furnace() -> None:
    world = world_of(scene_of(walls(), 0.5), ambient=0.01)
    np.testing.assert_allclose(world.ambient, 0.5 * 0.01 / (1 - 0.5), rtol=1e-3)


def test_the_same_seed_gives_the_same_bits() -> None:
    scene = scene_of(with_box(), 0.6, floor=(0.4, 0.3, 0.2))
    first, again = (world_of(scene, rays=64).light_of(WHITE) for _ in range(2))
    assert (first.total == again.total).all()
    other = world_of(scene, rays=64, seed=2).light_of(WHITE)
    assert (first.global_ != other.global_).any()


def test_nodes_that_a_box_covers_take_no_part_in_what_is_seen_beside_it() -> None:
    box = block((1.55, 1.45), (0.7, 0.5, 0.4))
    scene = scene_of({**walls(), "box": box}, 0.6)
    tracer, grid = Tracer(scene), make_light_grid(scene, 0.3)
    x, y = np.meshgrid(np.linspace(1.1, 2.0, 37), np.linspace(1.1, 1.8, 29))
    above = np.stack([x.ravel(), y.ravel(), np.full(x.size, 2.0)], axis=1)
    above = above[(np.abs(above[:, 0] - 1.55) > 0.353) | (np.abs(above[:, 1] - 1.45) > 0.253)]  # not on its faces
    hits = tracer.hits(above, np.tile([0.0, 0.0, -1.0], (len(above), 1)))
    beside = hits[scene.material[hits.facet] == scene.materials.index("floor")]
    blend = Partitions(grid, tracer).seen(grid.blend_of(beside), tracer.points_m(beside), beside)
    nodes = grid.node_m[blend.nodes]
    covered = (np.abs(nodes[..., 0] - 1.55) < 0.34) & (np.abs(nodes[..., 1] - 1.45) < 0.24)
    assert covered.any()
    assert blend.weights[covered].max() < 0.01  # one at the very corner may be seen past it
    np.testing.assert_allclose(blend.weights.sum(axis=1), 1)


def test_turning_triangles_inside_out_changes_nothing(furnished: MeshWorld) -> None:
    scene = scene_of(with_box(), 0.6)
    turned = replace(scene, triangles_m=scene.triangles_m[:, ::-1])
    light, reference = world_of(turned).light_of(WHITE), furnished.light_of(WHITE)
    np.testing.assert_allclose(light.direct, reference.direct, rtol=1e-3, atol=1e-4)
    assert light.global_.mean() == pytest.approx(reference.global_.mean(), rel=0.005)


def test_scores_find_the_reflectance_of_what_is_near_and_of_nothing_else(furnished: MeshWorld) -> None:
    wall = np.array([[1.0, 0.0, 1.0], [2.0, 0.02, 1.2], [1.5, 0.1, 1.0]])
    found = furnished.reflectance_near(wall, np.array([0.0, 1.0, 0.0]))
    np.testing.assert_allclose(found, [0.6, 0.6, np.nan])


def test_what_pixels_look_at_is_on_the_scene_and_faces_the_camera(furnished: MeshWorld) -> None:
    surface, lens = furnished.surface, furnished.camera.position_m
    assert surface.points_m.shape == (*CAMERA, 3)
    assert (np.einsum("ijk,ijk->ij", lens - surface.points_m, surface.normals) > 0).all()
    np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=-1), 1)
    np.testing.assert_allclose(surface.reflectance, 0.6)
    assert furnished.exchange.tracer.clear(surface.points_m[::9, ::9].reshape(-1, 3) * 0.999 + lens * 0.001, lens).all()
