"""Places in the projector's picture by the light of a code's stripes, beside what its bits said."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import pytest

from calibration.arrays import Float32Array
from calibration.light.blur import LensBlur, PointSpread
from calibration.light.places import places_by_light
from calibration.structured_light.correspondence import Correspondence
from calibration.structured_light.gray import BOTH_AXES
from calibration.structured_light.patterns import Pattern
from rig.plug_ins import find_code

CAMERA, PROJECTOR = (90, 120), (192, 256)
BLUR_PX, FINE = 1.0, 8
DIRECT, OTHER = 0.5, 0.2


@cache
def stripes() -> tuple[Pattern, ...]:
    patterns = find_code("long-run").patterns(PROJECTOR)
    return tuple(each for each in patterns if not each.name.endswith("-inverse"))


@cache
def true_places() -> Float32Array:
    y, x = np.mgrid[: CAMERA[0], : CAMERA[1]]
    return np.stack([20.3 + 1.37 * x + 0.11 * y, 15.7 - 0.07 * x + 1.29 * y], axis=-1).astype(np.float32)


def seen(pattern: Pattern, noise: float) -> Float32Array:
    """Light of a pattern minus its inverse: the picture in eight times finer pixels, blurred, where pixels look."""
    fine = np.kron(pattern.codes / 255.0 * 2 - 1, np.ones((FINE, FINE))).astype(np.float32)
    blurred = cv2.GaussianBlur(fine, (0, 0), BLUR_PX * FINE)
    at = (true_places() + 0.5) * FINE - 0.5
    random = np.random.default_rng(len(pattern.name) + int(pattern.codes[7, 9]))
    light = DIRECT * cv2.remap(blurred, at[..., 0], at[..., 1], cv2.INTER_LINEAR)
    return np.asarray(light + random.normal(0, noise, light.shape), dtype=np.float32)


def by_light(start_error_px: float, noise: float, movable: bool = True) -> Correspondence:
    # The camera's own pixel is wider in the projector's picture than a point, which is what was rendered.
    camera = LensBlur(CAMERA, (-1 / 12, 0.0, 0.0, 0.0))
    spread = PointSpread(
        projector=LensBlur(PROJECTOR, (BLUR_PX**2 + 1e-6, 0.0, 0.0, 0.0)),
        camera=camera,
        between_pixels=0.0,
        covariance=np.zeros((9, 9)),
        rms=0.0,
    )
    start = (true_places() + np.float32(start_error_px)).astype(np.float32)
    known = Correspondence(start, np.zeros(CAMERA, np.uint8), PROJECTOR)
    frames = [seen(pattern, noise) for pattern in stripes()]
    codes = [pattern.codes for pattern in stripes()]
    return places_by_light(frames, codes, known, spread, movable=np.full(CAMERA, movable))


@pytest.mark.parametrize("error_px", [0.15, -0.25])
def test_light_finds_places_that_the_window_had_off(error_px: float) -> None:
    found = by_light(error_px, noise=1e-4)
    left = np.abs(found.projector_xy_px - true_places())[10:-10, 10:-10]
    assert np.median(left) < 0.01
    assert np.quantile(left, 0.99) < 0.05


def test_noise_is_in_the_sigmas() -> None:
    found = by_light(0.1, noise=0.02)
    assert found.sigma_px is not None
    scores = ((found.projector_xy_px - true_places()) / found.sigma_px)[10:-10, 10:-10]
    assert len(BOTH_AXES) == scores.shape[-1]
    assert np.median(np.abs(scores)) / 0.6745 == pytest.approx(1.0, abs=0.25)


def test_pixels_that_are_not_asked_stay() -> None:
    np.testing.assert_array_equal(by_light(0.1, 0.01, movable=False).projector_xy_px, true_places() + np.float32(0.1))
