"""Pictures of checks that are, and that are not, what direct light makes of them."""

import cv2
import numpy as np
import pytest

from calibration.light.blur import fit_point_spread, footprint_map
from calibration.light.cross_check import CrossCheck, cross_check
from calibration.light.separation import separate_by_pattern, with_more_direct
from calibration.light.two_level import Footprint
from calibration.structured_light.correspondence import Correspondence
from calibration.structured_light.patterns import checker_patterns

SHAPE = (96, 128)
BLUR_PX = 0.6


def scene(size_px: int = 8, sharpened: float = 0.0) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Codes, and what a camera with the projector's pixels sees of them on a wall of which a third comes back."""
    random = np.random.default_rng(3)
    wall = 1 + 0.3 * np.sin(np.arange(SHAPE[1]) / 9)[None, :] * np.ones((SHAPE[0], 1))
    codes, frames = [], []
    for pattern in checker_patterns(SHAPE, size_px, 25):
        picture = wall * (cv2.GaussianBlur(pattern.codes / 255, (0, 0), BLUR_PX) + 0.3)
        picture = picture + sharpened * (picture - cv2.GaussianBlur(picture, (0, 0), 1.2))
        codes.append(pattern.codes)
        frames.append((picture + random.normal(0, 0.01, SHAPE)).astype(np.float32))
    return codes, frames


def crossed(codes: list[np.ndarray], frames: list[np.ndarray], gain: float = 1.0) -> CrossCheck:
    """By direct light as it is, times a gain."""
    row, column = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(np.float32)
    xy = np.stack([column, row], axis=-1)
    correspondence = Correspondence(xy, np.zeros(SHAPE, np.uint8), SHAPE)
    wall = 1 + 0.3 * np.sin(np.arange(SHAPE[1]) / 9)[None, :] * np.ones((SHAPE[0], 1))
    found = cross_check(
        frames,
        codes,
        correspondence,
        seen=Footprint(xy_px=xy.astype(np.float64), variance_px2=np.full((*SHAPE, 2), BLUR_PX**2)),
        direct=(gain * wall).astype(np.float32),
        usable=np.ones(SHAPE, dtype=bool),
    )
    assert found is not None
    return found


def test_pictures_that_are_what_light_makes_of_them_agree() -> None:
    found = crossed(*scene())
    assert found.middle_percent == pytest.approx(0, abs=0.3)
    assert np.abs(found.off_percent).max() < 0.3
    assert found.rms_ratio.max() < 1.3


@pytest.mark.parametrize("gain", [0.95, 1.05])
def test_direct_light_that_edges_made_too_large_is_told_by_the_middles_of_checks(gain: float) -> None:
    assert crossed(*scene(), gain=gain).middle_percent == pytest.approx(100 / gain - 100, abs=0.4)


@pytest.mark.parametrize("picture", [0, 11, 24])
@pytest.mark.parametrize("by", [0.06, -0.06])
def test_light_that_was_on_for_one_picture_is_told_by_that_picture(picture: int, by: float) -> None:
    codes, frames = scene()
    frames[picture] = frames[picture] + np.float32(by)
    found = crossed(codes, frames)
    assert found.off_percent[picture] == pytest.approx(100 * by, rel=0.2)
    assert np.abs(np.delete(found.off_percent, picture)).max() < 1


def test_somebody_in_a_corner_of_a_picture_stands_out_of_what_is_left() -> None:
    codes, frames = scene()
    frames[7] = frames[7].copy()
    frames[7][50:, 20:40] *= np.float32(0.3)
    found = crossed(codes, frames)
    assert int(found.rms_ratio.argmax()) == 7
    assert found.rms_ratio[7] > 3
    assert np.delete(found.rms_ratio, 7).max() < 1.3


def test_checks_too_small_for_a_middle_tell_nothing_of_it() -> None:
    assert crossed(*scene(size_px=4)).middle_percent is None


def test_too_few_pixels_tell_nothing() -> None:
    codes, frames = scene()
    row, column = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(np.float32)
    xy = np.stack([column, row], axis=-1)
    none = cross_check(
        frames,
        codes,
        Correspondence(xy, np.zeros(SHAPE, np.uint8), SHAPE),
        seen=Footprint(xy_px=xy.astype(np.float64), variance_px2=np.full((*SHAPE, 2), 0.4)),
        direct=np.ones(SHAPE, np.float32),
        usable=np.zeros(SHAPE, dtype=bool),
    )
    assert none is None


def test_direct_light_that_a_halo_hides_at_edges_is_brought_back_by_the_middles_of_checks() -> None:
    """A tenth of the light goes 1.3 px wide, as no Gaussian has it; a third of white comes back from other walls."""
    codes, frames = [], []
    for pattern in checker_patterns(SHAPE, 12, 25):
        sharp = pattern.codes / 255
        halo = sum(share * cv2.GaussianBlur(sharp, (0, 0), sigma) for share, sigma in ((0.85, 0.4), (0.15, 1.6)))
        codes.append(pattern.codes)
        frames.append((0.75 * halo + 0.25 * sharp.mean()).astype(np.float32))
    row, column = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(np.float32)
    correspondence = Correspondence(np.stack([column, row], axis=-1), np.zeros(SHAPE, np.uint8), SHAPE)
    white = np.ones(SHAPE, np.float32)
    spread = fit_point_spread(frames, codes, correspondence, np.ones(SHAPE, dtype=bool))
    found = separate_by_pattern(frames, codes, correspondence, white=white, spread=spread)
    inside = np.s_[12:-12, 12:-12]
    crossed = cross_check(
        frames,
        codes,
        correspondence,
        seen=footprint_map(spread, correspondence),
        direct=found.direct,
        usable=found.valid,
    )
    assert crossed is not None
    assert crossed.middle_percent is not None
    mended = with_more_direct(found, crossed.middle_percent / 100, white=white)
    off = [float(part.direct[inside].mean() / 0.75 - 1) for part in (found, mended)]
    assert off[0] < -0.004
    assert abs(off[1]) < abs(off[0]) / 2
    assert mended.global_ == pytest.approx(white - mended.direct)
