"""When frames are taken to show a new exposure."""

import numpy as np
import pytest

from rig.devices.v4l2.settling import UNMEASURED_FRAMES, Settling

FULL = 255


def frames(level_dn: float, *, noise_dn: float = 1.0, seed: int = 1) -> np.ndarray:
    random = np.random.default_rng(seed)
    scene = np.linspace(0.5, 1.5, 64 * 64).reshape(64, 64, 1)
    return np.clip(scene * level_dn + random.normal(0, noise_dn, scene.shape), 0, FULL).astype(np.uint16)


def settle(before_dn: float, levels_dn: list[float], ratio: float) -> int | None:
    """After how many frames it is settled."""
    settling = Settling(before=frames(before_dn), ratio=ratio, full_scale_dn=FULL)
    for count, level_dn in enumerate(levels_dn, 1):
        if settling.add(frames(level_dn, seed=count)):
            return count
    return None


@pytest.mark.parametrize("delay", [0, 1, 3, 7])
@pytest.mark.parametrize("ratio", [0.25, 0.5, 1.5, 2.0, 8.0])
def test_old_frames_are_waited_out_however_many(delay: int, ratio: float) -> None:
    assert settle(60, [60] * delay + [60 * ratio] * 4, ratio) == delay + 2


def test_a_frame_between_the_two_exposures_is_not_taken() -> None:
    assert settle(40, [40, 60, 80, 80], 2.0) == 4


def test_a_camera_that_does_not_follow_is_never_settled() -> None:
    assert settle(60, [60] * 50, 2.0) is None
    assert settle(60, [30] * 50, 2.0) is None


def test_light_that_changes_all_the_time_is_never_settled() -> None:
    assert settle(60, [100, 120] * 20, 2.0) is None


def test_a_response_curve_may_bend_the_change() -> None:
    assert settle(100, [100, *[100 * 2 ** (1 / 2.2)] * 3], 2.0) == 3


def test_saturated_pixels_say_nothing() -> None:
    before = frames(60)
    before[:, :48] = FULL
    settling = Settling(before=before, ratio=0.5, full_scale_dn=FULL)
    stale = before.copy()
    assert [settling.add(stale) for _ in range(5)] == [False] * 5
    fresh = before // 2
    assert [settling.add(fresh) for _ in range(2)] == [False, True]


def test_in_darkness_several_frames_have_to_be_steady() -> None:
    settling = Settling(before=frames(0.0), ratio=8.0, full_scale_dn=FULL)
    assert not settling.is_measurable
    assert settle(0.0, [0.0] * 10, 8.0) == UNMEASURED_FRAMES


def test_a_change_that_is_smaller_than_the_noise_is_not_waited_for() -> None:
    assert settle(60, [60] * 10, 1.01) == UNMEASURED_FRAMES


def test_the_message_says_what_was_expected_and_what_was_seen() -> None:
    half_lit = np.repeat([[[0]], [[100]]], 8, axis=0).repeat(16, axis=1).astype(np.uint16)
    settling = Settling(before=half_lit, ratio=2.0, full_scale_dn=FULL)
    settling.add(np.full((16, 16, 1), 51, np.uint16))
    assert settling.state() == "mean of unsaturated pixels before 50.00 dn, expected about 99.42, seen 51.00"


