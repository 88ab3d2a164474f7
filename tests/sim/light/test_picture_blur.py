"""A picture's blur as an operator: against OpenCV's, its adjoint, its width."""

import cv2
import numpy as np
import pytest
from scipy.special import ive

from sim.light.picture_blur import PictureBlur

SHAPE = (40, 50)


def blur_of(variance: float | np.ndarray, chosen: np.ndarray | None = None) -> PictureBlur:
    every = np.ones(SHAPE[0] * SHAPE[1], dtype=bool)
    return PictureBlur(variance_px2=np.broadcast_to(variance, (*SHAPE, 2)), chosen=every if chosen is None else chosen)


def test_an_even_blur_is_that_of_opencv() -> None:
    picture = np.random.default_rng(1).uniform(size=SHAPE)
    expected = cv2.GaussianBlur(picture, (0, 0), 1.5, borderType=cv2.BORDER_CONSTANT)
    found = blur_of(1.5**2).apply(picture.ravel()).reshape(SHAPE)
    assert np.abs(found - expected).max() < 0.02


@pytest.mark.parametrize("variance", [0.05, 0.3, 2.0])
def test_a_point_gets_the_variance_however_small(variance: float) -> None:
    point = np.zeros(SHAPE)
    point[20, 25] = 1
    spread = blur_of(variance).apply(point.ravel()).reshape(SHAPE)
    assert spread.sum() == pytest.approx(1, abs=1e-6)
    assert (spread.sum(axis=0) * (np.arange(50) - 25) ** 2).sum() == pytest.approx(variance, rel=0.02)


def test_the_adjoint_is_the_transpose_with_an_uneven_blur_and_some_pixels_only() -> None:
    random = np.random.default_rng(2)
    chosen = random.uniform(size=SHAPE[0] * SHAPE[1]) < 0.7
    blur = blur_of(random.uniform(0.1, 3.0, (*SHAPE, 2)), chosen)
    x, y = random.normal(size=(2, chosen.sum()))
    assert np.vdot(blur.apply(x), y) == pytest.approx(np.vdot(x, blur.adjoint(y)), rel=1e-10)


def test_several_pictures_are_blurred_at_once_as_one_by_one() -> None:
    pictures = np.random.default_rng(3).uniform(size=(SHAPE[0] * SHAPE[1], 2))
    blur = blur_of(0.8)
    assert np.array_equal(blur.apply(pictures)[:, 1], blur.apply(pictures[:, 1]))


@pytest.mark.parametrize("sigma_px", [0.05, 1.0, 20.0])
def test_the_weights_are_those_of_the_bessel_functions(sigma_px: float) -> None:
    point = np.zeros((1, 301))
    point[0, 150] = 1
    blur = PictureBlur(variance_px2=np.full((1, 301, 2), sigma_px**2), chosen=np.ones(301, dtype=bool))
    found = blur.apply(point.ravel())
    expected = ive(np.abs(np.arange(301) - 150), sigma_px**2) * (found > 0)
    across = found.sum()  # the one row keeps a share of the blur across it
    assert found / across == pytest.approx(expected / expected.sum(), abs=1e-9)
