"""Projector pixels that are no boards, or other boards: named, or left out where the other views say which they are."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.lenses.calibrate import calibrate_lenses
from calibration.lenses.records import BoardSightings
from tests.calibration.lenses.board_world import CAMERA, PAIR, PROJECTOR, PROJECTOR_SIZE, sightings, truth

VIEWS = 6

Meddle = Callable[[np.ndarray], np.ndarray]


def meddled(how: Meddle, seed: int = 0) -> BoardSightings:
    """Sightings whose projector pixels, (views, corners, 2), are something else."""
    seen = sightings(truth(VIEWS, seed=seed))
    pixels = how(np.stack(np.split(seen.projector_xy_px, VIEWS))).reshape(-1, 2)
    return replace(seen, projector_xy_px=pixels, projector_by_camera=np.zeros_like(seen.projector_by_camera))


def chance(pixels: np.ndarray) -> np.ndarray:
    return np.random.default_rng(0).uniform(0, 1, pixels.shape) * PROJECTOR_SIZE


def columns_alone(pixels: np.ndarray) -> np.ndarray:
    return pixels * [1, 0]


def around(pixels: np.ndarray) -> np.ndarray:
    return np.roll(pixels, 1, axis=0)


WRONG: list[tuple[Meddle, str]] = [
    (lambda pixels: 0 * pixels + 255, r"in 6 of 6 views \(a, b, c, \.\.\.\) .*the same picture throughout"),
    (columns_alone, "stripes of one direction only"),
    (chance, r"6 of 6 views .*do not lie as a board does"),
    (lambda pixels: pixels * [-1, 1] + [PROJECTOR_SIZE[0] - 1, 0], r"6 of 6 views .*mirrored"),
    (around, r"explains \d of 6 views.*belong to other views"),
]


@pytest.mark.parametrize(("how", "words"), WRONG)
@pytest.mark.parametrize("seed", range(3))
def test_what_no_projector_can_light_is_named(how: Meddle, words: str, seed: int) -> None:
    with pytest.raises(CalibrationError, match=words):
        calibrate_lenses(meddled(how, seed), PAIR, names=tuple("abcdef"))


def one_view(how: Meddle) -> Meddle:
    """Only the third view's pixels are meddled with."""
    return lambda pixels: np.concatenate([pixels[:2], how(pixels[2:3]), pixels[3:]])


ONE = {
    "by chance": one_view(chance),
    "still": one_view(lambda pixels: 0 * pixels + 100),
    "mirrored": one_view(lambda pixels: pixels * [-1, 1] + [PROJECTOR_SIZE[0] - 1, 0]),
    "stale": lambda pixels: pixels[[0, 1, 1, 3, 4, 5]],
    "two exchanged": lambda pixels: pixels[[1, 0, 2, 3, 4, 5]],
}


@pytest.mark.parametrize("what", ONE)
@pytest.mark.parametrize("seed", range(2))
def test_a_view_that_does_not_belong_is_left_out_and_does_no_harm(what: str, seed: int) -> None:
    found = calibrate_lenses(meddled(ONE[what], seed), PAIR).calibration
    used = found.used[:, 1].reshape(VIEWS, -1).mean(axis=1)
    odd = [0, 1] if what == "two exchanged" else [2]
    assert (used[odd] == 0).all()
    assert (np.delete(used, odd) > 0.95).all()
    off = np.concatenate([found.state.camera - CAMERA, found.state.projector - PROJECTOR])[[0, 2, 3, 12, 14, 15]]
    assert np.abs(off / found.sigmas()[[0, 2, 3, 12, 14, 15]]).max() < 4


def test_a_few_misread_corners_of_each_view_are_left_out() -> None:
    def misread(pixels: np.ndarray) -> np.ndarray:
        pixels = pixels.copy()
        pixels[:, ::9] += 70 * np.random.default_rng(1).normal(size=pixels[:, ::9].shape)
        return pixels

    found = calibrate_lenses(meddled(misread), PAIR).calibration
    misread_used = found.used[:, 1].reshape(VIEWS, -1)[:, ::9]
    assert misread_used.mean() < 0.05
    assert np.abs((found.state.projector - PROJECTOR)[:4] / found.sigmas()[12:16]).max() < 4
