"""The simulated world obeys physics: it is the truth that everything else is scored against."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from rig.devices.simulated.optics import directions, make_optics, pixels_of
from rig.devices.simulated.room import SimulatedRoom, make_room, trace
from rig.devices.simulated.settings import SimulationSettings
from rig.devices.simulated.world import SimulatedWorld
from rig.errors import ProfileError

PROFILE = Path(__file__).parents[4] / "hw_profiles" / "ci-tiny.toml"


@pytest.fixture(scope="module")
def settings() -> SimulationSettings:
    return SimulationSettings.model_validate(tomllib.loads(PROFILE.read_text())["simulation"])


@pytest.fixture(scope="module")
def room(settings: SimulationSettings) -> SimulatedRoom:
    return make_room(settings)


@pytest.fixture(scope="module")
def world(settings: SimulationSettings) -> SimulatedWorld:
    return SimulatedWorld(settings, (240, 320), (192, 256))


def test_every_point_of_a_closed_room_sees_the_whole_room(room: SimulatedRoom) -> None:
    np.testing.assert_allclose(room.form_factors.sum(axis=1), 1.0, atol=2e-6)


def test_cells_exchange_light_as_monte_carlo_rays_do(room: SimulatedRoom) -> None:
    random = np.random.default_rng(3)
    wall = next(w for w in room.walls if w.name == "y1")
    ia, ib = 5, 2
    origin = np.array([wall.centres_m[0][ia], wall.position_m - 1e-9, wall.centres_m[1][ib]])
    u1, u2 = random.uniform(size=(2, 400_000))
    r, phi = np.sqrt(u1), 2 * np.pi * u2
    rays = np.stack([r * np.cos(phi), -np.sqrt(1 - u1), r * np.sin(phi)], axis=-1)
    from rig.devices.simulated.room import cells_of

    cells = cells_of(room, trace(room, origin, rays))
    share = np.bincount(cells[cells >= 0], minlength=len(room.reflectance)) / len(rays)
    expected = room.form_factors[wall.first_cell + ia * wall.shape[1] + ib]
    error = np.abs(share - expected) / np.sqrt(np.maximum(expected, 1e-7) / len(rays) + 1e-12)
    assert np.quantile(error, 0.99) < 4.0


def test_even_emission_in_a_closed_grey_room_gives_the_furnace_value(room: SimulatedRoom) -> None:
    grey = replace(room, reflectance=np.full_like(room.reflectance, 0.7))
    irradiance = grey.indirect_irradiance(np.ones(len(room.reflectance)))
    np.testing.assert_allclose(irradiance, 1 / (1 - 0.7), rtol=1e-4)


def test_all_of_the_projectors_light_lands_in_a_closed_room(world: SimulatedWorld) -> None:
    white = np.ones(np.prod(world.projector.shape), dtype=np.float32)
    landed = (world.emission @ white / world.room.reflectance * world.room.cell_area_m2).sum()
    assert landed == pytest.approx(world._pixel_flux.sum(), rel=1e-4)


def test_direct_light_at_pixels_agrees_with_the_light_that_lands_on_cells(world: SimulatedWorld) -> None:
    light = world.light_of(np.ones(world.projector.shape, dtype=np.float32))
    emission = world.emission @ np.ones(np.prod(world.projector.shape), dtype=np.float32)
    seen = (world._view @ emission).reshape(world.camera.shape)
    well_lit = light.direct > 0.5 * np.median(light.direct[light.direct > 0])
    assert np.median(light.direct[well_lit] / seen[well_lit]) == pytest.approx(1.0, abs=0.02)


def test_light_adds_up(world: SimulatedWorld) -> None:
    random = np.random.default_rng(5)
    a, b = random.uniform(size=(2, *world.projector.shape)).astype(np.float32)
    apart, together = (world.light_of(a), world.light_of(b)), world.light_of(a + b)
    np.testing.assert_allclose(apart[0].direct + apart[1].direct, together.direct, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(apart[0].global_ + apart[1].global_, together.global_, rtol=1e-3, atol=1e-6)


def test_a_point_projects_to_the_pixel_whose_ray_hits_it(settings: SimulationSettings) -> None:
    optics = make_optics(settings.camera, (240, 320))
    pixels = np.array([[3.0, 5.0], [160.2, 119.7], [318.0, 230.0]])
    points = optics.position_m + 2.5 * directions(optics, pixels)
    np.testing.assert_allclose(pixels_of(optics, points), pixels, atol=1e-6)


def test_a_lens_whose_distortion_folds_back_lights_nothing_outside_of_its_picture(
    settings: SimulationSettings,
) -> None:
    """Light was negative there: a black arc where the room is lit by what its walls reflect."""
    table = settings.model_dump(by_alias=True)
    table["projector"][0]["focal_px"] = 200.0
    table["projector"][0]["distortion"] = (-0.041, -0.033, 0.0, 0.0, 0.0)
    table["camera"][0].update(focal_px=60.0, distortion=(0.0,) * 5)
    world = SimulatedWorld(SimulationSettings.model_validate(table), (240, 320), (192, 256))
    direct = world.light_of(np.ones(world.projector.shape, dtype=np.float32)).direct
    assert direct.min() >= 0
    seen = world.surface.points_m
    toward = (seen - world.projector.position_m) @ world.projector.rotation.T
    angle = np.degrees(np.arctan2(np.hypot(toward[..., 0], toward[..., 1]), toward[..., 2]))
    corners = directions(world.projector, np.array([[-0.5, -0.5], [255.5, -0.5], [-0.5, 191.5], [255.5, 191.5]]))
    widest = np.degrees(np.arccos((corners @ world.projector.rotation.T)[:, 2])).max()
    assert (angle > widest + 5).mean() > 0.2
    assert not direct[angle > widest + 5].any()


def test_a_distortion_that_folds_the_picture_itself_is_refused_with_the_terms(settings: SimulationSettings) -> None:
    table = settings.model_dump(by_alias=True)
    table["projector"][0]["distortion"] = (-0.25, -0.1, 0.0, 0.0, 0.0)
    with pytest.raises(ProfileError, match=r"distortion \(-0\.25, -0\.1.* of 'projector' cannot be undone"):
        SimulatedWorld(SimulationSettings.model_validate(table), (240, 320), (192, 256))


def test_a_device_outside_the_room_is_refused(settings: SimulationSettings) -> None:
    table = settings.model_dump(by_alias=True)
    table["camera"][0]["position_m"] = (9.0, 1.0, 1.0)
    with pytest.raises(ValidationError, match=r"position_m .* of 'camera' is outside size_m"):
        SimulationSettings.model_validate(table)
