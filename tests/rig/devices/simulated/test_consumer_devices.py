"""What simulated webcams and lamps do that scientific sensors and lasers do not: tone curves, soft corners, warm-up."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from rig.devices.simulated.devices import sensor_response, through_jpeg, toned
from rig.devices.simulated.optics import blurred, haloed, make_optics
from rig.devices.simulated.settings import SimulatedCameraSettings, SimulatedLensSettings, SimulationSettings
from rig.devices.simulated.world import SimulatedWorld
from rig.errors import ProfileError
from rig.profile.schema import Profile

PROFILE = Path(__file__).parents[4] / "hw_profiles" / "ci-tiny.toml"
SHAPE = (120, 160)
LENS = SimulatedLensSettings(
    name="camera", position_m=(0, 0, 0), look_at_m=(1, 0, 0), focal_px=100, principal_point_px=(79.5, 59.5)
)


def settings_with(
    camera: dict[str, object] | None = None, projector: dict[str, object] | None = None
) -> SimulationSettings:
    table = tomllib.loads(PROFILE.read_text())["simulation"]
    table["camera"][0] |= camera or {}
    table["projector"][0] |= projector or {}
    return SimulationSettings.model_validate(table | {"cell_size_m": 0.8})


def levels_of(camera: SimulatedCameraSettings, light: np.ndarray, noise: float = 0.0) -> np.ndarray:
    """Digital numbers of light given as shares of the full well; compression is off."""
    straight = camera.model_copy(update={"compression": 0.0})
    seen = (light * camera.full_well_e / camera.sensitivity_e_per_s).astype(np.float32)
    return sensor_response(straight, seen, 1.0, 255, noise=np.full(light.shape, noise, np.float32))


@pytest.mark.parametrize(("tone", "expected"), [("linear", 0.5), ("srgb", 0.7354), (2.2, 0.7297), (0.5, 0.25)])
def test_half_of_full_scale_is_where_the_standards_put_it(tone: str | float, expected: float) -> None:
    assert toned(np.array([0.5], np.float32), tone)[0] == pytest.approx(expected, abs=1e-4)


def test_an_s_curve_darkens_what_is_dark_and_brightens_what_is_bright() -> None:
    levels = toned(np.array([0.1, 0.5, 0.9], np.float32), "linear", 0.4)
    assert levels == pytest.approx([0.0712, 0.5, 0.9288], abs=1e-4)


@pytest.mark.parametrize("s_shape", [0.0, 0.6])
@pytest.mark.parametrize("tone", ["linear", "srgb", 1.8, 2.4, 0.4])
def test_a_tone_curve_keeps_black_and_white_and_rises(tone: str | float, s_shape: float) -> None:
    camera = settings_with({"tone": tone, "s_shape": s_shape, "black_level_dn": 5.0}).camera
    levels = levels_of(camera, np.linspace(0, 1.2, 500))
    assert (levels[0], levels[-1]) == (5, 255)
    assert (np.diff(levels.astype(int)) >= 0).all()


def test_a_camera_with_a_tone_curve_cuts_off_noise_below_black_and_a_straight_one_does_not() -> None:
    dark = np.zeros(10)
    noisy: dict[str, object] = {"black_level_dn": 20.0, "read_noise_e": 600.0}
    assert (levels_of(settings_with(noisy | {"tone": "srgb"}).camera, dark, noise=-1.0) == 20).all()
    assert (levels_of(settings_with(noisy).camera, dark, noise=-1.0) < 20).all()


@pytest.mark.parametrize("tone", ["rec709", 0.1, 9.0])
def test_a_tone_that_no_camera_has_is_refused(tone: str | float) -> None:
    with pytest.raises(ValidationError, match="tone"):
        settings_with({"tone": tone})


def edge_width_px(lens: SimulatedLensSettings, column: int) -> float:
    """Standard deviation of the blur of a vertical edge near a column, in the middle row."""
    step = np.zeros(SHAPE, np.float32)
    step[:, column:] = 1
    line = np.diff(blurred(make_optics(lens, SHAPE), step)[SHAPE[0] // 2].astype(float))
    place = np.arange(line.size)
    mean = np.average(place, weights=line)
    return float(np.sqrt(np.average((place - mean) ** 2, weights=line)))


def test_blur_grows_from_the_axis_to_the_corners() -> None:
    lens = LENS.model_copy(update={"blur_px": 1.0, "corner_blur_px": 3.0})
    assert edge_width_px(lens, 80) == pytest.approx(1.0, rel=0.05)
    assert edge_width_px(lens, 150) == pytest.approx(1 + 2 * (70.5 / 100) ** 2, rel=0.1)
    even = lens.model_copy(update={"corner_blur_px": None})
    assert edge_width_px(even, 150) == pytest.approx(1.0, rel=0.05)


def test_a_halo_takes_its_share_to_half_of_which_its_radius_reaches() -> None:
    lens = LENS.model_copy(update={"halo": 0.1, "halo_px": 8.0})
    point = np.zeros((401, 401), dtype=np.float32)
    point[200, 200] = 1.0
    light = haloed(make_optics(lens, point.shape), point).astype(float)
    y, x = np.indices(point.shape) - 200
    inside = light[np.hypot(y, x) <= 8.0].sum()
    assert light.max() == pytest.approx(0.9, abs=0.003)
    assert inside == pytest.approx(0.95, abs=0.002)
    assert 0.995 < light.sum() <= 1.0, "some leaves the picture, and none is made"
    assert haloed(make_optics(LENS, point.shape), point) is point


def test_a_halo_of_either_device_lights_what_a_black_square_hides() -> None:
    seen, shape = (240, 320), (192, 256)
    codes = np.full(shape, 255, dtype=np.uint8)
    codes[48:144, 64:192] = 0
    plain = SimulatedWorld(settings_with(), seen, shape)
    hazy = SimulatedWorld(settings_with(projector={"halo": 0.1, "halo_px": 4.0}), seen, shape)
    misty = SimulatedWorld(settings_with(camera={"halo": 0.1, "halo_px": 4.0}), seen, shape)
    sharp, white = plain.light(codes), plain.light(np.full(shape, 255, dtype=np.uint8))
    dark = (white.direct > 0) & (sharp.direct < 0.1 * white.direct)
    assert dark.any()
    assert hazy.light(codes).direct[dark].mean() > 1.5 * sharp.direct[dark].mean()
    assert misty.through_lens(sharp.direct)[dark].mean() > 1.5 * plain.through_lens(sharp.direct)[dark].mean()


def test_a_lamp_is_darker_until_it_is_warm() -> None:
    settings = settings_with(projector={"lamp_drift": 0.2, "lamp_warm_up_s": 30.0})
    world = SimulatedWorld(settings, (24, 32), (24, 32))
    cold, later, warm = world.lamp(np.array([0.0, 30.0, 600.0]), 0.0)
    assert cold == pytest.approx(0.8)
    assert later == pytest.approx(1 - 0.2 / np.e)
    assert warm == pytest.approx(1.0, abs=1e-6)


def test_a_lamp_that_does_not_drift_shines_alike_at_all_times() -> None:
    world = SimulatedWorld(settings_with(), (24, 32), (24, 32))
    assert world.lamp(np.array([0.0, 1e4]), 0.1).tolist() == [1.0, 1.0]


@pytest.mark.parametrize("channels", [1, 3])
def test_jpeg_keeps_a_smooth_picture_and_spoils_a_noisy_one_more_the_lower_its_quality(channels: int) -> None:
    rows, columns = np.mgrid[0:64, 0:96]
    smooth = np.repeat((60 + rows + columns)[..., None], channels, axis=2).astype(np.uint16)
    noisy = smooth + np.random.default_rng(1).integers(0, 20, smooth.shape).astype(np.uint16)
    assert np.abs(through_jpeg(smooth, 90).astype(int) - smooth).max() <= 2
    errors = [np.std(through_jpeg(noisy, quality).astype(float) - noisy) for quality in (95, 85, 75)]
    assert errors == sorted(errors)
    assert errors[0] > 0.5


def test_jpeg_keeps_the_order_of_the_bands() -> None:
    red = np.zeros((16, 16, 3), np.uint16)
    red[..., 0] = 200
    assert through_jpeg(red, 95).reshape(-1, 3).mean(axis=0) == pytest.approx([200, 0, 0], abs=4)


def test_jpeg_of_a_camera_of_twelve_bits_is_refused() -> None:
    text = PROFILE.read_text("utf-8").replace("blur_px = 0.4\n", "blur_px = 0.4\njpeg_quality = 90\n", 1)
    with pytest.raises(ProfileError, match=r"jpeg_quality: the camera has bit_depth = 12; JPEG goes with 8"):
        Profile.parse(text.encode(), PROFILE)
