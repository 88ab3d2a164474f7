"""Mosaics of colour filters: what each pixel measured stays, and what is between is interpolated."""

import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.radiometry.mosaic import Mosaic

SHAPE = (12, 17)
PATTERNS = ("RGGB", "GRBG", "GBRG", "BGGR")


def planes() -> np.ndarray:
    """(H, W, 3) bands that rise linearly, each in its own way."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(np.float32)
    return np.stack([5 + x + 0.5 * y, 40 - 2 * x + y, 7 + 0 * x - 0.25 * y], axis=-1)


@pytest.mark.parametrize("pattern", PATTERNS)
def test_the_pattern_names_the_filters_of_the_first_two_rows(pattern: str) -> None:
    bands = Mosaic(pattern).bands(SHAPE)
    assert "".join("RGB"[bands[y, x]] for y in (0, 1) for x in (0, 1)) == pattern
    np.testing.assert_array_equal(bands[2:, 2:], bands[:-2, :-2])


@pytest.mark.parametrize("pattern", PATTERNS)
def test_light_that_rises_linearly_comes_back_in_all_bands_and_places(pattern: str) -> None:
    mosaic, light = Mosaic(pattern), planes()
    found = mosaic.interpolated(mosaic.seen(light))
    np.testing.assert_allclose(found[1:-1, 1:-1], light[1:-1, 1:-1], atol=1e-5)


@pytest.mark.parametrize("pattern", PATTERNS)
def test_what_a_pixel_measured_itself_is_kept_at_the_border_too(pattern: str) -> None:
    mosaic = Mosaic(pattern)
    raw = np.random.default_rng(3).random((*SHAPE, 1), np.float32)
    np.testing.assert_allclose(mosaic.seen(mosaic.interpolated(raw)), raw, rtol=1e-6)


def test_variances_are_those_of_many_noisy_frames() -> None:
    mosaic, rng = Mosaic("GRBG"), np.random.default_rng(8)
    sigma = rng.uniform(0.5, 2.0, (*SHAPE, 1)).astype(np.float32)
    frames = [mosaic.interpolated(sigma * rng.standard_normal(sigma.shape, np.float32)) for _ in range(4000)]
    ratio = np.var(frames, axis=0) / mosaic.interpolated_variance(sigma**2)
    assert 0.85 < ratio.min() < ratio.max() < 1.15


def test_a_clipped_pixel_touches_only_what_was_made_of_it() -> None:
    flags = np.zeros((*SHAPE, 1), bool)
    flags[4, 6] = True  # red of RGGB
    touched = Mosaic("RGGB").touched(flags)
    assert touched[..., 0].sum() == 9
    assert touched[3:6, 5:8, 0].all()
    assert not touched[..., 1:].any()


@pytest.mark.parametrize("shape", [(8, 8, 3), (1, 8, 1)])
def test_an_image_that_is_no_mosaic_is_refused(shape: tuple[int, int, int]) -> None:
    with pytest.raises(CalibrationError, match="give raw frames"):
        Mosaic("RGGB").interpolated(np.zeros(shape, np.float32))
