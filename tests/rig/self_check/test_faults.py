"""Every fault of the camera that `rig check` promises to find, planted; of the projector, what a view shows."""

from __future__ import annotations

import re
from dataclasses import replace

import cv2
import numpy as np
import pytest

from rig.capture.rig import Rig
from rig.devices.drivers import make_devices
from rig.devices.protocols import Codes, RawFrame, Shown
from rig.self_check.compression import is_compressed
from rig.self_check.parts.exposure import with_generous_latency
from rig.self_check.run import check_rig
from rig.terminal import silent
from tests.rig.self_check.rig_with_faults import (
    REFRESH_S,
    Checked,
    Through,
    profile_of,
)

# Faults of the camera


class SlowForNewPictures(Through):
    """A display that says too early that a picture is there, unless it is of one brightness, as a latency's are."""

    EARLY_S = 0.15

    def show(self, codes: Codes, *, name: str) -> Shown:
        shown = self._inner.show(codes, name=name)
        return shown if codes.min() == codes.max() else Shown(shown.on_screen_s - self.EARLY_S, name)


def test_a_display_that_is_slower_for_new_pictures_is_given_the_latency_that_these_need() -> None:
    profile = profile_of()
    made = make_devices(profile)
    slow = SlowForNewPictures(made.projector)
    with Rig(with_generous_latency(profile), made.camera, slow, made.clock) as rig:
        rig.set_exposure(profile.camera.exposure_s)
        result = check_rig(rig, profile, silent, ("latency", "linearity", "view"))
    latency = result.parts["latency"]
    needed = next(row for row in latency.verdicts if row.what.startswith("latency that pictures need"))
    assert not needed.met
    assert needed.value > SlowForNewPictures.EARLY_S
    assert latency.suggested["projector.latency_s"] == pytest.approx(needed.value, abs=1e-4)
    assert result.parts["view"].numbers is not None


def test_stale_frames_are_counted() -> None:
    checked = Checked(("stale_frame_rate = 0.02", "stale_frame_rate = 0.15"), only=["exposure", "linearity", "noise"])
    refused = checked.row("frames refused")
    assert refused.value == pytest.approx(15, abs=7)
    assert checked.failed == {"frames"}


def test_copies_with_a_new_number_and_time_are_found() -> None:
    checked = Checked(("stale_frame_rate = 0.02", "duplicate_frame_rate = 0.15"), only=["pipeline"])
    assert checked.row("frames that are copies").value == pytest.approx(15, abs=10)
    assert "pipeline" in checked.failed


def test_a_part_that_cannot_be_measured_fails_alone_and_says_why() -> None:
    fixed = ("exposure_range_s = [1.0e-4, 2.0]", "exposure_range_s = [0.01666, 0.01667]")
    checked = Checked(fixed, only=["latency", "exposure", "linearity", "darkness"])
    assert checked.failed == {"linearity"}
    assert "different exposures" in checked.row("linearity could not be measured").advice
    assert checked.numbers("latency")["max"] == pytest.approx(max(checked.projector.delays_s), abs=REFRESH_S / 4)


def test_lost_frames_are_counted() -> None:
    checked = Checked(("stale_frame_rate = 0.02", "dropped_frame_rate = 0.2"), only=["pipeline"])
    assert not checked.row("frames lost").met


def test_half_frames_do_not_stop_the_check() -> None:
    checked = Checked(("stale_frame_rate = 0.02", "short_frame_rate = 0.1"), only=["latency", "pipeline", "stability"])
    assert checked.numbers("frames")["malformed"] > 5
    assert checked.numbers("latency")["max"] == pytest.approx(max(checked.projector.delays_s), abs=1e-3)
    assert checked.failed == {"frames"}


def test_the_depth_of_the_pipeline_is_that_of_the_simulated_world() -> None:
    checked = Checked(("stale_frame_rate = 0.02", "exposure_delay_frames = 3"), only=["pipeline"])
    assert checked.numbers("pipeline")["depth_frames"] == [3, 3, 3, 3]
    assert checked.row("frames that claim").value == 0