@pytest.mark.parametrize("size_px", [3, 4, 6])
@pytest.mark.parametrize("ratio", [1 / 8, 1 / 3, 3.0])
def test_a_checker_seen_by_a_webcam_is_followed_though_no_pixel_is_like_the_ones_around(
    size_px: int, ratio: float
) -> None:
    """A tone curve of sRGB, 8 bits: bright checks are saturated, dark ones are grey, and black is nowhere."""
    row, column = np.indices((120, 160)) // size_px
    falloff = np.linspace(1.0, 0.4, 160)[None, :, None]
    light = np.where((row + column) % 2, 1.6, 0.5)[..., None] * falloff * (0.4 if ratio > 1 else 1.0)

    def frame(exposure: float, seed: int) -> np.ndarray:
        noisy = light * exposure + np.random.default_rng(seed).normal(0, 0.004, light.shape)
        linear = np.clip(noisy, 0, 1)
        curve = np.where(linear < 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
        return np.rint(FULL * curve).astype(np.uint16)

    settling = Settling(before=frame(1.0, 0), ratio=ratio, full_scale_dn=FULL)
    assert settling.is_measurable
    stale = [settling.add(frame(1.0, seed)) for seed in range(1, 5)]
    assert stale == [False] * 4, "the old exposure is never taken for the new one"
    assert [settling.add(frame(ratio, seed)) for seed in range(5, 7)] == [False, True]


def test_a_picture_that_is_bright_all_over_is_measured_against_darker_ones_before_it() -> None:
    """Its darkest pixels would pass for black, and the least of a large change for none."""
    bright = np.clip(np.random.default_rng(1).normal(200, 10, (64, 64, 1)), 170, 230).astype(np.uint16)
    alone = Settling(before=bright, ratio=1 / 8, full_scale_dn=FULL)
    dark = Settling(before=frames(4.0, noise_dn=0.5), ratio=2.0, full_scale_dn=FULL)
    informed = Settling(before=bright, ratio=1 / 8, full_scale_dn=FULL, black_dn=dark.black_dn)
    assert alone.expected_dn > 150
    assert informed.expected_dn < 40
    assert informed.is_measurable
    assert informed.black_dn == dark.black_dn, "what is brighter than before tells nothing of black"


def test_frames_that_were_waited_for_blindly_make_no_later_wait_longer() -> None:
    asked = UNMEASURED_FRAMES
    for _ in range(5):
        settling = Settling(before=frames(0.0), ratio=8.0, full_scale_dn=FULL, unmeasured_frames=asked)
        for stale in range(3):
            settling.add(frames(20.0 + 10 * stale))
        while not settling.add(frames(0.0)):
            pass
        asked = max(asked, settling.frames_it_took)
    assert asked == UNMEASURED_FRAMES


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("ratio", [1 / 8, 1 / 2, 2.0, 8.0])
def test_what_is_expected_is_never_on_the_wrong_side(seed: int, ratio: float) -> None:
    """Whatever the picture: more exposure is no less light, less exposure no more."""
    random = np.random.default_rng(seed)
    steps = random.integers(1, 12)
    picture = random.integers(0, FULL + 1, (48 // steps + 1, 64 // steps + 1)).repeat(steps, 0).repeat(steps, 1)
    settling = Settling(before=picture[..., None].astype(np.uint16), ratio=ratio, full_scale_dn=FULL)
    usable = settling.state().split()[5]
    assert (settling.expected_dn - float(usable)) * (ratio - 1) >= -0.01


def test_a_black_level_is_no_light_that_a_longer_exposure_would_raise() -> None:
    """A nearly dark picture on a pedestal of 64: its mean follows the exposure by next to nothing."""
    dark = np.random.default_rng(1).normal(64.0, 0.4, (64, 64, 1))
    settling = Settling(before=np.rint(dark).astype(np.uint16), ratio=2.4, full_scale_dn=FULL)
    assert not settling.is_measurable
    assert [settling.add(np.rint(dark + 0.2).astype(np.uint16)) for _ in range(4)] == [False, False, False, True]


@pytest.mark.parametrize("noise_dn", [0.3, 1.0, 8.0])
def test_noise_of_a_dark_picture_is_no_light_that_a_longer_exposure_would_raise(noise_dn: float) -> None:
    """167 times the exposure: half of all pixels stand above the darkest by noise alone."""
    dark = [np.rint(np.random.default_rng(seed).normal(64.0, noise_dn, (128, 128, 1))) for seed in range(9)]
    settling = Settling(before=dark[0].astype(np.uint16), ratio=167.0, full_scale_dn=FULL)
    assert not settling.is_measurable
    settled = [settling.add(frame.astype(np.uint16)) for frame in dark[1:]]
    assert settled.index(True) == UNMEASURED_FRAMES - 1
