"""The scene_model: where calibration and simulation meet, against a simulated world that is neither."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.geometry import pinhole
from calibration.geometry.pinhole import PinholeModel
from calibration.light.alike import Alike
from rig.devices.simulated.world import SimulatedWorld
from rig.profile.schema import load_profile
from rig.stages.correspondence import DevicePair
from rig.stages.light.fit import BandLight, BareRoom, direct_gain, pixels_that_tell
from rig.stages.maps.sampling import sample
from rig.stages.maps.white import light_of_white
from rig.stages.scene_model import (
    ColouredRoom,
    MeasuredLight,
    PosedCamera,
    PosedLens,
    PosedProjector,
    SceneModel,
    camera_view,
    cast_pixels,
    posed_lens,
    projector_view,
    unit_emission,
)
from rig.truth.scores import ground_truth_reflectance
from sim.form_factors import form_factors
from sim.geometry.optics import project, rays_at
from sim.scenes.gridded import room


def model_of(lens, rotation) -> PinholeModel:  # type: ignore[no-untyped-def]
    position = np.array(lens.position_m)
    width, height = (320, 240) if lens.principal_point_px[0] > 140 else (256, 192)
    return PinholeModel(
        width_px=width,
        height_px=height,
        focal_px=(lens.focal_px, lens.focal_px),
        principal_point_px=tuple(lens.principal_point_px),
        distortion=tuple(lens.distortion),
        rotation=rotation,
        translation_m=-rotation @ position,
    )


@pytest.fixture(scope="module")
def world() -> SimulatedWorld:
    profile = load_profile("ci-tiny")
    assert profile.simulation is not None
    return SimulatedWorld(profile.simulation, profile.camera.shape[:2], profile.projector.shape)


@pytest.fixture(scope="module")
def scene_model(world: SimulatedWorld) -> SceneModel:
    """Built from the simulated world's true numbers; patches of 0.3 m instead of its cells, factors of another kind."""
    settings = world.settings
    camera = posed_lens(model_of(settings.camera, world.camera.rotation), settings.camera.vignetting)
    projector = posed_lens(model_of(settings.projector, world.projector.rotation), settings.projector.vignetting)
    scene = room(settings.size_m, 0.3, 0.5, tuple(settings.reflectance))
    scene = scene.with_reflectance(ground_truth_reflectance(world, scene, projector))
    white = world.light_of(np.ones(world.projector.shape, np.float32))
    gain = (white.direct * world.vignetting).astype(np.float64)
    seen = cast_pixels(scene, camera)
    xy = project(projector.lens, projector.pose, seen.points_m)
    height, width = world.projector.shape
    with np.errstate(invalid="ignore"):
        inside = (xy > 0).all(axis=1) & (xy < (width - 1, height - 1)).all(axis=1)
    gain[~inside.reshape(gain.shape)] = 0
    flux = settings.projector.flux / (height * width) * settings.projector.focal_px**2
    emission = unit_emission(scene, projector)
    own = PosedProjector(device=projector, hits=cast_pixels(scene, projector), flux=flux, unit_emission=emission)
    xy = np.where(inside[:, None], xy, np.nan).reshape(*gain.shape, 2)
    return SceneModel(
        scene=scene,
        form_factors=form_factors(scene),
        cameras={"camera": PosedCamera(camera, seen)},
        projectors={"projector": own},
        measured={DevicePair("camera", "projector"): MeasuredLight(gain, xy)},
        walls=tuple(settings.reflectance),
    )


def test_the_two_pinholes_agree(scene_model: SceneModel, world: SimulatedWorld) -> None:
    model = model_of(world.settings.camera, world.camera.rotation)
    pixels = np.array([[2.0, 3.0], [160.0, 120.0], [317.0, 236.0]])
    rays = pinhole.world_rays(model, pixels)
    np.testing.assert_allclose(rays, rays_at(scene_model.camera.lens, scene_model.camera.pose, pixels), atol=1e-7)
    points = model.position_m + 3.0 * rays
    np.testing.assert_allclose(pinhole.project(model, points), pixels, atol=1e-4)