def test_frames_that_claim_an_exposure_that_they_do_not_have_are_found() -> None:
    class Lying(Through):
        wanted_s = 0.0

        def set_exposure(self, exposure_s: float) -> float:
            self.wanted_s = self._inner.set_exposure(exposure_s)
            return self.wanted_s

        def capture(self, *, after_s: float, timeout_s: float) -> RawFrame:
            frame: RawFrame = self._inner.capture(after_s=after_s, timeout_s=timeout_s)
            return replace(frame, exposure_s=self.wanted_s)

    profile = profile_of(("stale_frame_rate = 0.02", "exposure_delay_frames = 2"))
    made = make_devices(profile)
    with Rig(with_generous_latency(profile), Lying(made.camera), made.projector, made.clock) as rig:
        result = check_rig(rig, profile, silent, ["pipeline"])
    rows = {row.what: row for _, row in result.rows}
    assert rows["frames that claim the new exposure and show the old"].value == 8
    assert not result.within_limits


def test_a_strong_curve_is_found_and_does_not_spoil_the_photon_transfer() -> None:
    checked = Checked(("compression = 0.08", "compression = 0.5"), only=["linearity", "noise"])
    numbers, noise = checked.numbers("linearity"), checked.numbers("noise")
    assert checked.failed == set()
    y = numbers["exposures_s"] / np.max(numbers["exposures_s"]) * linear_share(max(numbers["signals_dn"]) / 4031, 0.5)
    expected = 4031 * y * 1.5 / (1 + 0.5 * y)
    assert numbers["signals_dn"] == pytest.approx(expected, rel=0.01)
    line = np.polyval(np.polyfit(y, expected, 1), y)
    assert checked.row("nonlinearity: residual").value == pytest.approx(
        100 * np.abs(expected - line).max() / max(expected), rel=0.05
    )
    assert checked.row("nonlinearity that the camera's curve leaves").value < 0.5
    assert noise["gain_e_per_dn"] == pytest.approx(32000 / 4031, rel=0.03)
    assert noise["read_noise_e"] == pytest.approx(6.0, rel=0.05)
    assert noise["full_well_e"] == pytest.approx(32000, rel=0.05)


FLAT = (
    (
        "position_m = [0.60, 1.42, 1.38]\nlook_at_m = [4.60, 4.55, 1.12]",
        "position_m = [2.0, 3.9, 1.2]\nlook_at_m = [2.2, 4.8, 1.2]",
    ),
    (
        "position_m = [1.00, 1.00, 1.20]\nlook_at_m = [4.80, 4.72, 1.20]",
        "position_m = [2.5, 3.9, 1.2]\nlook_at_m = [2.4, 4.8, 1.2]",
    ),
)


def test_a_flat_wall_is_named_as_a_session_names_it() -> None:
    checked = Checked(*FLAT, only=["view"])
    assert checked.failed == {"view"}
    row = checked.row("walls that are told apart")
    assert (row.value, row.met) == (0, False)
    assert re.search("plane|parallax", row.advice)
    assert checked.row("lit pixels that have a projector pixel").met


def test_a_projector_set_for_rear_projection_is_named() -> None:
    checked = Checked(only=["view"], codes=lambda codes: np.ascontiguousarray(codes[:, ::-1]))
    assert not checked.row("walls that are told apart").met
    assert "one of the pictures is mirrored" in checked.row("walls that are told apart").advice


def test_a_projector_out_of_focus_is_seen_before_a_session() -> None:
    checked = Checked(("blur_px = 0.5", "blur_px = 3.0"), only=["view"])
    assert not checked.row("sharpness").met
    assert "focus" in checked.row("sharpness").advice
    assert checked.row("lit pixels that have a projector pixel").met  # by wider stripes, as in a session
    assert "focus the projector" in checked.row("stripes of the code, wider than usual").advice


WHITE_OF_HALVES = "superposition: white against pictures and their inverses together"


def test_a_projector_that_dims_bright_pictures_is_named_before_a_session() -> None:
    def dimmed(codes: Codes) -> Codes:
        """White by about 5 % of its light, others by as much less as they are darker."""
        light = (codes / 255) ** 2.2
        return np.asarray(np.rint(255 * (light * (1 - 0.05 * light.mean())) ** (1 / 2.2)), dtype=np.uint8)

    row = Checked(only=["view"], codes=dimmed).row(WHITE_OF_HALVES)
    assert not row.met
    assert 1.5 < row.value < 3  # 0.975 of each of two halves, 0.95 of the whole, and no gamma is quite 2.2
    assert "dims bright pictures" in row.advice


