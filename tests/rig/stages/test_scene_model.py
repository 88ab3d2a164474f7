"""The twin: where calibration and simulation meet, against a bench that is neither."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.geometry.stereo import pinhole
from calibration.records import PinholeModel
from rig.devices.simulated.world import Bench
from rig.profile.schema import load_profile
from rig.stages.scene_model import (
    Optic,
    RoomTwin,
    box_scene,
    camera_view,
    look,
    optic,
    projector_view,
    sample,
    unit_emission,
)
from rig.truth.scores import _true_reflectance
from sim.form_factors import form_factors
from sim.geometry.optics import project, rays_at


def model_of(lens, rotation) -> PinholeModel:  # type: ignore[no-untyped-def]
    position = np.array(lens.position_m)
    width, height = (320, 240) if lens.principal_point_px[0] > 140 else (256, 192)
    return PinholeModel(
        width,
        height,
        (lens.focal_px, lens.focal_px),
        tuple(lens.principal_point_px),
        tuple(lens.distortion),
        rotation,
        -rotation @ position,
    )


@pytest.fixture(scope="module")
def bench() -> Bench:
    profile = load_profile("ci-tiny")
    assert profile.bench is not None
    return Bench(profile.bench, profile.camera.shape[:2], profile.projector.shape)


@pytest.fixture(scope="module")
def twin(bench: Bench) -> RoomTwin:
    """Built from the bench's true numbers; patches of 0.3 m instead of its cells, factors of another kind."""
    settings = bench.settings
    camera = optic(model_of(settings.camera, bench.camera.rotation), settings.camera.vignetting)
    projector = optic(model_of(settings.projector, bench.projector.rotation), settings.projector.vignetting)
    scene = box_scene(settings.size_m, tuple(settings.reflectance), 0.3, 0.5)

    class Holder:
        pass

    holder = Holder()
    holder.twin = Holder()  # type: ignore[attr-defined]
    holder.twin.scene = scene  # type: ignore[attr-defined]
    scene = scene.with_reflectance(_true_reflectance(bench, holder))  # type: ignore[arg-type]
    white = bench.light_of(np.ones(bench.projector.shape, np.float32))
    gain = (white.direct * bench.vignetting).astype(np.float64)
    seen = look(scene, camera)
    xy = project(projector.lens, projector.pose, seen.points_m)
    height, width = bench.projector.shape
    with np.errstate(invalid="ignore"):
        inside = (xy > 0).all(axis=1) & (xy < (width - 1, height - 1)).all(axis=1)
    gain[~inside.reshape(gain.shape)] = 0
    flux = settings.projector.flux / (height * width) * settings.projector.focal_px**2
    emission = unit_emission(scene, projector)
    xy = np.where(inside[:, None], xy, np.nan).reshape(*gain.shape, 2)
    return RoomTwin(
        scene, form_factors(scene), camera, projector, flux, emission, seen, look(scene, projector), gain, xy
    )


def test_the_two_pinholes_agree(twin: RoomTwin, bench: Bench) -> None:
    model = model_of(bench.settings.camera, bench.camera.rotation)
    pixels = np.array([[2.0, 3.0], [160.0, 120.0], [317.0, 236.0]])
    rays = pinhole.world_rays(model, pixels)
    np.testing.assert_allclose(rays, rays_at(twin.camera.lens, twin.camera.pose, pixels), atol=1e-7)
    points = model.position_m + 3.0 * rays
    np.testing.assert_allclose(pinhole.project(model, points), pixels, atol=1e-4)


def test_the_twin_sees_the_global_light_of_the_bench(twin: RoomTwin, bench: Bench) -> None:
    random = np.random.default_rng(4)
    picture = np.kron(random.uniform(size=(6, 8)), np.ones((32, 32))).astype(np.float32)
    picture *= twin.active.reshape(picture.shape)
    true = (bench.light_of(picture).global_ * bench.vignetting).ravel()
    found = camera_view(twin, twin.active).global_ @ picture.ravel()[twin.active].astype(np.float64)
    lit = twin.direct_gain.ravel() > 0
    assert np.median(found[lit] / true[lit]) == pytest.approx(1.0, abs=0.02)
    assert np.quantile(np.abs(found[lit] / true[lit] - 1), 0.9) < 0.03


def test_what_a_projector_pixel_sees_is_what_the_camera_sees_there(twin: RoomTwin) -> None:
    picture = np.full(int(twin.active.sum()), 0.5)
    at_pixels = np.full(twin.active.size, np.nan)
    at_pixels[twin.active] = projector_view(twin, twin.active) @ picture
    in_camera = (camera_view(twin, twin.active) @ picture).reshape(twin.camera.lens.shape)
    where = project(twin.camera.lens, twin.camera.pose, twin.projector_look.points_m)
    ratio = at_pixels / sample(in_camera, where)
    assert np.nanmedian(ratio) == pytest.approx(1.0, abs=0.01)
    assert np.nanquantile(np.abs(ratio - 1), 0.9) < 0.03


def test_both_views_have_true_adjoints(twin: RoomTwin) -> None:
    random = np.random.default_rng(8)
    for transport in (camera_view(twin, twin.active), projector_view(twin, twin.active)):
        x, y = random.uniform(size=transport.shape[1]), random.uniform(size=transport.shape[0])
        assert (transport @ x) @ y == pytest.approx(x @ (transport.T @ y), rel=1e-9)


def test_illumination_falls_from_the_axis(twin: RoomTwin) -> None:
    device = Optic(twin.camera.lens, twin.camera.pose, (-0.2, 0.0))
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