def test_the_scene_model_sees_the_global_light_of_the_simulated_world(
    scene_model: SceneModel, world: SimulatedWorld
) -> None:
    random = np.random.default_rng(4)
    picture = np.kron(random.uniform(size=(6, 8)), np.ones((32, 32))).astype(np.float32)
    picture *= scene_model.active.reshape(picture.shape)
    true = (world.light_of(picture).global_ * world.vignetting).ravel()
    found = camera_view(scene_model, scene_model.active).global_ @ picture.ravel()[scene_model.active].astype(
        np.float64
    )
    lit = scene_model.light.direct_gain.ravel() > 0
    assert np.median(found[lit] / true[lit]) == pytest.approx(1.0, abs=0.02)
    assert np.quantile(np.abs(found[lit] / true[lit] - 1), 0.9) < 0.03


def test_what_a_projector_pixel_sees_is_what_the_camera_sees_there(scene_model: SceneModel) -> None:
    picture = np.full(int(scene_model.active.sum()), 0.5)
    at_pixels = np.full(scene_model.active.size, np.nan)
    at_pixels[scene_model.active] = projector_view(scene_model, scene_model.active) @ picture
    in_camera = (camera_view(scene_model, scene_model.active) @ picture).reshape(scene_model.camera.lens.shape)
    ratio = at_pixels / sample(in_camera, scene_model.camera_xy_px)
    assert np.nanmedian(ratio) == pytest.approx(1.0, abs=0.01)
    assert np.nanquantile(np.abs(ratio - 1), 0.9) < 0.03


def test_both_views_have_true_adjoints(scene_model: SceneModel) -> None:
    random = np.random.default_rng(8)
    for transport in (camera_view(scene_model, scene_model.active), projector_view(scene_model, scene_model.active)):
        x, y = random.uniform(size=transport.shape[1]), random.uniform(size=transport.shape[0])
        assert (transport @ x) @ y == pytest.approx(x @ (transport.T @ y), rel=1e-9)


def test_a_pixel_that_seems_to_reflect_many_times_all_light_is_taken_for_its_patch(scene_model: SceneModel) -> None:
    # Light that hardly grazes a patch made it 1e13 of white, and all of a session's comparison with it.
    ((pair, light),) = scene_model.measured.items()
    there = tuple(np.argwhere(light.direct_gain > 0)[1000])
    gain = light.direct_gain.copy()
    gain[there] *= 1e6
    odd = replace(scene_model, measured={pair: replace(light, direct_gain=gain)})
    assert np.isnan(odd.seen_reflectance.reshape(gain.shape)[there])
    global_, as_it_was = light_of_white(odd)[1][there], light_of_white(scene_model)[1][there]
    assert global_ == pytest.approx(as_it_was, rel=0.2)


def test_illumination_falls_from_the_axis(scene_model: SceneModel) -> None:
    device = PosedLens(scene_model.camera.lens, scene_model.camera.pose, (-0.2, 0.0))
    axis = np.array([device.lens.principal_point_px])
    corner = np.array([[0.0, 0.0]])
    assert device.illumination(axis)[0] == 1.0
    assert device.illumination(corner)[0] == pytest.approx(1 - 0.2 * device.radius(corner)[0] ** 2)


def test_samples_next_to_missing_pixels_are_missing() -> None:
    image = np.ones((4, 4))
    image[1, 1] = 0
    values = sample(image, np.array([[2.5, 2.5], [0.5, 0.5], [9.0, 1.0]]))
    assert values[0] == 1.0
    assert np.isnan(values[1:]).all()