def test_light_that_adds_up_is_said_to() -> None:
    assert Checked(only=["view"]).row(WHITE_OF_HALVES).value < 0.5


def test_a_camera_that_sharpens_its_pictures_is_named_before_a_session_is_biased_by_it() -> None:
    def sharpened(frame: RawFrame) -> RawFrame:
        picture = frame.pixels.astype(np.float32)
        soft = cv2.GaussianBlur(picture, (0, 0), 1.2).reshape(picture.shape)
        return replace(frame, pixels=np.clip(np.rint(1.6 * picture - 0.6 * soft), 0, 4095).astype(np.uint16))

    what = "sharpening: light beside the edges of checks"
    row = Checked(only=["view"], pixels=sharpened).row(what)
    assert not row.met
    assert "set its sharpness" in row.advice
    assert Checked(only=["view"]).row(what).met


@pytest.mark.parametrize(("tone", "gamma"), [('"srgb"', 2.0), ("2.2", 2.2)])
def test_a_webcam_with_a_tone_curve_passes_and_its_sensor_is_seen_through_it(tone: str, gamma: float) -> None:
    checked = Checked(
        ("channels = 1\nbit_depth = 12", "channels = 1\nbit_depth = 8"),
        ("black_level_dn = 64.0", "black_level_dn = 5.0"),
        ("compression = 0.08", f"compression = 0.0\ntone = {tone}"),
        only=["exposure", "linearity", "noise", "darkness", "additivity", "ramp"],
    )
    assert checked.failed == set()
    assert checked.row("gamma of the camera's curve").value == pytest.approx(gamma, abs=0.03)
    noise = checked.numbers("noise")
    assert noise["full_well_e"] == pytest.approx(32000, rel=0.02)
    assert abs(noise["read_noise_e"] - 6.0) < 2 * noise["read_noise_95_percent_e"]
    assert noise["read_noise_95_percent_e"] < 12
    assert checked.row("photon transfer off a straight line").value < 2
    assert checked.numbers("darkness")["share"] < 0.01


def test_a_curve_that_moves_with_the_picture_is_named() -> None:
    def mapped(frame: RawFrame) -> RawFrame:
        share = np.clip((frame.pixels - 64.0) / 4031, 0, 1)
        gamma = 1 + 2 * share.mean()
        return replace(frame, pixels=np.rint(64 + 4031 * share ** (1 / gamma)).astype(np.uint16))

    checked = Checked(only=["linearity"], pixels=mapped)
    assert checked.failed == {"linearity"}
    row = checked.row("nonlinearity that the camera's curve leaves")
    assert not row.met
    assert "auto tone mapping" in row.advice


def linear_share(share: float, compression: float) -> float:
    return share / (1 + compression - compression * share)


@pytest.mark.parametrize(
    ("bit_depth", "full_well_e", "read_noise_e", "black_dn"),
    [(12, 9000, 15.0, 64), (8, 9000, 30.0, 6), (10, 15000, 12, 40)],
)
def test_photon_transfer_of_other_sensors(
    bit_depth: int, full_well_e: float, read_noise_e: float, black_dn: float
) -> None:
    checked = Checked(
        ("channels = 1\nbit_depth = 12", f"channels = 1\nbit_depth = {bit_depth}"),
        ("full_well_e = 32000.0", f"full_well_e = {full_well_e}"),
        ("read_noise_e = 6.0", f"read_noise_e = {read_noise_e}"),
        ("black_level_dn = 64.0", f"black_level_dn = {black_dn}"),
        only=["noise"],
    )
    noise = checked.numbers("noise")
    assert noise["gain_e_per_dn"] == pytest.approx(full_well_e / (2**bit_depth - 1 - black_dn), rel=0.03)
    assert noise["read_noise_e"] == pytest.approx(read_noise_e, rel=0.05)
    assert noise["full_well_e"] == pytest.approx(full_well_e, rel=0.05)


