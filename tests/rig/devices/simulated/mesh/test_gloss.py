"""Glossy surfaces: the lobe keeps energy and is reciprocal, and light goes where mirrors send it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rig.devices.simulated.mesh.gloss import frames_of, lobe, sampled
from rig.devices.simulated.mesh.scene import TriangleScene
from rig.devices.simulated.mesh.world import MeshWorld, exchange_of
from rig.devices.simulated.pair import Light
from rig.devices.simulated.worlds.shapes import quad
from tests.rig.devices.simulated.mesh.scenes_of_tests import CAMERA, PROJECTOR, FloatArray, scene_of, settings_of, walls

WHITE = np.ones(PROJECTOR, np.float32)
N = 200_000


def towards(elevation_deg: float) -> FloatArray:
    angle = np.radians(elevation_deg)
    return np.tile([np.cos(angle), 0.0, np.sin(angle)], (N, 1))


def even_directions() -> FloatArray:
    z, phi = np.random.default_rng(1).uniform(size=(2, N))
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(2 * np.pi * phi), r * np.sin(2 * np.pi * phi), z], axis=1)


@pytest.mark.parametrize("roughness", [0.1, 0.3, 1.0])
@pytest.mark.parametrize("elevation_deg", [85.0, 40.0, 10.0])
def test_sampling_sends_back_what_the_lobe_does_and_never_more_than_arrives(
    roughness: float, elevation_deg: float
) -> None:
    alpha = np.full(N, roughness)
    chances = np.random.default_rng(2).uniform(size=(N, 2))
    directions, weight = sampled(towards(elevation_deg), alpha, chances)
    assert weight.max() <= 1
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-9)
    if roughness < 0.3:
        return  # even directions hardly ever hit so narrow a lobe
    ways = even_directions()
    share = 2 * np.pi * lobe(ways, towards(elevation_deg), alpha) * ways[:, 2]
    assert share.mean() == pytest.approx(weight.mean(), rel=0.02, abs=4 * share.std() / np.sqrt(N))
    moment = (share[:, None] * ways).mean(axis=0)
    np.testing.assert_allclose((weight[:, None] * directions).mean(axis=0), moment, atol=0.02)


def test_the_lobe_is_the_same_both_ways() -> None:
    first, second = even_directions(), even_directions()[::-1]
    alpha = np.random.default_rng(3).uniform(0.05, 1, size=N)
    np.testing.assert_allclose(lobe(first, second, alpha), lobe(second, first, alpha), rtol=1e-9)


def test_a_frame_is_right_handed_with_its_normal_last() -> None:
    normals = np.array([[0, 0, 1.0], [0, 0, -1.0], [1.0, 0, 0], [0.6, 0, -0.8], [-0.48, 0.6, 0.64]])
    axes = frames_of(normals)
    np.testing.assert_allclose(axes @ axes.transpose(0, 2, 1), np.tile(np.eye(3), (5, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(axes), 1)
    np.testing.assert_allclose(axes[:, 2], normals)


def rendered(scene: TriangleScene) -> tuple[MeshWorld, Light]:
    pytest.importorskip("embreex")
    settings = settings_of(rays=256)
    world = MeshWorld(settings, exchange_of(scene, settings), CAMERA, PROJECTOR)
    return world, world.light_of(WHITE)


def test_gloss_never_adds_light() -> None:
    """A furnace whose walls all send back 0.8, some of it by a lobe, is never brighter than a matte one."""
    pytest.importorskip("embreex")
    scene = scene_of(walls(), 0.8)
    glossy = replace(
        scene, reflectance=scene.reflectance - 0.4, gloss=scene.gloss + 0.4, roughness=scene.roughness * 0.2
    )
    exchange = exchange_of(glossy, settings_of(cell_size_m=0.5, rays=128))
    exchange.require(np.arange(exchange.grid.n_nodes))
    per_node = np.asarray(exchange.views.sum(axis=1)).ravel()[: exchange.grid.n_nodes]
    assert per_node.max() <= 1 / (1 - 0.4)  # each mirror image of an even room is at most 0.4 of the one before
    cells = np.ones(2 * exchange.grid.n_cells, np.float32)
    nothing = np.zeros(2 * exchange.grid.n_nodes, np.float32)
    found = exchange.irradiance(cells, nothing, 0.4 * cells)[: exchange.grid.n_nodes]
    # Even radiance L of walls that emit 1 and send back at most 0.8 in all: L <= 1 / (1 - 0.8).
    assert found.max() <= 5.0 * (1 + 1e-4)
    assert found.mean() > 0.95 * 5.0


def test_a_matte_share_turned_into_gloss_keeps_the_rooms_energy_about() -> None:
    scene = scene_of(walls(), 0.6)
    floor = scene.material == scene.materials.index("floor")
    shiny = replace(
        scene,
        reflectance=np.where(floor[:, None], 0.3, scene.reflectance),
        gloss=np.where(floor, 0.3, 0.0),
        roughness=np.full(len(floor), 0.5),
    )
    (_, matte), (_, glossy) = rendered(scene), rendered(shiny)
    assert glossy.total.mean() < 1.15 * matte.total.mean()
    assert glossy.total.mean() > 0.75 * matte.total.mean()


def test_a_mirror_on_the_floor_shows_the_wall_upside_down() -> None:
    """The floor shows, where the law of reflection says, a bright spot on a wall that itself has no gloss."""
    pytest.importorskip("embreex")
    scene = scene_of(walls(), 0.5, floor=(0.0, 0.9, 0.02))
    settings = settings_of(rays=64, camera={"look_at_m": (2.6, 2.4, 0.3)})
    world = MeshWorld(settings, exchange_of(scene, settings), CAMERA, PROJECTOR)
    spot = np.zeros(PROJECTOR, np.float32)
    spot[14:17, 22:25] = 1.0
    light = world.light_of(spot)
    y, x = np.unravel_index(light.direct.argmax(), light.direct.shape)
    source = world.surface.points_m[y, x]
    assert source[2] > 0.1  # on a wall
    image = source * (1, 1, -1)
    from rig.devices.simulated.optics import pixels_of

    expected = pixels_of(world.camera, image)
    on_floor = world.surface.points_m[..., 2] < 1e-6
    seen = np.where(on_floor, light.global_, 0)
    brightest = np.unravel_index(seen.argmax(), seen.shape)[::-1]
    np.testing.assert_allclose(brightest, expected, atol=2.0)


def test_light_by_way_of_a_mirror_lands_where_the_law_of_reflection_says() -> None:
    """A mirror lying on the floor throws the projector's light up the wall behind it."""
    pytest.importorskip("embreex")
    mirror = quad((1.4, 1.4, 0.01), (0.5, 0, 0), (0, 0.5, 0))
    scene = scene_of({**walls(), "mirror": mirror}, 0.3, mirror=(0.0, 0.95, 0.02))
    settings = settings_of(cell_size_m=0.15, rays=64, projector={"look_at_m": (1.65, 1.65, 0.0), "focal_px": 60.0})
    world = MeshWorld(settings, exchange_of(scene, settings), CAMERA, PROJECTOR)
    arriving = world._sent.by_gloss @ WHITE.ravel()
    grid = world.exchange.grid
    nodes = grid.node_m
    n = grid.n_nodes
    total = (arriving * np.tile(world.exchange.node_area_m2, 2)).sum()
    image = world.projector.position_m * (1, 1, -1) + (0, 0, 0.02)
    corners = mirror.reshape(-1, 3)
    # Where rays from the mirrored lens through the mirror's corners meet the wall y = 3.
    way = corners - image
    hits = image + way * ((3.0 - image[1]) / way[:, 1])[:, None]
    flux = arriving[:n] * world.exchange.node_area_m2
    centre = (flux[:, None] * nodes).sum(axis=0) / flux.sum()
    assert total < 0.95 * settings.projector.flux
    assert flux.sum() > 0.9 * total
    low, high = hits.min(axis=0), hits.max(axis=0)
    assert low[0] - 0.2 < centre[0] < high[0] + 0.2
    assert centre[2] > 0.5