def with_blur(scene_model: SceneModel, own_px2: float, seen_px2: float) -> SceneModel:
    """The same with a projector whose lens has one variance, of which the camera sees another."""
    ((pair, light),) = scene_model.measured.items()
    ((name, projector),) = scene_model.projectors.items()
    variance = np.full((*light.direct_gain.shape, 2), seen_px2)
    own = np.full(scene_model.projector.lens.shape, own_px2)
    return replace(
        scene_model,
        measured={pair: replace(light, variance_px2=variance)},
        projectors={name: replace(projector, blur_variance_px2=own)},
    )


def test_on_the_wall_there_is_the_projectors_blur_and_the_cameras_in_its_picture(scene_model: SceneModel) -> None:
    blurred = with_blur(scene_model, own_px2=0.4, seen_px2=1.5)
    on_wall, in_camera = projector_view(blurred, blurred.active).blur, camera_view(blurred, blurred.active).blur
    assert on_wall is not None
    assert in_camera is not None
    assert on_wall.variance_px2 == pytest.approx(0.4)
    assert in_camera.variance_px2 == pytest.approx(1.5 - 1 / 12)


def test_a_sharp_picture_through_the_camera_is_as_blurred_as_the_camera_alone(scene_model: SceneModel) -> None:
    room = ColouredRoom((with_blur(scene_model, own_px2=0.4, seen_px2=1.5),), np.eye(1))
    point = np.zeros((int(room.active.sum()), 1))
    middle = np.flatnonzero(np.flatnonzero(room.active) == 96 * 256 + 128)
    point[middle] = 1.0
    seen = np.zeros(room.active.size)
    seen[room.active] = room.through_camera(point)[:, 0]
    x = np.arange(256) - 128
    assert (seen.reshape(192, 256).sum(axis=0) * x**2).sum() == pytest.approx(1.1 - 1 / 12, rel=0.02)


def test_without_a_known_blur_a_picture_is_seen_as_it_is(scene_model: SceneModel) -> None:
    room = ColouredRoom((scene_model,), np.eye(1))
    picture = np.random.default_rng(5).uniform(size=(int(room.active.sum()), 1))
    assert np.array_equal(room.through_camera(picture), picture)
    assert projector_view(scene_model, scene_model.active).blur is None


@pytest.fixture(scope="module")
def bare(scene_model: SceneModel) -> BareRoom:
    return BareRoom(
        scene=scene_model.scene,
        camera=scene_model.camera,
        projector=scene_model.projector,
        camera_hits=scene_model.camera_hits,
        alike=Alike.only_walls(6),
    )


BLURRED = slice(150, 154)
"""Columns of the camera beside a border of the projector's picture ..."""
WHITE_SHARE = np.array([0.97, 0.9, 0.7, 0.4])
"""... and how much of white they see."""


def test_blur_at_the_pictures_border_takes_no_direct_light_from_what_lies_beside(bare: BareRoom) -> None:
    shape = bare.camera.lens.shape
    direct = 0.5 + 0.2 * np.linspace(-1, 1, shape[1]) * np.ones(shape)
    global_, border = 0.3 * direct, np.ones(shape, dtype=np.float32)
    border[:, BLURRED] = WHITE_SHARE
    lit = np.zeros(shape, dtype=bool)
    lit[:, : BLURRED.stop] = True
    seen = BandLight(*(each.astype(np.float32) for each in (border * direct, global_, border * direct + global_)))
    gain = direct_gain(seen, lit, bare.camera_hits, border)
    assert np.abs(gain / direct - 1)[lit].max() < 0.002


def test_pixels_beside_the_pictures_border_tell_no_reflectance(bare: BareRoom) -> None:
    shape = bare.camera.lens.shape
    border, lit = np.ones(shape, dtype=np.float32), np.ones(shape, dtype=bool)
    border[:, BLURRED] = WHITE_SHARE
    there = project(bare.projector.lens, bare.projector.pose, bare.camera_hits.points_m).reshape(*shape, 2)
    lit &= np.isfinite(there).all(axis=-1)
    telling = pixels_that_tell(bare, lit, there.astype(np.float32), border)
    assert not telling[:, BLURRED].any()
    assert telling[lit & (border == 1)].mean() > 0.8