def test_a_dark_level_of_zero_is_named_and_no_read_noise_is_suggested() -> None:
    checked = Checked(("black_level_dn = 64.0", "black_level_dn = 0.0"), only=["noise"])
    row = checked.row("dark pixels at 0")
    assert not row.met
    assert "raise the camera's black level" in row.advice
    assert "camera.read_noise_e" not in checked.result.suggested
    assert checked.numbers("noise")["gain_e_per_dn"] == pytest.approx(32000 / 4095, rel=0.03)


def test_a_camera_that_clips_below_full_scale_and_skips_numbers_is_found() -> None:
    def limit(frame: RawFrame) -> RawFrame:
        return replace(frame, pixels=np.minimum(frame.pixels // 4 * 4, 3760).astype(np.uint16))

    checked = Checked(only=["saturation"], pixels=limit)
    assert checked.numbers("saturation") == {"clip_dn": 3760, "step_dn": 4}
    assert [row.met for _, row in checked.result.rows[:2]] == [False, False]
    assert "16 to 235" in checked.row("level at which").advice


def test_hot_and_dead_pixels_are_counted_and_placed() -> None:
    random = np.random.default_rng(3)
    hot = {(int(y), int(x)) for y, x in zip(random.integers(5, 235, 120), random.integers(5, 315, 120), strict=True)}
    dead = {(50 + 20 * k, 40 + 20 * j) for k in range(3) for j in range(3)}

    def plant(frame: RawFrame) -> RawFrame:
        pixels = frame.pixels.copy()
        for y, x in hot:
            pixels[y, x] = np.minimum(pixels[y, x] + 200, 4095)
        for y, x in dead:
            pixels[y, x] = 64
        return replace(frame, pixels=pixels)

    checked = Checked(only=["pixels"], pixels=plant)
    numbers = checked.numbers("pixels")
    assert {tuple(place) for place in numbers["dead_yx"]} == dead
    assert numbers["hot"] == len(hot - dead)
    assert {tuple(place) for place in numbers["hot_yx"]} <= hot
    assert not checked.row("hot pixels").met


@pytest.mark.parametrize("quality", [75, 95])
def test_noise_of_compressed_pictures_is_none_of_the_sensors_and_suggested_to_no_profile(
    quality: int,
) -> None:
    checked = Checked(
        ("channels = 1\nbit_depth = 12", "channels = 1\nbit_depth = 8"),
        ("black_level_dn = 64.0", f"black_level_dn = 6.0\njpeg_quality = {quality}"),
        only=["noise", "checker"],
    )
    row = checked.row("photon transfer off a straight line")
    assert row.value is None
    assert "the frames are JPEG" in row.advice
    assert "raw format" in row.advice
    assert checked.failed == set()
    assert not {"camera.full_well_e", "camera.read_noise_e"} & set(checked.result.suggested)


def test_noise_that_is_smoothed_without_blocks_is_off_its_line_and_no_jpeg() -> None:
    def smoothed(frame: RawFrame) -> RawFrame:
        light = frame.pixels.astype(np.float32)
        return replace(frame, pixels=cv2.bilateralFilter(light[..., 0], 5, 40.0, 2.0)[..., None].astype(np.uint16))

    row = Checked(only=["noise"], pixels=smoothed).row("photon transfer off a straight line")
    assert not row.met
    assert "noise reduction" in row.advice


@pytest.mark.parametrize("crop", [0, 3])
@pytest.mark.parametrize(("quality", "noise_dn"), [(95, 0.7), (85, 2.0), (70, 4.0)])
def test_blocks_are_found_wherever_they_begin_and_in_compressed_frames_only(
    crop: int, quality: int, noise_dn: float
) -> None:
    draw = np.random.default_rng(crop)
    slope = np.linspace(40, 200, 200)[None] + np.linspace(0, 30, 160)[:, None]
    frames = [np.clip(slope + draw.normal(0, noise_dn, slope.shape), 0, 255).astype(np.uint8) for _ in range(2)]
    coded = [cv2.imdecode(cv2.imencode(".jpg", one, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], 0) for one in frames]
    raw, jpeg = ([one[crop:, crop:].astype(np.float64) for one in pair] for pair in (frames, coded))
    assert not is_compressed(*raw)
    assert is_compressed(*jpeg)
    assert not is_compressed(raw[0], raw[0])
