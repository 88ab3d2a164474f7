"""Blur of two lenses, found from photographs of checkers that were blurred here by other means."""

import cv2
import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.light.blur import fit_point_spread, footprint_map, stretch
from calibration.light.two_level import Footprint, lit_share, two_level, white_share
from calibration.structured_light.correspondence import Correspondence
from calibration.structured_light.patterns import checker, checker_patterns, random_blocks

PROJECTOR, CAMERA = (160, 200), (150, 220)
FINE = 4
"""Sub-samples of a camera pixel, and of a projector pixel, along each axis."""


def places(fine: int = 1) -> np.ndarray:
    """(H, W, 2) projector coordinates; camera pixels are half a projector pixel on the left, two on the right."""
    y, x = ((np.arange(n * fine) + 0.5) / fine - 0.5 for n in CAMERA)
    column = 6 + 0.45 * x + 0.0018 * x**2 + 0.02 * y[:, None]
    row = 8 + 0.95 * y[:, None] + 0.0 * x
    return np.stack(np.broadcast_arrays(column, row), axis=-1).astype(np.float32)


def photographs(projector_px: float, camera_px: float, noise: float = 0.003, shifts: int = 25) -> list[np.ndarray]:
    random = np.random.default_rng(5)
    frames = []
    for pattern in checker_patterns(PROJECTOR, 8, shifts):
        squares = np.repeat(np.repeat(pattern.codes / 255, FINE, axis=0), FINE, axis=1).astype(np.float32)
        sharp = cv2.GaussianBlur(squares, (0, 0), projector_px * FINE)
        at = (places(FINE) + 0.5) * FINE - 0.5
        seen = cv2.remap(sharp, at[..., 0], at[..., 1], cv2.INTER_LINEAR)
        seen = cv2.GaussianBlur(seen, (0, 0), camera_px * FINE)
        light = 0.6 * cv2.resize(seen, CAMERA[::-1], interpolation=cv2.INTER_AREA) + 0.2
        frames.append((light + random.normal(0, noise, CAMERA)).astype(np.float32))
    return frames


def correspondence(error_px: float = 0.05) -> Correspondence:
    random = np.random.default_rng(6)
    xy = cv2.GaussianBlur(random.normal(0, error_px * 7, (*CAMERA, 2)), (0, 0), 2) + places()
    return Correspondence(xy.astype(np.float32), np.zeros(CAMERA, np.uint8), PROJECTOR)


def codes() -> list[np.ndarray]:
    return [pattern.codes for pattern in checker_patterns(PROJECTOR)]


@pytest.mark.parametrize("jump_px", [3.0, 14.0, -14.0])
def test_places_are_as_close_beside_the_edge_of_a_thing_as_on_it(jump_px: float) -> None:
    xy = places()
    xy[:, 100:, 0] += jump_px
    found = stretch(Correspondence(xy, np.zeros(CAMERA, np.uint8), PROJECTOR))
    expected = stretch(Correspondence(places(), np.zeros(CAMERA, np.uint8), PROJECTOR))
    assert found == pytest.approx(expected, rel=0.02)


def test_places_at_the_corner_of_a_room_are_as_close_as_on_both_walls_at_the_mean() -> None:
    xy = places()
    xy[..., 0] = np.where(np.arange(CAMERA[1]) < 100, 0.6, 0.9) * (np.arange(CAMERA[1]) - 100) + 90
    found = stretch(Correspondence(xy, np.zeros(CAMERA, np.uint8), PROJECTOR))
    assert found[:, [50, 100, 150], 0] == pytest.approx(
        np.array([[0.6, 0.75, 0.9]]).repeat(CAMERA[0], 0) ** 2, abs=1e-3
    )


@pytest.mark.parametrize(("projector_px", "camera_px"), [(1.2, 0.5), (0.6, 1.2)])
def test_both_lenses_blur_is_found_and_told_apart(projector_px: float, camera_px: float) -> None:
    found = fit_point_spread(photographs(projector_px, camera_px), codes(), correspondence(), np.ones(CAMERA, bool))
    middle = [np.array([(n - 1) / 2 for n in shape[::-1]]) for shape in (PROJECTOR, CAMERA)]
    assert found.projector.sigma_px(middle[0]) == pytest.approx(projector_px, rel=0.08)
    assert found.camera.sigma_px(middle[1]) == pytest.approx(camera_px, rel=0.12)


@pytest.mark.parametrize("noise", [0.002, 0.01])
def test_few_noisy_pictures_through_sharp_lenses_do_not_lead_the_fit_astray(noise: float) -> None:
    few = [pattern.codes for pattern in checker_patterns(PROJECTOR, 8, 16)]
    lit = np.ones(CAMERA, bool)
    found = fit_point_spread(photographs(0.5, 0.4, noise, shifts=16), few, correspondence(), lit)
    seen = footprint_map(found, correspondence(0.0))
    expected = 0.5**2 + (0.4**2 + 1 / 12) * (0.45 + 0.0036 * 110) ** 2
    assert seen.variance_px2[75, 110, 0] == pytest.approx(expected, rel=0.25)
    assert found.rms < 4 * noise


def test_what_a_pixel_is_lit_with_is_known_to_a_hundredth_from_the_blur_that_was_found() -> None:
    frames = photographs(1.0, 0.8, noise=0.003)
    spread = fit_point_spread(frames, codes(), correspondence(), np.ones(CAMERA, bool))
    true_places = Correspondence(places(), np.zeros(CAMERA, np.uint8), PROJECTOR)
    seen = footprint_map(spread, true_places)
    flat = Footprint(xy_px=seen.xy_px.reshape(-1, 2).astype(np.float64), variance_px2=seen.variance_px2.reshape(-1, 2))
    share = lit_share(two_level(codes()[7]), flat).reshape(CAMERA)
    inside = (slice(10, -10), slice(10, -10))
    assert np.sqrt(np.mean((0.6 * share + 0.2 - frames[7])[inside] ** 2)) < 0.01


def test_a_pixel_at_the_border_of_the_picture_sees_half_of_white() -> None:
    xy = np.array([[50.0, 60.0], [-0.5, 60.0], [199.5, 159.5], [-9.0, 60.0]])
    share = white_share(Footprint(xy_px=xy, variance_px2=np.ones((4, 2))), PROJECTOR)
    assert share == pytest.approx([1.0, 0.5, 0.25, 0.0], abs=1e-6)


def test_checkers_and_stripes_are_products_of_a_row_and_a_column() -> None:
    picture = checker((40, 48), 8, (3, 5))
    found = two_level(picture)
    assert np.array_equal(np.outer(found.row, found.column) > 0, picture > 0)


@pytest.mark.parametrize("picture", [random_blocks((40, 48), 6), np.full((40, 48), 128, np.uint8)])
def test_other_pictures_are_refused(picture: np.ndarray) -> None:
    with pytest.raises(CalibrationError, match="no checker and no stripes"):
        two_level(picture)


def test_too_few_pictures_are_refused() -> None:
    with pytest.raises(CalibrationError, match="3 pictures to find the blur from, at least 8"):
        fit_point_spread(photographs(1.0, 0.5)[:3], codes()[:3], correspondence(), np.ones(CAMERA, bool))
