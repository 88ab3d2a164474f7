"""How large checks have to be, from stripes of a code."""

import cv2
import numpy as np
import pytest

from calibration.light.blur import fit_point_spread, variance_sigma_map
from calibration.light.check_size import (
    PICTURES_AN_AXIS,
    blur_of_picture_px,
    check_size_px,
    pixel_of_picture_px,
    stripes_that_tell,
    why_checks_are_larger,
)
from calibration.structured_light.correspondence import Correspondence
from calibration.structured_light.gray import gray_code_patterns
from calibration.structured_light.patterns import Pattern, checker_patterns, flat

PROJECTOR, CAMERA = (160, 200), (150, 220)
FINE = 4


def seen(pattern: Pattern, blur_px: float, noise_share: float = 0.008) -> np.ndarray:
    """A camera of the projector's scale, whose lens is sharp; the projector's is not."""
    fine = np.repeat(np.repeat(pattern.codes / 255, FINE, axis=0), FINE, axis=1).astype(np.float32)
    blurred = cv2.GaussianBlur(fine, (0, 0), blur_px * FINE)
    small = cv2.resize(blurred, PROJECTOR[::-1], interpolation=cv2.INTER_AREA)
    light = np.pad(small, ((0, 0), (0, CAMERA[1] - PROJECTOR[1])))[: CAMERA[0]]
    noise = np.random.default_rng(list(pattern.name.encode())).normal(0, 0.5 * noise_share, CAMERA)
    return (0.5 * light + 0.2 + noise).astype(np.float32)


def correspondence(place_sigma_px: float = 0.0) -> Correspondence:
    xy = np.stack(np.meshgrid(np.arange(CAMERA[1]), np.arange(CAMERA[0])), axis=-1).astype(np.float32)
    xy += np.random.default_rng(5).normal(0, place_sigma_px, xy.shape).astype(np.float32)
    reason = np.broadcast_to(np.arange(CAMERA[1]) >= PROJECTOR[1], CAMERA).astype(np.uint8)
    return Correspondence(xy, reason, PROJECTOR)


@pytest.mark.parametrize("blur_px", [0.8, 3.0])
def test_stripes_tell_the_blur_before_any_check_is_shown(blur_px: float) -> None:
    stripes = stripes_that_tell(list(gray_code_patterns(PROJECTOR)))
    frames = [seen(pattern, blur_px) for pattern in stripes]
    valid = correspondence().valid
    spread = fit_point_spread(frames, [pattern.codes for pattern in stripes], correspondence(), valid)
    expected = np.hypot(blur_px, np.sqrt(1 / 12))
    assert blur_of_picture_px(spread, correspondence(), valid) == pytest.approx(expected, rel=0.1)
    assert np.nanmedian(variance_sigma_map(spread, correspondence())[valid]) < 0.2 * expected**2


@pytest.mark.parametrize("blur_px", [0.8, 1.5, 2.5])
def test_stripes_tell_the_blur_where_noise_is_large_and_places_are_uncertain(blur_px: float) -> None:
    # A single edge near a pixel tells its place as well as the blur: what the code says of the place has to count.
    stripes = stripes_that_tell(list(gray_code_patterns(PROJECTOR)))
    frames = [seen(pattern, blur_px, noise_share=0.03) for pattern in stripes]
    told = correspondence(place_sigma_px=0.2)
    spread = fit_point_spread(frames, [pattern.codes for pattern in stripes], told, told.valid)
    expected = np.hypot(blur_px, np.sqrt(1 / 12))
    assert blur_of_picture_px(spread, told, told.valid) == pytest.approx(expected, rel=0.12)


def test_the_stripes_that_tell_along_both_axes_are_taken() -> None:
    patterns = [flat(PROJECTOR, 255, "white"), *gray_code_patterns(PROJECTOR)]
    chosen = stripes_that_tell(patterns)
    assert len(chosen) == 2 * PICTURES_AN_AXIS
    columns = [pattern for pattern in chosen if (pattern.codes[0] == pattern.codes).all()]
    assert len(columns) == PICTURES_AN_AXIS
    assert {pattern.name.removesuffix("-inverse") for pattern in columns} == {"gray-column-03", "gray-column-04"}
    assert not {pattern.name for pattern in chosen} & {"white"}


def test_a_code_without_black_and_white_stripes_along_both_axes_tells_nothing() -> None:
    grey = [Pattern(pattern.name, pattern.codes // 2) for pattern in gray_code_patterns(PROJECTOR)]
    columns = [pattern for pattern in gray_code_patterns(PROJECTOR) if "column" in pattern.name]
    assert stripes_that_tell(grey) == stripes_that_tell(columns) == []


@pytest.mark.parametrize(
    ("blur_px", "side_px"), [(0.0, 8), (1.0, 8), (1.2, 12), (2.2, 20), (2.54, 24), (2.9, 28), (4.1, 38), (50.0, 48)]
)
def test_checks_grow_when_blur_makes_them_too_fine_and_stay_several_in_the_picture(
    blur_px: float, side_px: int
) -> None:
    assert check_size_px(8, blur_px, (384, 512)) == side_px
    assert len(list(checker_patterns((384, 512), side_px))) == 25


@pytest.mark.parametrize(("camera_pixel_px", "side_px"), [(0.5, 8), (1.2, 8), (2.4, 12), (2.8, 14), (90.0, 48)])
def test_checks_grow_where_camera_pixels_are_too_coarse_to_see_their_middles(
    camera_pixel_px: float, side_px: int
) -> None:
    assert check_size_px(8, 0.9, (384, 512), camera_pixel_px=camera_pixel_px) == side_px


def test_a_camera_pixel_is_as_large_as_its_neighbours_are_apart() -> None:
    there = correspondence()
    wide = Correspondence(2.5 * there.projector_xy_px, there.reason, (500, 500))
    assert pixel_of_picture_px(there) == pytest.approx(1)
    assert pixel_of_picture_px(wide) == pytest.approx(2.5)
    assert pixel_of_picture_px(Correspondence(there.projector_xy_px, np.ones_like(there.reason), PROJECTOR)) == 0


def test_checks_are_never_smaller_than_asked_for() -> None:
    assert check_size_px(64, 0.5, (384, 512)) == check_size_px(64, 30.0, (384, 512)) == 64


@pytest.mark.parametrize(
    ("blur_px", "pixel_px", "why"),
    [
        (
            1.24,
            2.0,
            "by the code's stripes the picture is blurred by 1.2 px, and a camera pixel sees 2.0 px of the picture",
        ),
        (None, 2.0, "a camera pixel sees 2.0 px of the picture"),
        (1.24, None, "by the code's stripes the picture is blurred by 1.2 px"),
    ],
)
def test_larger_checks_are_explained_by_what_was_measured_alone(
    blur_px: float | None, pixel_px: float | None, why: str
) -> None:
    """A code without stripes of two levels tells no blur: none is said, in place of 0.0 px."""
    assert why_checks_are_larger(blur_px, pixel_px) == why
