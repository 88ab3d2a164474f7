"""The camera's view as it is now: what a small picture must not hide, and what the devices really do."""

import cv2
import numpy as np
import pytest

from rig.by_hand.preview import WIDTH_PX, Preview, PreviewSettings, Region, jpeg_of, noise_between, overlay_of
from rig.errors import SettingRefused, UsageError
from rig.profile.schema import Profile

FULL = 4095
CODES = (np.arange(FULL + 1) / 16).astype(np.uint8)


def marks_of(pixels: np.ndarray) -> np.ndarray:
    return cv2.imdecode(np.frombuffer(overlay_of(pixels, FULL), np.uint8), cv2.IMREAD_UNCHANGED)


@pytest.mark.parametrize("shape", [(240, 320, 1), (963, 1281, 1), (2000, 6000, 3)])
def test_no_clipped_pixel_is_lost_by_being_small(shape: tuple[int, int, int]) -> None:
    pixels = np.full(shape, 1000, np.uint16)
    for y, x in ((0, 0), (shape[0] - 1, shape[1] - 1), (shape[0] // 2, shape[1] // 3)):
        pixels[y, x, 0] = FULL
    assert (marks_of(pixels) == 255).sum() == 3


def test_a_place_is_black_when_all_of_it_is() -> None:
    pixels = np.zeros((960, 1280, 1), np.uint16)
    assert (marks_of(pixels) == 128).all()
    pixels[::4, ::4] = 1
    assert (marks_of(pixels) == 0).all()


@pytest.mark.parametrize("channels", [1, 3])
def test_a_frame_becomes_a_small_picture_of_the_same_colours(channels: int) -> None:
    pixels = np.full((960, 1280, channels), 800, np.uint16)
    pixels[..., 0] = 2400
    picture = cv2.imdecode(np.frombuffer(jpeg_of(pixels, CODES), np.uint8), cv2.IMREAD_UNCHANGED)
    assert picture.shape[:2] == (720, WIDTH_PX)
    assert picture[300, 300].max() == pytest.approx(150, abs=3)
    if channels == 3:
        assert picture[300, 300, 2] > picture[300, 300, 0] + 80  # red stays red


def test_a_region_stays_within_the_frame() -> None:
    for region in (Region(), Region(x=0, y=1, zoom=4), Region(x=9, y=-9, zoom=1e9), Region(x=0.5, y=0.5, zoom=0.1)):
        rows, columns = region.window((240, 320, 1))
        assert 0 <= rows.start < rows.stop <= 240
        assert 0 <= columns.start < columns.stop <= 320


def test_noise_between_two_frames_is_that_of_one() -> None:
    random = np.random.default_rng(1)
    first, second = (np.rint(random.normal(1000, 5, (480, 640, 1))).astype(np.uint16) for _ in range(2))
    assert noise_between(first, second) == pytest.approx(5, rel=0.05)


def test_a_view_tells_what_the_camera_does(tiny_profile: Profile) -> None:
    with Preview(tiny_profile, PreviewSettings(picture="white")) as preview:
        first = preview.next_frame()
        assert first.jpeg.startswith(b"\xff\xd8")
        preview.expose(0.0012345)
        assert preview.state.exposure_s == 0.00123  # the camera's steps are 10 microseconds
        with pytest.raises(SettingRefused):
            preview.expose(99.0)
        assert preview.state.exposure_s == 0.00123
        preview.amplify(6.04)
        assert preview.state.gain is not None
        assert (preview.state.gain.value, preview.state.gain.unit) == (6.0, "dB")  # its steps are 0.1 dB
        with pytest.raises(SettingRefused, match="outside"):
            preview.amplify(-1.0)
        preview.is_watched = False
        assert preview.next_frame().jpeg == b""
        with pytest.raises(UsageError):
            preview.show("no such picture")
        assert preview.state.picture == "white"
        seen = [preview.next_frame() for _ in range(20)]
    assert seen[-1].facts.number == preview.frames
    assert any(one.facts.figures is not None for one in seen)
