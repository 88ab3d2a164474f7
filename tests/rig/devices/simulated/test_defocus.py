"""Blur that changes with depth: its width is what the lens's opening and focus say, in boxes and in meshes."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from rig.devices.simulated.defocus import DiscLevels, circle_px, defocused, disc_kernel, looked_up
from rig.devices.simulated.optics import SimulatedOptics, make_optics
from rig.devices.simulated.settings import SimulatedLensSettings, SimulationSettings
from rig.devices.simulated.world import SimulatedWorld
from tests.rig.devices.simulated.mesh.scenes_of_tests import settings_of, walls

SHAPE = (60, 80)


def optics(aperture_m: float = 0.02, focus_m: float | None = 2.0) -> SimulatedOptics:
    lens = SimulatedLensSettings(
        name="lens",
        position_m=(0, 0, 0),
        look_at_m=(0, 1, 0),
        focal_px=1000.0,
        principal_point_px=(39.5, 29.5),
        aperture_m=aperture_m,
        focus_m=focus_m,
    )
    return make_optics(lens, SHAPE)


def second_moment(light: np.ndarray) -> float:
    """Variance along x."""
    x = np.arange(light.shape[1]) - light.shape[1] / 2 + 0.5
    weight = light.sum(axis=0) / light.sum()
    return float((weight * x**2).sum() - (weight * x).sum() ** 2)


def test_the_disc_is_as_wide_as_rays_through_the_openings_rim_say() -> None:
    """Rays from a point at 3 m through both sides of the lens meet the plane in focus some way apart."""
    lens, depth_m, focus_m, aperture_m = optics(), 3.0, 2.0, 0.02
    apart_m = aperture_m * (1 - focus_m / depth_m)  # similar triangles with the point as apex
    assert circle_px(lens, np.array([depth_m]))[0] == pytest.approx(apart_m / focus_m * 1000.0)
    assert circle_px(lens, np.array([focus_m]))[0] == pytest.approx(0, abs=1e-9)
    assert circle_px(optics(0.0, None), np.array([1.0]))[0] == 0


@pytest.mark.parametrize("diameter_px", [0.0, 0.7, 3.0, 8.3])
def test_a_disc_keeps_light_and_has_a_discs_variance(diameter_px: float) -> None:
    kernel = disc_kernel(diameter_px)
    assert kernel.sum() == pytest.approx(1, abs=1e-6)
    if diameter_px >= 3:
        # An even disc has D²/16 along each axis, sampling in pixels adds 1/12.
        assert second_moment(kernel) == pytest.approx(diameter_px**2 / 16 + 1 / 12, rel=0.12)


def test_a_mixture_of_two_discs_has_the_variance_of_the_one_between() -> None:
    wanted = np.array([2.0, 3.1, 4.4, 5.2, 9.0])
    levels = DiscLevels.of(wanted)
    mixed = [
        sum(float(levels.weight(k)[i]) * levels.diameters_px[k] ** 2 for k in range(len(levels.diameters_px)))
        for i in range(len(wanted))
    ]
    np.testing.assert_allclose(mixed, wanted**2, rtol=1e-5)


def test_a_camera_out_of_focus_spreads_a_point_over_its_disc_and_keeps_its_light() -> None:
    light = np.zeros(SHAPE, np.float32)
    light[30, 40] = 5.0
    depth = np.full(SHAPE, 2.0)
    depth[30, 40] = 4.0  # a near neighbour in focus does not change where the point's light goes
    soft = defocused(optics(), light, depth)
    diameter = float(circle_px(optics(), np.array([4.0]))[0])
    assert diameter == pytest.approx(5.0)
    assert soft.sum() == pytest.approx(5.0, rel=1e-5)
    moved = np.roll(soft, (0, -1), axis=(0, 1))[:, :79]
    assert second_moment(moved) == pytest.approx(diameter**2 / 16 + 1 / 12, rel=0.05)


def test_a_projector_is_sharp_where_it_is_in_focus_only() -> None:
    picture = np.zeros((40, 60), np.float32)
    picture[:, 30:] = 1.0
    x = np.tile(np.arange(20, 40, 0.5, dtype=np.float32), (2, 1))
    y = np.full_like(x, 20.0)
    circles = np.array([[0.0], [8.0]]) * np.ones_like(x)
    near, far = looked_up(picture, (x, y), DiscLevels.of(circles))
    assert np.ptp(x[0][(near > 0.05) & (near < 0.95)]) <= 1.0
    assert np.ptp(x[0][(far > 0.05) & (far < 0.95)]) == pytest.approx(8 * 0.8, abs=1.0)


def test_aperture_and_focus_belong_together() -> None:
    with pytest.raises(ValidationError, match="aperture_m and focus_m belong together"):
        optics(0.02, None)


def test_a_world_of_triangles_blurs_what_is_not_in_focus() -> None:
    pytest.importorskip("embreex")
    from rig.devices.simulated.mesh.world import MeshWorld, exchange_of
    from tests.rig.devices.simulated.mesh.scenes_of_tests import CAMERA, PROJECTOR, scene_of

    stripes = np.zeros(PROJECTOR, np.float32)
    stripes[:, ::4] = stripes[:, 1::4] = 1
    contrast = {}
    for name, lens in (("sharp", {}), ("soft", {"aperture_m": 0.25, "focus_m": 0.7})):
        settings = settings_of(rays=32, projector=lens)
        world = MeshWorld(settings, exchange_of(scene_of(walls()), settings), CAMERA, PROJECTOR)
        light = world.light_of(stripes)
        contrast[name] = float(np.std(np.diff(light.direct, axis=1)))
        mean = light.direct.mean()
    assert contrast["soft"] < 0.5 * contrast["sharp"]
    assert mean > 0


def test_a_box_blurs_what_is_not_in_focus_and_keeps_its_light() -> None:
    table = settings_of().model_dump(by_alias=True) | {
        "scene": None,
        "size_m": (3.0, 3.0, 2.4),
        "reflectance": dict.fromkeys(("floor", "ceiling", "x0", "x1", "y0", "y1"), 0.5),
        "cell_size_m": 0.6,
    }
    sharp = SimulationSettings.model_validate(table)
    lens = {"aperture_m": 0.25, "focus_m": 0.7}
    soft = sharp.with_device(sharp.projector.model_copy(update=lens)).with_device(sharp.camera.model_copy(update=lens))
    stripes = np.zeros((36, 48), np.float32)
    stripes[:, ::4] = stripes[:, 1::4] = 1
    worlds = [SimulatedWorld(settings, (48, 64), (36, 48)) for settings in (sharp, soft)]
    light = [world.light_of(stripes).direct for world in worlds]
    assert np.std(np.diff(light[1], axis=1)) < 0.5 * np.std(np.diff(light[0], axis=1))
    middle = (slice(12, 36), slice(16, 48))
    assert light[1][middle].mean() == pytest.approx(light[0][middle].mean(), rel=0.05)
    seen = [world.through_lens(light[0]) for world in worlds]
    assert np.std(np.diff(seen[1][middle], axis=1)) < 0.5 * np.std(np.diff(seen[0][middle], axis=1))
