"""How a projector's channels mix into a camera's bands."""

import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.radiometry.mixing import fit_mixing

FloatArray = NDArray[np.float64]
MIXING = np.array([[0.91, 0.07, 0.02], [0.06, 0.86, 0.08], [0.02, 0.07, 0.91]])
SHAPE = (60, 80)
EVERYWHERE = np.ones(SHAPE, bool)


def photographs(
    mixing: FloatArray, white_boost: float = 0.0, noise: float = 0.0
) -> tuple[FloatArray, list[FloatArray]]:
    """White and the pure channels on a surface whose brightness varies a hundredfold, from band to band otherwise."""
    rng = np.random.default_rng(3)
    lit_by_white = 10 ** rng.uniform(-2, 0, (*SHAPE, 3))
    pure = [lit_by_white * mixing[:, q] for q in range(3)]
    white = (1 + white_boost) * lit_by_white * mixing.sum(axis=1)
    return white + noise * rng.standard_normal(white.shape), [p + noise * rng.standard_normal(p.shape) for p in pure]


def test_the_mixing_is_found_from_white_and_pure_colours_whatever_they_fall_on() -> None:
    found = fit_mixing(*photographs(MIXING), EVERYWHERE)
    assert found.matrix == pytest.approx(MIXING / MIXING.sum(axis=1, keepdims=True), abs=1e-12)
    assert found.white_over_channels == pytest.approx(1)
    assert found.variation < 1e-12


def test_rows_sum_to_one_so_that_white_is_white_in_each_band() -> None:
    found = fit_mixing(*photographs(MIXING * [[0.4], [1.0], [0.7]], noise=1e-4), EVERYWHERE)
    assert found.matrix.sum(axis=1) == pytest.approx(1)
    assert found.matrix == pytest.approx(MIXING / MIXING.sum(axis=1, keepdims=True), abs=1e-3)


def test_a_few_wild_pixels_do_not_matter() -> None:
    white, pure = photographs(MIXING)
    pure[0][:6] *= 5
    assert fit_mixing(white, pure, EVERYWHERE).matrix == pytest.approx(MIXING / MIXING.sum(axis=1)[:, None], abs=0.01)


def test_a_mixing_that_differs_from_place_to_place_is_told() -> None:
    white, pure = photographs(MIXING)
    pure[1][:, 40:, 0] *= 1.5
    assert fit_mixing(white, pure, EVERYWHERE).variation > 0.01


def test_a_white_segment_is_refused_with_its_brightness() -> None:
    with pytest.raises(
        CalibrationError, match=r"white is 1.300, 1.300, 1.300 times red \+ green \+ blue.*picture mode"
    ):
        fit_mixing(*photographs(MIXING, white_boost=0.3), EVERYWHERE)


def test_channels_that_look_alike_are_refused() -> None:
    alike = np.array([[0.31, 0.38, 0.31], [0.30, 0.39, 0.31], [0.31, 0.37, 0.32]])
    with pytest.raises(
        CalibrationError, match=r"condition .*, the limit is 30: two channels of the projector look alike"
    ):
        fit_mixing(*photographs(alike), EVERYWHERE)


def test_no_light_says_so() -> None:
    with pytest.raises(CalibrationError, match="0 lit pixels, at least 50 are needed"):
        fit_mixing(*photographs(MIXING), np.zeros(SHAPE, bool))
    white, pure = photographs(MIXING)
    with pytest.raises(CalibrationError, match="no light from red, green and blue"):
        fit_mixing(white, [0 * image for image in pure], EVERYWHERE)
